"""What a search gives: where the parameters are, how sure that is, where to search next."""

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
    """What a search makes of the real trajectories."""

    mean: np.ndarray  # (N,)
    low: np.ndarray  # (N,) lower end of the 90 % interval
    high: np.ndarray  # (N,)
    verdict: list[Verdict]  # one a parameter
    # {name: (candidates (C,), P(truth > candidate) (C,))}: survival curves, where there are any
    curves: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)
    # (N, N) of the errors on the parameters' own scales; None: nothing is known of it
    correlation: np.ndarray | None = None
    # {"a, b": correlation} of parameters that can hardly be distinguished
    correlations: dict[str, float] = field(default_factory=dict)
    # {name: ranks in (0, 1) of known worlds' truths}: uniform where intervals can be trusted
    ranks: dict[str, list[float]] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)  # what to doubt about all this
    # How well the episode is explained that was kept back, see `fit.held_out_misfit`
    held_out: dict[str, Any] = field(default_factory=dict)
    start: list[float] | None = None  # (S,) the state in which the first trajectory began, if known
    latency_steps: int = 0  # by which the actions seem to take effect late
    # Seconds by which pictures seem to come late besides, and the standard deviation of that
    pictures_late_s: tuple[float, float] = (0.0, 0.0)
    readings_late_s: tuple[float, float] = (0.0, 0.0)  # the same, of joint readings
    # {reading: measured − simulated, of what was fitted to readings alone}
    offsets: dict[str, float] = field(default_factory=dict)
    # Gain, gamma and offset of each camera, where a known colour tells them
    camera_responses: list[dict[str, Any]] = field(default_factory=list)


# Told of an estimate that a round has before it knows how far that can be trusted
TellEarly = Callable[[Estimate], None]


def tell_nobody(early: Estimate) -> None:
    """A `TellEarly`."""


# Called within a round, when much is learnt that a checkpoint would save
Keep = Callable[[], None]


def keep_nothing() -> None:
    """A `Keep`."""


def at_most_weak(verdicts: list[Verdict]) -> list[Verdict]:
    """None of them "identified"."""
    return ["weak" if verdict == "identified" else verdict for verdict in verdicts]


def unsure(distribution: Distribution, verdict: Verdict) -> Estimate:
    """An estimate that says no more than where is searched."""
    verdicts: list[Verdict] = [verdict] * len(distribution.space)
    return Estimate(distribution.mean, distribution.low, distribution.high, verdicts)


@dataclass(frozen=True)
class Event:
    """Something that happened to the range in which a parameter is searched."""

    event: str  # "widened", "narrowed", "moved", ...
    parameter: str
    low: float  # the range now
    high: float
    reason: str


class Round(NamedTuple):
    """What a round of a search gives."""

    estimate: Estimate
    events: list[Event]
    metrics: dict[str, float]  # to be logged; the same keys in every round


@dataclass(frozen=True, kw_only=True)
class SearchContext:
    """What a search is made of, whichever it is."""

    simulator: AnySimulator
    keypoints: Keypoints | Points  # chosen once a run, so that all mean the same by keypoint k
    start: np.ndarray  # (N,) parameters where the search begins
    observation: ObservationModel  # the real world's own
    seed: int
    # (N,) values of parameters that are known, NaN of all others; None: none is
    known: np.ndarray | None = None
    device: str = "cpu"  # of the paper's networks


class Search(Protocol):
    """Moves Ξ towards the real system, from frames and actions alone."""

    distribution: Distribution  # Ξ now; `distribution.mean` is ξ_mean

    @property
    def stop_reason(self) -> str:
        """Why nothing is left to gain; empty while there is."""
        ...

    def needed_s(self, real: list[Trajectory]) -> tuple[float, float]:
        """Seconds that the smallest sound round takes on this machine, and those of a whole one."""
        ...

    def check(self, real: list[Trajectory]) -> None:
        """Raises InputError for trajectories that cannot be looked at, e.g. too short ones."""
        ...

    def run_round(
        self,
        real: list[Trajectory],
        budget: Budget,
        tell_early: TellEarly = tell_nobody,
        keep: Keep = keep_nothing,
    ) -> Round:
        """Simulate in Ξ, train, ask the real trajectories, move Ξ: once.

        `budget` is that of all rounds that are still to come, not to be overrun by much.
        `tell_early` hears of an estimate that is there long before the round ends, if there is one.
        `keep` is called where `state` and `tensors` hold what a round begun anew would go on with.
        """
        ...

    def detect(self, frames: np.ndarray) -> Detections | None:
        """Keypoints in (n, H, W, 3) frames; None where the search has no eye for them."""
        ...

    def tensors(self) -> dict[str, torch.Tensor]:
        """What a checkpoint has to hold besides `state`."""
        ...

    def state(self) -> dict[str, Any]:
        """JSON."""
        ...

    def load(self, tensors: dict[str, torch.Tensor], state: dict[str, Any]) -> None:
        """Go on from a checkpoint as if there had been no break."""
        ...
