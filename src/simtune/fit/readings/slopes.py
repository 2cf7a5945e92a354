"""Derivatives of predictions, and which unknowns can be differentiated together."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d

_SIDE_EFFECT_SHARE = 0.1  # of the largest effect on a reading: smaller ones are not updated
# Changes in units of the noise, by a start or over a parameter's range, that are never updated
_SMALL_CHANGES = {"start": 3.0, "parameter": 0.01}
_SMOOTH_STEPS = 11  # over which the agreement of two changes is averaged


class StretchSlopes(NamedTuple):
    """Predictions of W stretches, and their derivatives."""

    predicted: np.ndarray  # (W, K + 1, D)
    by_parameter: np.ndarray  # (W, P, K + 1, D) in unit coordinates
    by_start: np.ndarray  # (W, S, K + 1, D) in units of the start's prior std


@dataclass(frozen=True)
class Groups:
    """Unknowns that are perturbed at once, since no reading depends mainly on two of a group.

    An arm's elbow depends on its own servo's parameters, hardly on those of others. So few worlds
    give nearly all derivatives (Curtis, Powell and Reid 1974); the others, which are small, keep
    their old values. So do all derivatives by an unknown that no reading depends on: when servos
    hold an arm, its initial state is soon forgotten.
    """

    number: np.ndarray  # (U,) the group of each unknown; -1: none
    owner: np.ndarray  # (G, D) the unknown of a group that each reading depends on most

    @classmethod
    def of(cls, slopes: StretchSlopes, noise: np.ndarray) -> "Groups":
        """From derivatives by each single unknown; `noise`: (D,) of readings."""
        derived = np.concatenate([slopes.by_parameter, slopes.by_start], 1)
        effect = np.sqrt(np.square(derived).mean((0, 2))) / noise  # (U, D)
        is_start = np.arange(len(effect)) >= slopes.by_parameter.shape[1]
        little = np.where(is_start, _SMALL_CHANGES["start"], _SMALL_CHANGES["parameter"])
        main = effect > _SIDE_EFFECT_SHARE * effect.max(0)
        main |= effect >= effect.max(1, keepdims=True)  # each unknown has a main reading
        number, taken = np.full(len(effect), -1), []
        for unknown in np.flatnonzero(effect.max(1) > little):
            main_readings = main[unknown]
            free = (group for group, used in enumerate(taken) if not (used & main_readings).any())
            group = next(free, len(taken))
            taken += [np.zeros_like(main_readings)] * (group == len(taken))
            taken[group] = taken[group] | main_readings
            number[unknown] = group
        # Owners whose main effect a reading is come before those with larger side effects
        order = effect + main * effect.max()
        owners = [np.where(number[:, None] == g, order, -1.0).argmax(0) for g in range(len(taken))]
        return cls(number, np.reshape(owners, (len(taken), len(noise))).astype(int))


def agreed(change: np.ndarray, another: np.ndarray) -> np.ndarray:
    """(G, W, K + 1, D) mean of two changes by equal steps, shrunk where they disagree.

    As in Wiener's filter, the factor is the share of signal in the square: the noise of the two
    changes is uncorrelated, so their product has none.
    """
    both, size = change * another, (np.square(change) + np.square(another)) / 2
    both, size = (uniform_filter1d(values, _SMOOTH_STEPS, axis=2) for values in (both, size))
    return np.clip(both / np.maximum(size, 1e-300), 0, 1) * (change + another) / 2
