"""Whether fits to readings from different starts end at the same answer."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from simtune.fit import Descent
from simtune.observation import JointSensor, assumed_noise, declared_noise

FAR_MORE = 4.0  # factor on the noise that a sensor declares
CLEARLY_BETTER = 0.02  # relative decrease of residuals that counts as better, for a fit or a delay
_MAX_END_DISTANCE = 0.01  # in unit coordinates
_MIN_START_DISTANCE = 0.025  # from an answer, for a fit to confirm it


class BestDescent(NamedTuple):
    """The best of several descents, and how far others agree."""

    best: Descent
    # (P,) half the difference from others that agree with it, at most, or from the next best one
    # that ended
    apart: np.ndarray
    is_sure: bool  # whether another one agrees
    num_fits: int
    # Of whole episodes, or of the segments that can be followed, not stretches of the last horizon
    is_whole: bool
    # Whether time ended it before two agreed, and before the most fits that are made
    lacked_time: bool = False


def best_of(fits: Sequence[Descent], moving: np.ndarray, is_whole: bool) -> BestDescent:
    """Of fits in the order in which they were made.

    `moving`: (N,) bool, parameters that are fitted; `is_whole`: see `BestDescent`.
    """
    best, *others = sorted(fits, key=lambda descent: descent.log_rms)
    is_sure = agree(fits, moving)
    near = [d for d in others if d.log_rms < best.log_rms + CLEARLY_BETTER]
    # Where time cut a fit off says nothing
    ended = [descent for descent in others if not descent.is_cut_off]
    near += _next_to_best(fits, moving) if is_sure else ended[:1]
    differences = ([descent.unit for descent in (best, *near)] - best.unit)[:, moving] / 2
    apart = np.take_along_axis(differences, np.abs(differences).argmax(0)[None], 0)[0]
    return BestDescent(best, apart, is_sure, len(fits), is_whole)


def agree(fits: Sequence[Descent], moving: np.ndarray) -> bool:
    """Whether the two best leave nearly the same residuals, or another ends next to the best.

    After contacts, residuals depend on the least change, but parameters need not.
    """
    return two_agree(fits) or len(_next_to_best(fits, moving)) > 1


def two_agree(fits: Sequence[Descent]) -> bool:
    """Whether the two best leave nearly the same residuals."""
    found = sorted(descent.log_rms for descent in fits)
    return len(found) > 1 and found[1] < found[0] + CLEARLY_BETTER


def unexplained(noise: np.ndarray, sensors: Sequence[JointSensor]) -> np.ndarray:
    """(D,) bool: readings whose residuals (D,) are far larger than the declared noise."""
    return noise > FAR_MORE * declared_noise(sensors)


def untested(noise: np.ndarray, sensors: Sequence[JointSensor]) -> np.ndarray:
    """(D,) bool: readings whose residuals (D,) are far larger than usual, with no noise declared.

    Not of speeds, of which what is usual differs too much.
    """
    is_place = np.repeat([s.is_position for s in sensors], [s.size for s in sensors])
    is_declared = np.isfinite(declared_noise(sensors))
    return is_place & ~is_declared & (noise > FAR_MORE * assumed_noise(sensors))


def _next_to_best(fits: Sequence[Descent], moving: np.ndarray) -> list[Descent]:
    """Those that end where the best one does, itself among them.

    The later of two must have begun elsewhere: one that hardly moved confirms nothing.
    """
    best = min(range(len(fits)), key=lambda number: fits[number].log_rms)

    def confirms(number: int) -> bool:
        earlier, later = fits[min(number, best)], fits[max(number, best)]
        ended, begun = (
            np.abs(unit - earlier.unit)[moving].max() for unit in (later.unit, later.begun)
        )
        return bool(ended < _MAX_END_DISTANCE and begun >= _MIN_START_DISTANCE)

    return [fit for number, fit in enumerate(fits) if number == best or confirms(number)]
