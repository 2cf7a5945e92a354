"""What a round concludes from a fit and its refits, or from networks alone."""

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from simtune.fit import (
    READINGS,
    FitResult,
    Refits,
    bound_warnings,
    calibrated,
    correlated_pairs,
    elsewhere_warning,
    has_comparison,
    held_out_misfit,
    is_misshapen,
    is_motion_unexplained,
    model_checks,
)
from simtune.parameters import ParameterSpace
from simtune.randomization import Distribution
from simtune.tuning.edges import followed, out_of_reach, reach_warnings
from simtune.tuning.estimate import Estimate
from simtune.tuning.learning import LearningResult
from simtune.tuning.range_update import read_curves
from simtune.tuning.search import SearchContext
from simtune.tuning.survival_curves import blurred, normal_curves, with_fit
from simtune.verdicts import at_most_weak


def conclude_by_networks(
    learned: LearningResult, context: SearchContext
) -> tuple[Estimate, np.ndarray]:
    """The estimate and its (N, C) curves where nothing is fitted; known parameters stay known."""
    searched = learned.searched
    discrepancy = context.observation.discrepancy_std(searched.space.is_appearance)
    curves = blurred(learned.prob_higher, discrepancy, searched)
    if context.known is not None:
        is_known = np.isfinite(context.known)
        at = searched.to_range_unit(np.where(is_known, context.known, searched.mean))
        curves = np.where(is_known[:, None], normal_curves(at, np.zeros(len(at))), curves)
    return read_curves(curves, searched, context.first), curves


def conclude(
    prob_higher: np.ndarray,
    fit: FitResult,
    refits: Refits,
    searched: Distribution,
    first: Distribution,
) -> tuple[Estimate, np.ndarray]:
    """The estimate and its (N, C) curves: the fit's, with the posterior network's for tails."""
    space, trusted = searched.space, calibrated(fit, refits, searched.space)
    mean, std = searched.to_range_unit(trusted.parameters), trusted.std / searched.unit_width
    curves = with_fit(prob_higher, mean, std)
    read = read_curves(curves, searched, first)
    is_fitted = ~np.isin(np.arange(len(space)), fit.unfitted)
    side = np.where(is_fitted, out_of_reach(curves, searched), 0)
    at_ends = reach_warnings(space, side, read.mean)
    at_ends |= bound_warnings(space, space.to_unit(fit.parameters), is_fitted)
    visible = [space.names[i] for i in np.flatnonzero(space.is_appearance)]
    estimate = replace(
        followed(read, side, trusted.parameters),
        verdict=at_most_weak(read.verdict, _doubtful(fit, refits, space, at_ends)),
        correlation=trusted.correlation,
        correlations=correlated_pairs(trusted.correlation, space),
        ranks=refits.ranks(space.names),
        warnings=[
            *model_checks(fit, refits),
            *elsewhere_warning(fit, refits, visible),
            *at_ends.values(),
        ],
        held_out=held_out_misfit(fit, refits),
        start=fit.starts[0].tolist(),
        latency_steps=fit.latency_steps,
        pictures_late_s=fit.pictures_late_s,
        readings_late_s=fit.late_s.get(READINGS, (0.0, 0.0)),
        camera_responses=[camera.to_json() for camera in fit.responses] if len(fit.known) else [],
    )
    return estimate, curves


def _doubtful(
    fit: FitResult, refits: Refits, space: ParameterSpace, at_ends: Collection[str]
) -> np.ndarray:
    """(N,) bool: what is not identified, however narrow its interval is."""
    # If the model lacks something else, none of its numbers is identified.
    is_wrong = is_motion_unexplained(fit, refits) or fit.is_too_late
    is_sound = has_comparison(refits) and not is_wrong
    doubtful = np.array([not is_sound or name in at_ends for name in space.names])
    elsewhere = refits.is_elsewhere(fit.misfit)
    doubtful[space.is_appearance] |= elsewhere | (fit.unusual_camera is not None)
    doubtful[~space.is_appearance] |= elsewhere.any() or is_misshapen(fit)
    return doubtful
