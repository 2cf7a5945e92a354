"""The real world: a source of observations and actions, and nothing else."""

from collections.abc import Callable
from typing import Any, Protocol

from simtune.observation import ObservationModel
from simtune.simulation import PixelPolicy
from simtune.trajectory import Trajectory


def remembers_nothing() -> None:
    """Begins an episode of a policy that looks at the latest frames only."""


class RealWorld(Protocol):
    """Interface of the real system to tuning: no reward, no state, no parameters."""

    step_s: float  # duration of one action
    observation: ObservationModel  # what is observed, and how that differs from a simulator's

    @property
    def facts(self) -> dict[str, Any]:
        """Source of the data, for the run's records; JSON. Empty if nothing is known."""
        return {}

    def collect(self, num_episodes: int | None = None) -> list[Trajectory]:
        """Trajectories of `num_episodes` episodes; None: a few."""
        ...

    def run_policy(
        self,
        policy: PixelPolicy,
        num_stacked: int,
        num_episodes: int,
        seed: int,
        begin: Callable[[], None] = remembers_nothing,
    ) -> list[Trajectory]:
        """Trajectories of a policy that sees the latest frames; empty if it cannot act here.

        `seed`: of all that a simulated world draws; a robot draws nothing. `begin` is called before
        an episode, or several at once, for what the policy remembers.
        """
        return []


__all__ = ["RealWorld", "remembers_nothing"]
