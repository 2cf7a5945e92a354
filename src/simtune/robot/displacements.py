"""A task's actions as displacements of a robot, each along an axis."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from simtune.errors import RobotError


@dataclass(frozen=True)
class Displacements:
    """Actions displace the robot from its measured position, like `MocapActions` in simulation.

    Along axes that no action moves, the robot stays at the start position.
    """

    axes: np.ndarray  # (A,) index of the axis, of D, that each action moves
    per_unit: np.ndarray  # (A,) signed displacement by an action of 1, units
    range: np.ndarray  # (A, 2) lowest and highest action
    start: np.ndarray  # (D,)

    @classmethod
    def of(
        cls,
        moved: Sequence[str],
        step: float,
        range_: np.ndarray,
        axes: Sequence[str],
        start: Sequence[float],
    ) -> "Displacements":
        """`moved`: the axis of each action, with a minus sign if the directions are opposite."""
        names = [name.removeprefix("-") for name in moved]
        signs = [-1.0 if name.startswith("-") else 1.0 for name in moved]
        return cls(
            axes=np.array([list(axes).index(name) for name in names]),
            per_unit=step * np.array(signs),
            range=np.asarray(range_, float),
            start=np.asarray(start, float),
        )

    def target(self, action: np.ndarray, measured: np.ndarray) -> np.ndarray:
        """The target position (D,) of an action (A,), which is clipped to its range.

        Raises RobotError for an action that is not finite numbers (A,).
        """
        action = np.asarray(action)
        if action.shape != self.axes.shape or action.dtype.kind not in "fiu":
            raise RobotError(
                f"an action must be {len(self.axes)} numbers, got {action.dtype} {action.shape}"
            )
        if not np.isfinite(action).all():
            raise RobotError(f"an action must be finite, got {action.tolist()}")
        target = self.start.copy()
        wanted = np.clip(action.astype(float), *self.range.T)
        target[self.axes] = measured[self.axes] + self.per_unit * wanted
        return target

    def action(self, target: np.ndarray, measured: np.ndarray) -> np.ndarray:
        """The action (A,) float32 whose target is this position; the inverse of `target`."""
        return ((target - measured)[self.axes] / self.per_unit).astype(np.float32)
