"""What `tune` works with: a tuning problem, and the search for its solution."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch

from simtune.checking.film.of_episodes import film_warnings
from simtune.checking.image_size import choose_image_size
from simtune.checking.recording_warnings import trajectory_warnings
from simtune.checking.replays import RecordedReplays
from simtune.config import TuneConfig
from simtune.devices import choose_device
from simtune.errors import InputError
from simtune.experiment.problem import TuningProblem, build_problem
from simtune.experiment.search_settings import choose_search_settings, make_search
from simtune.experiment.settings import Settings
from simtune.names import SEARCHES, SearchName
from simtune.networks.layers import under
from simtune.progress import ReportProgress, silent
from simtune.simulation import Simulator
from simtune.tasks import (
    AnyTask,
    load_any_task,
    with_known_colours,
    with_model,
    with_one_square_camera,
)
from simtune.trajectory import Trajectory
from simtune.tuning.readings.search import ReadingsSearch
from simtune.tuning.search import Search


@dataclass(frozen=True, kw_only=True)
class Experiment(TuningProblem):
    """What `tune` works with; `TrainingExperiment` adds what learns to act."""

    settings: Settings
    search_name: SearchName | None  # None: no search
    search: Search

    def warnings(self, real: list[Trajectory]) -> list[str]:
        """Possible problems of recordings; none are known for other real episodes."""
        facts, simulator, seen = self.real.facts, self.simulator, self.context.observation
        found = trajectory_warnings(self.task, facts, real, self.search_name)
        is_recorded = "cameras" in facts and bool(seen.sensors)
        if is_recorded and isinstance(simulator, Simulator):
            found += RecordedReplays(simulator, seen, real, facts["names"]).start_warnings()
        return found

    def film_warnings(self) -> list[str]:
        """Where recorded films cannot show the simulator's scene; none for other episodes."""
        facts, simulator, seen = self.real.facts, self.simulator, self.context.observation
        are_filmed = self.recordings and facts.get("cameras")
        if not are_filmed or not isinstance(simulator, Simulator):
            return []
        names, seed = facts["names"], self.config.seed
        return film_warnings(simulator, seen, self.recordings, names, seed)

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
    if SEARCHES[name].needs_square_pictures:
        task = with_one_square_camera(task)
    report("looking at the real world", 0.0)
    size = choose_image_size(config, task, name)
    device = choose_device(config.device)
    problem = build_problem(config, task, size, config.real_episodes, device)
    search = build_search(problem, name, settings)
    return Experiment(**vars(problem), settings=settings, search_name=name, search=search)


def build_search(problem: TuningProblem, name: SearchName, settings: Settings) -> Search:
    """The search with this name. Raises InputError if the recordings do not suit it."""
    if not problem.context.observation.cameras:
        search = _search_readings(problem, name)
    else:
        usual = choose_search_settings(
            problem.config,
            name,
            problem.task,
            problem.recordings,
            problem.simulator.image_size,
        )
        search = make_search(name, problem.context, settings.search or usual)
    if problem.recordings:
        search.check(problem.recordings, problem.real.facts.get("names", ()))
    return search


def _search_readings(problem: TuningProblem, name: SearchName) -> Search:
    if not SEARCHES[name].takes_readings:
        raise InputError(f"--search {name} looks at pictures: have a camera observed")
    if not isinstance(problem.config, TuneConfig):
        raise InputError("a policy acts on pictures: have --observe name cameras too")
    shown = [p.name for p in problem.space if p.is_appearance]
    if shown and not problem.task.cameras:
        raise InputError(f"{shown[0]} shows in pictures only, and no camera is looked at")
    return ReadingsSearch(problem.context, problem.config.relative_precision)
