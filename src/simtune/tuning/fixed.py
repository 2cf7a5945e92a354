"""No search: Ξ stays as it is, for domain randomisation and the oracle (Sec. VI-A)."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

from simtune.budget import Budget
from simtune.randomization import Distribution
from simtune.trajectory import Trajectory
from simtune.tuning.estimate import unsure
from simtune.tuning.search import NO_CALLBACKS, Callbacks, Round, TimeNeeded


class FixedRange:
    """A `tuning.search.Search` that uses no data and moves nothing."""

    stop_reason = "nothing is searched for"

    def __init__(self, distribution: Distribution):
        self.distribution = distribution

    def check(self, real: list[Trajectory], names: Sequence[str] = ()) -> None:
        """Accepts anything."""

    def measure_time(self, real: list[Trajectory]) -> TimeNeeded:
        return TimeNeeded(0.0, 0.0)

    def run_round(
        self,
        real: list[Trajectory],
        budget: Budget,
        callbacks: Callbacks = NO_CALLBACKS,
    ) -> Round:
        return Round(unsure(self.distribution, "not identifiable"), [], {})

    def detect(self, frames: np.ndarray) -> None:
        return None

    def tensors(self) -> dict[str, torch.Tensor]:
        return {}

    def state(self) -> dict[str, Any]:
        return {}

    def load(self, tensors: dict[str, torch.Tensor], state: dict[str, Any]) -> None:
        """Nothing to restore."""
