"""Fits the motion from below and above a start: how far both end apart is an error, too."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from simtune.budget import Budget
from simtune.fit.motion.shooting import Shooting, ShootingFit
from simtune.fit.observed import Observed
from simtune.fit.result import PointEstimate
from simtune.parameters import ParameterSpace

_SIDESTEP_BOUNDS = (0.01, 0.1)  # of the offset from a start, in unit coordinates
_MAX_WIDENING = 2.0  # of the error, as a factor, after a long way from the start


class TwoSidedFit(NamedTuple):
    """The middle of two fits, or the fit of longer windows that replaces it."""

    best: ShootingFit
    apart: np.ndarray  # (P,) its estimated error, with signs
    short: ShootingFit  # of the short windows, whose states are closer to the pictures

    @property
    def covariance(self) -> np.ndarray:
        """(P, P), as the fit claims and as the two fits are apart."""
        return self.best.covariance + np.outer(self.apart, self.apart)


def fit_from_two_sides(
    shooting: Shooting,
    space: ParameterSpace,
    observed: Observed,
    states: np.ndarray,
    start: PointEstimate,
    longer_within: Budget | None,
) -> TwoSidedFit:
    """From first guesses at the (E, T + 1, nq + nv) states, and from both sides of the `start`.

    The error is half the difference of the two results, or up to that distance if the middle moved
    farther from the start than the two began. If the horizon is extended from the middle, that
    result replaces it; half of the change counts as an error, too, since longer windows may be as
    biased as the short ones were.

    `shooting`: of the P parameters of the motion. `longer_within`: for
    `Shooting.extend_horizon`; None: no longer windows.
    """
    fits, unit, moving = [], space.to_unit(start.parameters), shooting.fitted
    aside = np.clip(start.std, *_SIDESTEP_BOUNDS)
    for side in (-1, 1):
        begin = unit.copy()
        begin[moving] += side * aside[moving]
        fits.append(shooting.fit(observed, states, space.from_unit(begin)))
    better = min(fits, key=lambda fit: float(np.median(fit.misfit)))
    one, other = (fit.unit for fit in fits)
    middle = replace(better, unit=(one + other) / 2)
    went = np.abs(middle.unit - unit[moving]) / aside[moving]
    off = (one - other) / 2 * np.clip(went, 1, _MAX_WIDENING)
    if longer_within is not None:
        extended = shooting.extend_horizon(
            observed, states, start.parameters, middle, longer_within
        )
        if extended is not middle:
            misled = (extended.unit - middle.unit) / 2
            misled = np.where(np.abs(misled) > np.abs(off), misled, off)
            return TwoSidedFit(extended, misled, middle)
    return TwoSidedFit(middle, off, middle)
