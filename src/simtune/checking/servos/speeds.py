"""How fast joints move, by encoders of positions, beside commands that are speeds."""

import math
from collections.abc import Sequence

import numpy as np

from simtune.between_rows import read_between
from simtune.checking.servos.following import Watched
from simtune.checking.servos.roughness import roughness

_MAX_SPEED_ERROR = 0.1  # of what is commanded
_MAX_MEAN_S = 0.5  # over which speeds are averaged


def beside_speeds(joints: Sequence[Watched]) -> list[Watched]:
    """Joints whose commands are speeds and whose `measured` are positions, both as speeds.

    Speeds and commands are means over as many steps as the roughest encoder of them needs.
    """
    half = max((_half_window(joint) for joint in joints), default=1)
    return [
        joint._replace(
            unit=f"{joint.unit}/s",
            commands=[_mean(c, half) for c in joint.commands],
            measured=[_speed(read, half) / joint.step_s for read in joint.measured],
            positions=joint.measured,
        )
        for joint in joints
    ]


def _half_window(joint: Watched) -> int:
    """Steps to both sides; of white noise s, a speed over 2 h steps has √2 s / (2 h · step)."""
    commanded, step_s = float(np.ptp(np.concatenate(list(joint.commands)))), joint.step_s
    noise = roughness(joint.measured)
    if not commanded > 0 or not np.isfinite(noise):
        return 1
    needed = math.ceil(noise / (math.sqrt(2) * step_s * _MAX_SPEED_ERROR * commanded))
    longest = max(1, math.floor(_MAX_MEAN_S / (2 * step_s)))
    return min(max(1, needed), longest)


def _speed(read: np.ndarray, half: int) -> np.ndarray:
    """(T + 1,) changes per step from `half` steps before to as many after; NaN at the ends.

    An encoder may be slower than rows: between two of its readings it goes on smoothly.
    """
    found, rows = np.full(len(read), np.nan), np.arange(len(read))
    read = read_between(rows, rows, read)
    if len(read) > 2 * half:
        found[half:-half] = (read[2 * half :] - read[: -2 * half]) / (2 * half)
    return found


def _mean(command: np.ndarray, half: int) -> np.ndarray:
    """(T,) means over the same steps of a command that is interpolated linearly."""
    weights = np.ones(2 * half + 1)
    weights[[0, -1]] = 0.5
    return np.convolve(np.pad(command, half, mode="edge"), weights / (2 * half), mode="valid")
