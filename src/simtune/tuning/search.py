"""The interface of searches: what a search is given, and what a round returns."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
import torch

from simtune.budget import Budget
from simtune.observation import ObservationModel
from simtune.randomization import Distribution
from simtune.simulation import AnySimulator, Points
from simtune.trajectory import Trajectory
from simtune.tuning.estimate import Estimate
from simtune.vision.detections import Detections
from simtune.vision.keypoints import Keypoints


@dataclass(frozen=True)
class Event:
    """A change of the range in which a parameter is searched."""

    event: str  # "widened", "narrowed", "moved", ...
    parameter: str
    low: float  # of the new range
    high: float
    reason: str


class TimeNeeded(NamedTuple):
    """Approximate seconds of a search's rounds on this machine, under its present load."""

    least_s: float  # of the smallest sound round
    whole_s: float
    check_s: float = 0.0  # of what `simtune check` would say
    mostly: str = ""  # what takes most of the smallest one, and what would help
    first_s: float = 0.0  # of what comes before the first round, at most half of all time


@dataclass(frozen=True)
class Callbacks:
    """What a round calls before it ends."""

    # With an estimate, as soon as there is one, before the round knows how far to trust it
    report_early: Callable[[Estimate], None] = lambda early: None
    # When `state` and `tensors` hold what a restarted round would continue from
    save: Callable[[], None] = lambda: None


NO_CALLBACKS = Callbacks()


class Round(NamedTuple):
    """Result of one round of a search."""

    estimate: Estimate
    events: list[Event]
    metrics: dict[str, float]  # to be logged; the same keys in every round


@dataclass(frozen=True, kw_only=True)
class SearchContext:
    """What any search is made from."""

    simulator: AnySimulator
    keypoints: Keypoints | Points  # chosen once per run, so that keypoint k always means the same
    start: np.ndarray  # (N,) initial parameters
    observation: ObservationModel  # of the real world
    seed: int
    # (N,) values of known parameters, NaN for all others; None: no parameter is known
    known: np.ndarray | None = None
    device: str = "cpu"  # of networks

    @property
    def first(self) -> Distribution:
        """The range that is searched first."""
        return Distribution.first(self.simulator.space, self.start)

    @property
    def can_fit(self) -> bool:
        """Whether worlds can start in any state, as environments may not, and something moves."""
        anywhere, keypoints = self.simulator.can_start_anywhere, self.keypoints
        return anywhere and isinstance(keypoints, Keypoints) and len(keypoints) > 0


class Search(Protocol):
    """Moves Ξ towards the real system, from frames and actions alone.

    By default it accepts all episodes, takes no time worth measuring, and has nothing to save.
    """

    distribution: Distribution  # Ξ now; `distribution.mean` is ξ_mean

    @property
    def stop_reason(self) -> str:
        """Why another round would gain nothing; empty while it would."""
        ...

    def measure_time(self, real: list[Trajectory]) -> TimeNeeded:
        """How long rounds with these episodes would take, which `run_round` will keep in mind.

        A measurement of a second or two.
        """
        return TimeNeeded(0.0, 0.0)

    def check(self, real: list[Trajectory], names: Sequence[str] = ()) -> None:
        """Raises InputError for trajectories that cannot be used, e.g. too short ones.

        `names`: what recordings call them.
        """

    def run_round(
        self,
        real: list[Trajectory],
        budget: Budget,
        callbacks: Callbacks = NO_CALLBACKS,
    ) -> Round:
        """Simulate in Ξ, train, evaluate the real trajectories, move Ξ: once.

        `budget` is for all rounds to come, and must not be exceeded by much.
        """
        ...

    def detect(self, frames: np.ndarray) -> Detections | None:
        """Keypoints in (n, H, W, 3) frames; None if the search has no detector."""
        return None

    def tensors(self) -> dict[str, torch.Tensor]:
        """What a checkpoint must hold besides `state`."""
        return {}

    def state(self) -> dict[str, Any]:
        """JSON."""
        return {}

    def load(self, tensors: dict[str, torch.Tensor], state: dict[str, Any]) -> None:
        """Continue from a checkpoint as if there had been no break."""
