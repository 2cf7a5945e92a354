"""Joint readings of whole episodes, and what fills their gaps."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import savgol_filter

from simtune.between_rows import read_between
from simtune.observation import JointSensor
from simtune.trajectory import Trajectory

# Readings to which a parabola is fitted for a velocity: more of them would smooth away how a robot
# starts to move from rest.
_SMOOTHED_ROWS = 3
_SLOPE = np.array([-1.5, 2.0, -0.5])  # change per row of a parabola through three, at the first
_EXTRAPOLATED_ROWS = 3


@dataclass(frozen=True)
class Readings:
    """Of E episodes; shorter ones are padded with NaN and their last action."""

    actions: np.ndarray  # (E, T, A)
    values: np.ndarray  # (E, T + 1, D) of all sensors side by side; NaN: not read

    @classmethod
    def of(cls, trajectories: Sequence[Trajectory], sensors: Sequence[JointSensor]) -> "Readings":
        steps = max(len(t) for t in trajectories)
        actions, values = [], []
        for trajectory in trajectories:
            missing = steps - len(trajectory)
            measured = np.hstack([trajectory.readings[sensor.name] for sensor in sensors])
            actions.append(np.pad(trajectory.actions, ((0, missing), (0, 0)), mode="edge"))
            values.append(np.pad(measured, ((0, missing), (0, 0)), constant_values=np.nan))
        return cls(np.stack(actions).astype(float), np.stack(values))

    def first(self, steps: int | None = None, episodes: int | None = None) -> "Readings":
        """The first `steps` steps of the first `episodes`; by default all."""
        rows = None if steps is None else steps + 1
        return Readings(self.actions[:episodes, :steps], self.values[:episodes, :rows])

    def delayed(self, steps: int) -> "Readings":
        """Actions beside the readings at which they take effect, `steps` later.

        The first `steps` readings are left out: nobody knows what acted before an episode. A servo
        was held, but a motor may have been off.
        """
        values = np.full_like(self.values, np.nan)
        kept = max(0, values.shape[1] - steps)
        values[:, :kept] = self.values[:, steps:]
        return Readings(self.actions, values)


def travel(values: np.ndarray) -> np.ndarray:
    """(E, D) how far readings (E, T, D) are apart; 0 where none are."""
    low, high = (np.where(np.isfinite(values), values, end) for end in (np.inf, -np.inf))
    return np.maximum(high.max(1) - low.min(1), 0.0)


def filled(values: np.ndarray) -> np.ndarray:
    """(E, T, D) with rows between readings filled on a curve through these.

    Long gaps are filled on a line; before a column's first reading and after its last, it rests.
    Without any reading, it is 0.
    """
    return _on_lines(_on_curves(values))


def moving_from_the_start(values: np.ndarray) -> np.ndarray:
    """(E, T, D) `filled`, but moving before a column's first reading as it does after it.

    There, rows go on as the parabola through its first three rows begins, if no long gap is among
    these. For a few rows: farther away, a parabola knows nothing.
    """
    curves = _on_curves(values)
    whole, known = _on_lines(curves), np.isfinite(curves)
    for episode, column in np.ndindex(len(values), values.shape[2]):
        line, begins = whole[episode, :, column], int(np.argmax(known[episode, :, column]))
        if known[episode, begins : begins + 3, column].sum() == 3:
            rows = np.minimum(np.arange(begins, 0, -1), _EXTRAPOLATED_ROWS)
            line[:begins] -= rows * (line[begins : begins + 3] @ _SLOPE)
    return whole


def _on_curves(values: np.ndarray) -> np.ndarray:
    """(E, T, D) as `read_between`: NaN in long gaps, and beyond the ends."""
    found, rows = values.copy(), np.arange(values.shape[1], dtype=float)
    for episode, column in np.ndindex(len(values), values.shape[2]):
        line = found[episode, :, column]
        unread = ~np.isfinite(line)
        if unread.any():
            line[unread] = read_between(rows, rows, line)[unread]
    return found


def _on_lines(values: np.ndarray) -> np.ndarray:
    """(E, T, D) without NaN, on lines between what is known; see `filled`."""
    found, rows = values.copy(), np.arange(values.shape[1])
    for episode, column in np.ndindex(len(values), values.shape[2]):
        line = found[episode, :, column]
        known = np.isfinite(line)
        line[~known] = np.interp(rows[~known], rows[known], line[known]) if known.any() else 0.0
    return found


def unread_rows(values: np.ndarray) -> np.ndarray:
    """(E,) most rows of (E, T, D) before a column's first reading; columns without any are none."""
    known = np.isfinite(values)
    return np.where(known.any(1), known.argmax(1), 0).max(1, initial=0)


def is_within(values: np.ndarray) -> np.ndarray:
    """(E, T, D) bool: between the first reading of an episode and its last, of each column."""
    known = np.isfinite(values)
    begun = np.logical_or.accumulate(known, 1)
    return begun & np.logical_or.accumulate(known[:, ::-1], 1)[:, ::-1]


def velocities(values: np.ndarray) -> np.ndarray:
    """(E, T, D) changes per step, from a parabola through neighbouring readings."""
    return parabolas(values, _SMOOTHED_ROWS, 1)


def parabolas(values: np.ndarray, width: int, order: int) -> np.ndarray:
    """(E, T, D) of parabolas through `width` neighbours; `order` 0: values, 1: changes per step.

    `width`: odd; fewer in shorter episodes.
    """
    width = min(width, values.shape[1] - (values.shape[1] + 1) % 2)
    return np.asarray(savgol_filter(values, width, min(2, width - 1), deriv=order, axis=1))
