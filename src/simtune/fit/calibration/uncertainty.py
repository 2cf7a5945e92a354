"""Uncertainty of a fit: intervals widened by its refits, correlations."""

from dataclasses import replace

import numpy as np

from simtune.fit.calibration.refits import Refits
from simtune.fit.result import FitResult, diluted
from simtune.parameters import ParameterSpace

_MIN_TOLD_CORRELATION = 0.6


def calibrated(fit: FitResult, refits: Refits, space: ParameterSpace) -> FitResult:
    """The fit with bias removed, and with the standard deviations that refits show.

    These include what fits like this usually claim; they grow if this one explains the motion, or
    the pixels that show a parameter, worse than the refits do, and all do if such pixels are of
    something else. Then less of the bias is removed, since something else is wrong. The motion's
    discrepancy is added in the end: refits have none, so they must not scale it down; it is
    independent between parameters, and dilutes correlations.
    """
    worse = np.full(len(fit.std), max(1.0, *refits.motion_ratios(fit.misfit)))
    # A fit to pictures claims more where pixels are noisier, but `believed` takes half of it away,
    # or all if it claims less than is usual.
    noisier = np.maximum(1.0, refits.picture_ratios(fit.misfit))
    elsewhere = refits.is_elsewhere(fit.misfit)
    worse[fit.is_moving] *= np.sqrt(noisier[elsewhere].max(initial=1))
    worse[~fit.is_moving] = np.where(elsewhere, noisier, np.sqrt(noisier))
    believed, refitted = refits.believed(fit.std), fit.refitted_discrepancy_std
    unit = space.to_unit(fit.parameters) - refits.bias() * np.hypot(believed, refitted) / worse
    inflation = refits.inflation()
    std = inflation * np.hypot(believed * worse, refitted)
    std = np.where(
        fit.is_moving, np.hypot(std, fit.discrepancy_std), np.maximum(std, fit.discrepancy_std)
    )
    own, share = inflation * believed * worse, np.ones(len(std))
    np.divide(own, std, out=share, where=np.isfinite(std))
    correlation = diluted(fit.correlation, share)
    parameters = space.clip(space.from_unit(np.clip(unit, 0, 1)))
    return replace(fit, parameters=parameters, std=std, correlation=correlation)


def correlated_pairs(correlation: np.ndarray, space: ParameterSpace) -> dict[str, float]:
    """{"a, b": correlation} of the pairs that can hardly be separated, of (N, N) correlations.

    Without pairs of colours of two channels.
    """
    found = {}
    for i, j in zip(*np.triu_indices(len(space), 1), strict=True):
        value, (a, b) = float(correlation[i, j]), (space.parameters[i], space.parameters[j])
        is_mixed = a.is_colour and b.is_colour and a.component != b.component
        if abs(value) >= _MIN_TOLD_CORRELATION and not is_mixed:
            found[f"{a.name}, {b.name}"] = round(value, 2)
    return found
