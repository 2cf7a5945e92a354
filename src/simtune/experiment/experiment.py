"""What a run is made of: the task, the real world, the simulator, the search."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from simtune.cameras.views import apart
from simtune.checking.image_size import choose_image_size
from simtune.checking.recording_warnings import warnings_of
from simtune.config import TrainConfig, TuneConfig
from simtune.devices import choose_device
from simtune.errors import InputError
from simtune.experiment import outcome
from simtune.experiment.keypoints import keypoints_of_run
from simtune.experiment.presets import choose_search_settings
from simtune.experiment.settings import Settings
from simtune.names import SearchName
from simtune.networks.layers import under
from simtune.parameters import ParameterSpace
from simtune.progress import ReportProgress, silent
from simtune.real import RealWorld
from simtune.real.choose import choose_real, observed
from simtune.real.recorded import ClosedReal, RecordedReal
from simtune.real.truth import Truth
from simtune.run.config import check_asked
from simtune.run.folder import stored_state
from simtune.simulation import AnySimulator, Points
from simtune.tasks import (
    AnyTask,
    known_values,
    load_any_task,
    with_known_colours,
    with_model,
    with_one_square_camera,
)
from simtune.trajectory import Trajectory
from simtune.tuning import SearchContext, make_search
from simtune.tuning.readings import ReadingsConfig, ReadingsSearch
from simtune.tuning.search import Search
from simtune.vision.keypoints import Keypoints


@dataclass(frozen=True, kw_only=True)
class TuningProblem:
    """A real world, and the simulator to be tuned to it."""

    config: TuneConfig | TrainConfig
    run_config: dict[str, Any]  # stored in config.json: only a run with the same resumes
    task: AnyTask
    real: RealWorld
    recordings: list[Trajectory]  # real episodes available before the run begins
    truth: Truth | None  # of a pseudo-real world: for scores, and for the oracle
    context: SearchContext

    @property
    def space(self) -> ParameterSpace:
        return self.task.parameters

    @property
    def sources(self) -> list[Path]:
        """Files that the run folder keeps, for later commands."""
        truth = self.config.real_parameters
        return [*self.task.files, *([truth.resolve()] if truth else [])]

    @property
    def start(self) -> np.ndarray:
        """(N,) parameters where the search begins."""
        return self.context.start

    @property
    def simulator(self) -> AnySimulator:
        return self.context.simulator

    @property
    def keypoints(self) -> Keypoints | Points:
        """Chosen once per run: keypoint k means the same to search, environment and agent."""
        return self.context.keypoints


@dataclass(frozen=True, kw_only=True)
class Experiment(TuningProblem):
    """What `tune` works with; `TrainingExperiment` adds what learns to act."""

    settings: Settings
    search_name: SearchName | None  # None: no search
    search: Search

    def warnings(self, real: list[Trajectory]) -> list[str]:
        """Possible problems of recordings; none are known for other real episodes."""
        return warnings_of(self.task, self.real.facts, real, self.search_name)

    def tensors(self) -> dict[str, torch.Tensor]:
        """What a checkpoint must hold besides `state`."""
        return {
            f"{name}/{key}": value
            for name, part in self._changing().items()
            for key, value in part.tensors().items()
        }

    def state(self) -> dict[str, Any]:
        """JSON of all that changes, and of the keypoints."""
        states = {name: part.state() for name, part in self._changing().items()}
        return states | {"keypoints": self.keypoints.state()}

    def load(self, tensors: Mapping[str, torch.Tensor], state: Mapping[str, Any]) -> None:
        """Continue from a checkpoint, with whose keypoints this was built."""
        self.search.load(under("search/", tensors), state["search"])

    def _changing(self) -> dict[str, Any]:
        return {"search": self.search}


def build_experiment(
    config: TuneConfig,
    report: ReportProgress = silent,
    settings: Settings | None = None,
    task: AnyTask | None = None,
) -> Experiment:
    """What `tune` works with; `task`: the task that `config.task` names, if loaded already.

    A robot films into `config.out`; nothing else is written. Raises InputError for invalid input.
    """
    config.check()
    task, settings = task or load_any_task(config.task), settings or Settings()
    name = config.search
    if config.known_colour:
        task = with_known_colours(with_model(task), config.known_colour)
    if name != "posterior":
        task = with_one_square_camera(task)
    report("looking at the real world", 0.0)
    size = choose_image_size(config, task, name)
    device = choose_device(config.device)
    problem = build_problem(config, task, size, config.real_episodes, device)
    search = build_search(problem, name, settings)
    return Experiment(**vars(problem), settings=settings, search_name=name, search=search)


def build_problem(
    config: TuneConfig | TrainConfig,
    task: AnyTask,
    image_size: int,
    num_recorded: int | None,
    device: str,
    *,
    trained: Mapping[str, Any] | None = None,
) -> TuningProblem:
    """The real world that was asked for, with its first `num_recorded` episodes (None: a few).

    `tune` works with these. In a training, where a robot or a policy films later, they are read
    only from recordings. `trained`: state of a checkpoint to be loaded, which replaces a real world
    that a camera filmed. Raises InputError for invalid input.
    """
    tunes = isinstance(config, TuneConfig)
    if not trained:
        check_asked(config.out, outcome.asked(config, task))
    if trained and config.real != "pseudo":
        seen = observed(task, config.observed, is_simulated=False)
        real, truth = ClosedReal(trained["step_s"], seen), None
        start = task.parameters.nominal.copy()
    else:
        real, start, truth = choose_real(
            config, task, image_size, real_episodes=num_recorded, out=config.out
        )
    is_read = tunes or (num_recorded != 0 and isinstance(real, RecordedReal))
    recordings = real.collect(num_recorded) if is_read else []
    run_config, seen = outcome.run_config(config, task, start, real.facts, truth), real.observation
    state = trained or stored_state(config.out, run_config)  # of the run that resumes there
    simulator = _simulator_like(real, recordings, task, image_size, tunes, device)
    context = SearchContext(
        simulator=simulator,
        keypoints=keypoints_of_run(simulator, task, config.seed, state, seen if tunes else None),
        start=start,
        observation=seen,
        seed=config.seed,
        known=known_values(task, task.parameters),
        device=device,
    )
    return TuningProblem(
        config=config,
        run_config=run_config,
        task=task,
        real=real,
        recordings=recordings,
        truth=truth,
        context=context,
    )


def _simulator_like(
    real: RealWorld,
    recordings: list[Trajectory],
    task: AnyTask,
    image_size: int,
    tunes: bool,
    device: str,
) -> AnySimulator:
    """A simulator with the real world's step length, views and supersampling."""
    seen = real.observation
    films = [camera.footage for camera in seen.cameras]
    if not tunes and any(footage.background == "recording" for footage in films):
        raise InputError(
            'background = "recording" goes with `tune`: a policy is also trained where no '
            "recordings are; give it a picture by that camera, background = FILE"
        )
    widths = [view.width(image_size) for view in seen.views()]
    recorded = [apart(trajectory.frames, widths) for trajectory in recordings]
    plates = [
        footage.plate([parts[number] for parts in recorded], (image_size, widths[number]))
        for number, footage in enumerate(films)
    ]
    return task.simulator(
        image_size=image_size,
        step_s=real.step_s,
        supersampling=seen.supersampling,
        views=seen.views(plates),
        device=device,
    )


def build_search(problem: TuningProblem, name: SearchName, settings: Settings) -> Search:
    """The search with this name. Raises InputError if the recordings do not suit it."""
    if not problem.context.observation.cameras:
        search = _search_readings(problem, name)
    else:
        given = problem.config, name, problem.task, problem.recordings
        usual = choose_search_settings(*given, problem.simulator.image_size)
        search = make_search(name, problem.context, settings.search or usual)
    if problem.recordings:
        search.check(problem.recordings)
    return search


def _search_readings(problem: TuningProblem, name: SearchName) -> Search:
    if name != "posterior":
        raise InputError(f"--search {name} looks at pictures: have a camera observed")
    if not isinstance(problem.config, TuneConfig):
        raise InputError("a policy acts on pictures: have --observe name cameras too")
    shown = [p.name for p in problem.space if p.is_appearance]
    if shown and not problem.task.cameras:
        raise InputError(f"{shown[0]} shows in pictures only, and no camera is looked at")
    return ReadingsSearch(
        problem.context, ReadingsConfig(precision=problem.config.relative_precision)
    )
