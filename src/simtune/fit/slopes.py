"""How predictions change with what is unknown, and what of it can be derived by at once."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d

_SIDE_EFFECT = 0.1  # of the largest effect on a reading: one that can wait
# Times the noise, what is changed by a start, or by all of a parameter, that can wait altogether
_LITTLE = {"start": 3.0, "parameter": 0.01}
_SMOOTH_STEPS = 11  # over which it is seen whether two changes agree


class Slopes(NamedTuple):
    """What W stretches predict, and how that changes with what is unknown."""

    predicted: np.ndarray  # (W, K + 1, D)
    by_parameter: np.ndarray  # (W, P, K + 1, D) in unit coordinates
    by_start: np.ndarray  # (W, S, K + 1, D) in terms of what is unknown of the start


@dataclass(frozen=True)
class Groups:
    """Unknowns that are derived by at once, since no reading depends on two of a group.

    An arm's elbow moves by its own servo's numbers, hardly by those of the others. So few worlds
    give nearly all of the derivatives (Curtis, Powell and Reid 1974); the others, which change
    little, are those of before. So are all those by an unknown that no reading tells of: where
    servos hold an arm, how it began is soon forgotten.
    """

    number: np.ndarray  # (U,) the group of each unknown; -1: of none
    owner: np.ndarray  # (G, D) the unknown of a group that a reading depends on most

    @classmethod
    def of(cls, slopes: Slopes, noise: np.ndarray) -> "Groups":
        """By derivatives, by all unknowns one by one; `noise`: (D,) of readings."""
        every = np.concatenate([slopes.by_parameter, slopes.by_start], 1)
        effect = np.sqrt(np.square(every).mean((0, 2))) / noise  # (U, D)
        is_start = np.arange(len(effect)) >= slopes.by_parameter.shape[1]
        little = np.where(is_start, _LITTLE["start"], _LITTLE["parameter"])
        main = effect > _SIDE_EFFECT * effect.max(0)
        main |= effect >= effect.max(1, keepdims=True)  # none without a reading of its own
        number, taken = np.full(len(effect), -1), []
        for unknown in np.flatnonzero(effect.max(1) > little):
            its = main[unknown]
            free = (group for group, used in enumerate(taken) if not (used & its).any())
            group = next(free, len(taken))
            taken += [np.zeros_like(its)] * (group == len(taken))
            taken[group] = taken[group] | its
            number[unknown] = group
        # Whose main effect a reading is goes before whose side effect on it is larger
        order = effect + main * effect.max()
        owners = [np.where(number[:, None] == g, order, -1.0).argmax(0) for g in range(len(taken))]
        return cls(number, np.reshape(owners, (len(taken), len(noise))).astype(int))


def agreed(change: np.ndarray, another: np.ndarray) -> np.ndarray:
    """(G, W, K + 1, D) the mean of two changes by equal steps, less where they disagree.

    The share of its square that is no noise, as in Wiener's filter: noise of the two is not
    correlated, so their product has none of it.
    """
    both, size = change * another, (np.square(change) + np.square(another)) / 2
    both, size = (uniform_filter1d(its, _SMOOTH_STEPS, axis=2) for its in (both, size))
    return np.clip(both / np.maximum(size, 1e-300), 0, 1) * (change + another) / 2
