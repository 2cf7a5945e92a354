"""What a search concludes from the real trajectories."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

import simtune
from simtune.errors import InputError
from simtune.randomization import Distribution
from simtune.verdicts import Verdict

_ARRAYS = ("mean", "low", "high")
_WRITER = "simtune"  # key of the version in a checkpoint


@dataclass(frozen=True)
class Estimate:
    """Parameters, how sure they are, and what else a search tells."""

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

    def late_steps(self, step_s: float) -> float:
        """By how many steps a policy's actions show late in pictures."""
        return self.latency_steps + self.pictures_late_s[0] / step_s

    def to_json(self) -> dict[str, Any]:
        """As a checkpoint holds it, with the version that wrote it."""
        arrays = {key: getattr(self, key).tolist() for key in _ARRAYS}
        curves = {name: (c.tolist(), p.tolist()) for name, (c, p) in self.curves.items()}
        correlation = None if self.correlation is None else self.correlation.tolist()
        own = {**vars(self), **arrays, "curves": curves, "correlation": correlation}
        return own | {_WRITER: simtune.__version__}

    @classmethod
    def from_json(cls, saved: Mapping[str, Any]) -> "Estimate":
        """The inverse of `to_json`. Raises InputError for other fields, of another version."""
        saved = dict(saved)
        writer = saved.pop(_WRITER, "(an older version)")
        known = {each.name for each in fields(cls)}
        needed = {each.name for each in fields(cls) if each.default is each.default_factory}
        others = (saved.keys() - known) | (needed - saved.keys())
        refuse_other_fields(f"estimate is of simtune {writer}", others)
        arrays = {key: np.array(saved[key]) for key in _ARRAYS}
        curves = {name: (np.array(c), np.array(p)) for name, (c, p) in saved["curves"].items()}
        matrix = saved["correlation"]
        correlation = None if matrix is None else np.array(matrix)
        return cls(**{**saved, **arrays, "curves": curves, "correlation": correlation})


def refuse_other_fields(whose: str, others: Collection[str]) -> None:
    """Raises InputError if a checkpoint's part lacks fields or has `others`.

    `whose`: what part, and of which version, as the subject of a sentence.
    """
    if others:
        raise InputError(
            f"the checkpoint's {whose}, and simtune {simtune.__version__} has other fields "
            f"({', '.join(sorted(others))}): go on with the former version, or start anew"
        )


def unsure(distribution: Distribution, verdict: Verdict) -> Estimate:
    """An estimate that only repeats the range."""
    verdicts: list[Verdict] = [verdict] * len(distribution.space)
    return Estimate(distribution.mean, distribution.low, distribution.high, verdicts)
