"""The real world: it gives frames and actions, and nothing else."""

from typing import Any, Protocol

from simtune.observation import ObservationModel
from simtune.simulation import PixelPolicy
from simtune.trajectory import Trajectory


class RealWorld(Protocol):
    """What tuning may ask of the real system: no reward, no state, no parameters."""

    step_s: float  # for which an action is applied
    observation: ObservationModel  # what is seen of it, and how that differs from a simulator's

    @property
    def facts(self) -> dict[str, Any]:
        """What to note down of where its pictures come from; JSON. Empty where nothing is known."""
        return {}

    def collect(self, num_episodes: int | None = None) -> list[Trajectory]:
        """Trajectories of `num_episodes` episodes; None: of a few."""
        ...

    def run_policy(
        self, policy: PixelPolicy, num_stacked: int, num_episodes: int, seed: int
    ) -> list[Trajectory]:
        """Trajectories of a policy that sees the latest frames; none where it cannot act."""
        return []


__all__ = ["RealWorld"]
