"""No search at all: Ξ stays where it is, as for domain randomisation and the oracle (Sec. VI-A)."""

from typing import Any

import torch

from simtune.randomization import Distribution
from simtune.trajectory import Trajectory
from simtune.tuning.search import Estimate, Event, unsure


class FixedRange:
    """A `tuning.search.Search` that looks at nothing and moves nothing."""

    finished = True

    def __init__(self, distribution: Distribution):
        self.distribution = distribution

    def check(self, real: list[Trajectory]) -> None:
        """Anything will do."""

    def iterate(
        self, real: list[Trajectory], deadline_s: float
    ) -> tuple[Estimate, list[Event], dict[str, float]]:
        return unsure(self.distribution, "not identifiable"), [], {}

    def tensors(self) -> dict[str, torch.Tensor]:
        return {}

    def state(self) -> dict[str, Any]:
        return {}

    def load(self, tensors: dict[str, torch.Tensor], state: dict[str, Any]) -> None:
        """There is nothing to go on with."""
