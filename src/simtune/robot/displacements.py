"""What a task's actions do to a robot: each displaces it along an axis."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from simtune.errors import RobotError


@dataclass(frozen=True)
class Displacements:
    """An action displaces from where the robot really is, as `MocapActions` does in simulation.

    Along axes that no action moves, the robot stays where episodes start.
    """

    axes: np.ndarray  # (A,) which of the robot's D axes each action moves
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
        """`moved`: the axis of each action, with a minus where they point against each other."""
        names = [name.removeprefix("-") for name in moved]
        signs = [-1.0 if name.startswith("-") else 1.0 for name in moved]
        return cls(
            axes=np.array([list(axes).index(name) for name in names]),
            per_unit=step * np.array(signs),
            range=np.asarray(range_, float),
            start=np.asarray(start, float),
        )

    def target(self, action: np.ndarray, measured: np.ndarray) -> np.ndarray:
        """The (D,) place that an action (A,) asks for; beyond its range it is cut off.

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
        """(A,) float32: the action that asks for just this place; the inverse of `target`."""
        return ((target - measured)[self.axes] / self.per_unit).astype(np.float32)
