"""What people would use instead of simtune, each a function find(Problem) → Found.

They look at the same pseudo-real videos, search the range that the posterior search begins with,
and may simulate as many policy steps and spend as much time. What they need beyond simtune:
pip install --group bench
"""

from dataclasses import dataclass

import numpy as np

from simtune.randomization import Distribution
from simtune.simulation import Simulator
from simtune.trajectory import Trajectory


@dataclass(frozen=True, kw_only=True)
class Problem:
    """What a baseline is given."""

    simulator: Simulator  # its num_steps counts the budget
    real: list[Trajectory]
    first: Distribution  # the range to search; its mean is the start
    budget_steps: int  # policy steps to simulate at most
    deadline_s: float  # of time.monotonic()
    seed: int
    true_states: np.ndarray | None = None  # (E, T + 1, S): privileged, for `sysid` only


@dataclass(frozen=True)
class Found:
    """Estimates by name: the parameters that a baseline can tell at all."""

    mean: dict[str, float]
    low: dict[str, float] | None = None  # of a 90 % interval, where it gives one
    high: dict[str, float] | None = None
