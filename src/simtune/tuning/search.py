"""The interface of searches: estimates, events, and what a search is given."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
import torch

from simtune.budget import Budget
from simtune.observation import ObservationModel
from simtune.randomization import Distribution
from simtune.simulation import AnySimulator, Points
from simtune.trajectory import Trajectory
from simtune.vision.detector import Detections
from simtune.vision.keypoints import Keypoints

Verdict = Literal["identified", "weak", "not identifiable"]


@dataclass(frozen=True)
class Estimate:
    """What a search concludes from the real trajectories."""

    mean: np.ndarray  # (N,)
    low: np.ndarray  # (N,) lower end of the 90 % interval
    high: np.ndarray  # (N,)
    verdict: list[Verdict]  # one per parameter
    # {name: (candidates (C,), P(truth > candidate) (C,))}: survival curves, if any
    curves: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    # (N, N) of the errors on the parameters' own scales; None: unknown
    correlation: np.ndarray | None = None
    # {"a, b": correlation} of parameters that can hardly be separated
    correlations: dict[str, float] = field(default_factory=dict)
    # {name: ranks in (0, 1) of known worlds' truths}: uniform if intervals hold
    ranks: dict[str, list[float]] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)  # reasons for doubt
    # How well the held-out episode is explained, see `fit.held_out_misfit`
    held_out: dict[str, Any] = field(default_factory=dict)
    start: list[float] | None = None  # (S,) initial state of the first trajectory, if known
    latency_steps: int = 0  # estimated delay of the actions
    # Seconds by which pictures seem to be late as well, and the standard deviation
    pictures_late_s: tuple[float, float] = (0.0, 0.0)
    readings_late_s: tuple[float, float] = (0.0, 0.0)  # the same, for joint readings
    # {reading: measured − simulated}, if offsets are unknown
    offsets: dict[str, float] = field(default_factory=dict)
    # Gain, gamma and offset of each camera, if a known colour informs them
    camera_responses: list[dict[str, Any]] = field(default_factory=list)


# Receives an estimate before the round knows how far to trust it
TellEarly = Callable[[Estimate], None]


def tell_nobody(early: Estimate) -> None:
    """A `TellEarly` that does nothing."""


# Called within a round, when a checkpoint would save much that was learnt
Keep = Callable[[], None]


def keep_nothing() -> None:
    """A `Keep` that does nothing."""


def at_most_weak(verdicts: list[Verdict]) -> list[Verdict]:
    """The verdicts, with "identified" replaced by "weak"."""
    return ["weak" if verdict == "identified" else verdict for verdict in verdicts]


def unsure(distribution: Distribution, verdict: Verdict) -> Estimate:
    """An estimate that only repeats the range."""
    verdicts: list[Verdict] = [verdict] * len(distribution.space)
    return Estimate(distribution.mean, distribution.low, distribution.high, verdicts)


@dataclass(frozen=True)
class Event:
    """A change of the range in which a parameter is searched."""

    event: str  # "widened", "narrowed", "moved", ...
    parameter: str
    low: float  # of the new range
    high: float
    reason: str


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
    device: str = "cpu"  # of the paper's networks


class Search(Protocol):
    """Moves Ξ towards the real system, from frames and actions alone."""

    distribution: Distribution  # Ξ now; `distribution.mean` is ξ_mean

    @property
    def stop_reason(self) -> str:
        """Why another round would gain nothing; empty while it would."""
        ...

    def needed_s(self, real: list[Trajectory]) -> tuple[float, float]:
        """Seconds of the smallest sound round on this machine, and of a whole one."""
        ...

    def check(self, real: list[Trajectory]) -> None:
        """Raises InputError for trajectories that cannot be used, e.g. too short ones."""
        ...

    def run_round(
        self,
        real: list[Trajectory],
        budget: Budget,
        tell_early: TellEarly = tell_nobody,
        keep: Keep = keep_nothing,
    ) -> Round:
        """Simulate in Ξ, train, evaluate the real trajectories, move Ξ: once.

        `budget` is for all rounds to come, and must not be exceeded by much. `tell_early` gets an
        estimate that is available long before the round ends, if there is one. `keep` is called
        when `state` and `tensors` hold what a restarted round would continue from.
        """
        ...

    def detect(self, frames: np.ndarray) -> Detections | None:
        """Keypoints in (n, H, W, 3) frames; None if the search has no detector."""
        ...

    def tensors(self) -> dict[str, torch.Tensor]:
        """What a checkpoint must hold besides `state`."""
        ...

    def state(self) -> dict[str, Any]:
        """JSON."""
        ...

    def load(self, tensors: dict[str, torch.Tensor], state: dict[str, Any]) -> None:
        """Continue from a checkpoint as if there had been no break."""
        ...
