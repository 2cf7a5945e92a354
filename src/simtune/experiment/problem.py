"""What there is to tune: a real world, and the simulator that shall become like it."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from simtune.cameras.views import apart
from simtune.config import TrainConfig, TuneConfig
from simtune.errors import InputError
from simtune.experiment import outcome
from simtune.experiment.keypoints import keypoints_of_run
from simtune.parameters import ParameterSpace
from simtune.real import RealWorld
from simtune.real.choose import ChosenReal, choose_real
from simtune.real.observed import observed
from simtune.real.recorded import ClosedReal, RecordedReal
from simtune.real.truth import Truth
from simtune.run.config import check_asked
from simtune.run.kept import stored_state
from simtune.simulation import AnySimulator, Points
from simtune.tasks import AnyTask, known_values
from simtune.trajectory import Trajectory
from simtune.tuning.search import SearchContext
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
    real, start, truth = _real_world(config, task, image_size, num_recorded, trained)
    is_read = tunes or (num_recorded != 0 and isinstance(real, RecordedReal))
    recordings = real.collect(num_recorded) if is_read else []
    run_config, seen = outcome.run_config(config, task, start, real.facts, truth), real.observation
    state = trained or stored_state(config.out, run_config)  # of the run that resumes there
    simulator = _simulator_like(real, recordings, task, image_size, tunes, device)
    _check_shapes(recordings, simulator)
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


def _check_shapes(recordings: list[Trajectory], simulator: AnySimulator) -> None:
    """Raises InputError for pictures of another shape than the simulator's."""
    height, width = simulator.shape
    for its_height, its_width in [t.frames.shape[1:3] for t in recordings if t.has_pictures]:
        if (its_height, its_width) != (height, width):  # else known after minutes of training
            raise InputError(
                f"the real pictures come as {its_width}×{its_height}, and the simulator draws "
                f"{width}×{height}: crop the recordings to what its camera shows"
            )


def _real_world(
    config: TuneConfig | TrainConfig,
    task: AnyTask,
    image_size: int,
    num_recorded: int | None,
    trained: Mapping[str, Any] | None,
) -> ChosenReal:
    """What was asked for; what a camera filmed for a checkpoint `trained` is not filmed again."""
    if not trained or config.real == "pseudo":
        return choose_real(config, task, image_size, real_episodes=num_recorded, out=config.out)
    seen = observed(task, config.observed, is_simulated=False)
    return ChosenReal(ClosedReal(trained["step_s"], seen), task.parameters.nominal.copy(), None)


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
