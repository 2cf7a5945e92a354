"""How well readings could identify parameters at best: Fisher information of what they show."""

import math
from collections.abc import Sequence

import numpy as np

from simtune.budget import Budget
from simtune.fit.readings.differences import DifferencePoint, differentiate
from simtune.fit.readings.normal_equations import by_shared, normal_equations
from simtune.fit.readings.open_loop import OpenLoopReplay
from simtune.fit.readings.segments import Stretches
from simtune.fit.readings.slopes import StretchSlopes
from simtune.fit.readings.weak_directions import MOST_WORLDS, sharpened
from simtune.observation import assumed_noise, finds_offset

_LONG_S = 5.0
_ASKING_SHARE = 0.6  # of the time that is left, before it is asked how errors grow
_ASKING = "asking how well the best fit could tell"
_NOT_ASKED = (
    "there was time to ask {} of {} parts of episodes how well the best fit to readings could "
    "tell; the others are assumed to tell as much"
)


def affordable(
    loop: OpenLoopReplay, told: Stretches, step_s: float, budget: Budget
) -> tuple[Stretches, list[str]]:
    """Of stretches to derive in, as many as there is time for, one at least; what is said then.

    `step_s`: seconds of a step of one world.
    """
    num, worlds = len(told.states), 1 + 2 * len(loop.physics.parameters) + MOST_WORLDS
    worlds += len(loop.measured.start_tangents)
    needed_s = worlds * num_frames(told) * step_s
    fits = _ASKING_SHARE * budget.seconds_left / max(needed_s, 1e-9)
    few = num if fits >= 1 else max(1, math.floor(fits * num))
    budget.report(f"{_ASKING}{_about(needed_s * few / num)}", 0.5)
    if few == num:
        return told, []
    # What one leads to is where the next one of its episode begins
    chosen = np.arange(num) < few
    if not told.goes_on:
        chosen = np.isin(np.arange(num), np.linspace(0, num - 1, few).astype(int))
    return told.of(chosen), [_NOT_ASKED.format(few, num)]


def information(
    loop: OpenLoopReplay, unit: np.ndarray, stretches: Stretches, noises: Sequence[np.ndarray]
) -> np.ndarray:
    """(K, N, N) Fisher information for K noises (D,), of parameters in unit coordinates.

    In a world of these, (N,), or with a lateness as the last. Offsets, lateness and initial states
    are marginalised.
    """
    num = len(loop.physics.parameters)
    start_std = loop.measured.start_std(assumed_noise(loop.sensors), stretches)
    at = DifferencePoint(stretches, stretches.states, unit, start_std)
    nothing_left = 0 * stretches.values  # NaN where nothing was read
    offsets = finds_offset(loop.sensors)
    by_start = loop.starts_by_shared(stretches, offsets) / start_std

    def told(slopes: StretchSlopes, noise: np.ndarray) -> np.ndarray:
        shared = by_shared(slopes, offsets, by_start)
        equations = normal_equations(slopes.by_start, shared, nothing_left, noise)
        return equations.information.sum(0)

    slopes = differentiate(loop, at)
    slopes = sharpened(loop, at, slopes, told(slopes, noises[-1]))
    found = []
    for noise in noises:
        total = told(slopes, noise)
        mixed, others = total[:num, num:], total[num:, num:]
        found.append(total[:num, :num] - mixed @ np.linalg.pinv(others) @ mixed.T)
    return np.stack(found)


def num_frames(stretches: Stretches) -> int:
    """With a reading, at least 1; nearly as many steps are played in one world."""
    return max(1, int(np.isfinite(stretches.values).any(-1).sum()))


def _about(seconds: float) -> str:
    """Said in advance of what takes long."""
    return f", about {seconds:.0f} s" * (seconds > _LONG_S)
