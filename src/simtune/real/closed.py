"""The real world of a training that is over: it is left alone."""

from typing import Any

from simtune.observation import ObservationModel
from simtune.simulation import PixelPolicy
from simtune.trajectory import Trajectory


class ClosedReal:
    """How long its steps were, and that a camera filmed it; nothing can be asked of it."""

    observation = ObservationModel.of_reality()

    def __init__(self, step_s: float):
        self.step_s = step_s

    @property
    def facts(self) -> dict[str, Any]:
        """None."""
        return {}

    def collect(self, num_episodes: int | None = None) -> list[Trajectory]:
        """None: recordings may be gone, and no robot moves."""
        return []

    def run_policy(
        self, policy: PixelPolicy, num_stacked: int, num_episodes: int, seed: int
    ) -> list[Trajectory]:
        """None, likewise."""
        return []
