"""What a run is made of: the task, the real world, the simulator, the search."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from simtune import outcome
from simtune.check.recording_warnings import warnings_of
from simtune.config import RealConfig, TrainConfig, TuneConfig
from simtune.experiment.settings import Settings
from simtune.names import SearchName
from simtune.networks import under
from simtune.parameters import ParameterSpace
from simtune.progress import ReportProgress, silent
from simtune.randomization import Distribution
from simtune.real import RealWorld
from simtune.real.choose import choose_real, simulator_for
from simtune.real.truth import Truth
from simtune.run.folder import stored_state
from simtune.search_param_model.paper import PaperConfig
from simtune.simulation import AnySimulator, Points
from simtune.tasks import AnyTask, load_any_task
from simtune.trajectory import Trajectory
from simtune.tuning import SearchContext, make_search, needed_image_size
from simtune.tuning.search import Search
from simtune.vision.keypoints import Keypoints, find_keypoints


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """What `tune` works with; `TrainingExperiment` adds what learns to act."""

    config: TuneConfig | TrainConfig
    settings: Settings
    run_config: dict[str, Any]  # what config.json remembers: only the same goes on
    task: AnyTask
    real: RealWorld
    recordings: list[Trajectory]  # the real episodes that are there before the run begins
    truth: Truth | None  # of a pseudo-real world: it scores, and the oracle lives in it
    context: SearchContext
    search_name: SearchName | None  # None: nothing is searched for
    search: Search

    @property
    def space(self) -> ParameterSpace:
        return self.task.parameters

    @property
    def start(self) -> np.ndarray:
        """(N,) parameters where the search begins."""
        return self.context.start

    @property
    def simulator(self) -> AnySimulator:
        return self.context.simulator

    @property
    def keypoints(self) -> Keypoints | Points:
        """Chosen once a run: search, environment and agent mean the same by keypoint k."""
        return self.context.keypoints

    def warnings(self, real: list[Trajectory]) -> list[str]:
        """What may be wrong with recordings; of other real episodes nothing is known."""
        return warnings_of(self.task, self.real.facts, real, self.search_name)

    def tensors(self) -> dict[str, torch.Tensor]:
        """What a checkpoint has to hold besides `state`."""
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
        """Go on from a checkpoint; the keypoints are as it has them since this was built."""
        self.search.load(under("search/", tensors), state["search"])

    def _changing(self) -> dict[str, Any]:
        return {"search": self.search}


def build_experiment(
    config: TuneConfig, report: ReportProgress = silent, settings: Settings | None = None
) -> Experiment:
    """What `tune` works with.

    Raises InputError for what cannot be used; a robot films into `config.out`, and nothing else
    is written.
    """
    config.check()
    task, settings = load_any_task(config.task), settings or Settings()
    image_size = needed_image_size(config.search)
    report("looking at the real world", 0.0)
    real, start, truth = choose_real(
        config,
        task,
        image_size,
        real_episodes=config.real_episodes,
        real_gap=config.real_gap,
        out=config.out,
    )
    recordings = real.collect(config.real_episodes)
    run_config = outcome.run_config(config, task, start, real.facts, truth)
    keypoints = stored_keypoints(config.out, run_config)
    context = build_context(config, task, real, start, image_size, keypoints=keypoints)
    search = make_search(
        config.search, context, settings.search or _search_settings(config.search, recordings)
    )
    search.check(recordings)
    return Experiment(
        config=config,
        settings=settings,
        run_config=run_config,
        task=task,
        real=real,
        recordings=recordings,
        truth=truth,
        context=context,
        search_name=config.search,
        search=search,
    )


def stored_keypoints(out: Path, run_config: Mapping[str, Any]) -> list | None:
    """Those of the run that goes on in `out`; None where none does.

    Raises InputError where another run, or something else, lies there.
    """
    state = stored_state(out, run_config)
    return None if state is None else state["keypoints"]


def build_context(
    config: RealConfig,
    task: AnyTask,
    real: RealWorld,
    start: np.ndarray,
    image_size: int,
    *,
    device: str = "cpu",
    keypoints: list | None = None,
) -> SearchContext:
    """The simulator of a real world, and where in it a search begins.

    `keypoints`: the state of those that the run was begun with. Another machine may choose
    others, by which networks that were trained on these would be read wrongly.
    """
    simulator = simulator_for(real, task, image_size)
    first = Distribution.first(task.parameters, task.parameters.nominal)
    found = find_keypoints(simulator, task.camera, first, config.seed)
    return SearchContext(
        simulator=simulator,
        camera=task.camera,
        keypoints=found if keypoints is None else found.with_state(keypoints),
        start=start,
        observation=real.observation,
        seed=config.seed,
        device=device,
    )


def _search_settings(search: SearchName, real: list[Trajectory]) -> PaperConfig | None:
    """None: the usual ones."""
    if search == "posterior":
        return None
    # Simulated episodes need not be longer than the real ones.
    return PaperConfig(episode_steps=min((PaperConfig.episode_steps, *map(len, real))))
