"""Puts a fit to joint readings alone and one to videos together, parameter by parameter."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from simtune.fit import Unexplained
from simtune.normal import STDS_90
from simtune.parameters import ParameterSpace
from simtune.randomization import Distribution
from simtune.tuning.estimate import Estimate
from simtune.verdicts import at_most_weak, verdict_of

_CONTRADICTION = (
    "Joint readings and videos contradict each other on {}: [{:.4g}, {:.4g}] by readings alone, "
    "[{:.4g}, {:.4g}] with videos. The model lacks something, or one of them is wrong; the "
    "interval covers both."
)
_OF_FILM = (
    "The joint readings alone are explained, by two fits that agree; only what cameras see is not. "
    "So what readings tell of {} stands. What is wrong is the film (mirrored, another camera or "
    "scene), or of what only it shows, such as a loose object: of all else trust no number."
)
# Standard deviations between means from which two estimates contradict each other. That their
# intervals do not meet says less: a wide one misses the truth once in ten times.
_CONTRADICTION_STDS = 3.0


def normal_std(estimate: Estimate, space: ParameterSpace) -> np.ndarray:
    """(N,) standard deviations in unit coordinates, if an interval is a normal distribution's.

    By its longer side: the other one may be cut off at a bound.
    """
    mean, low, high = map(space.to_unit, (estimate.mean, estimate.low, estimate.high))
    return np.maximum(mean - low, high - mean) / STDS_90


def contradicting(told: Estimate, other: Estimate, space: ParameterSpace) -> np.ndarray:
    """(N,) bool: parameters of which the means are too far apart for both to be right."""
    distance = np.abs(space.to_unit(told.mean) - space.to_unit(other.mean))
    both = np.hypot(normal_std(told, space), normal_std(other, space))
    return distance > _CONTRADICTION_STDS * both


def merged(own: np.ndarray, told: Estimate, other: Estimate) -> Estimate:
    """`told` by readings for the parameters `own`, (N,) bool; the `other` one for the rest."""
    curves = {
        name: told.curves[name] if mine else curve
        for (name, curve), mine in zip(other.curves.items(), own, strict=True)
    }
    correlation = other.correlation
    if own.any() and told.correlation is not None:
        mine, both, none = np.outer(own, own), np.outer(~own, ~own), np.eye(len(own))
        rest = none if correlation is None else np.where(both, correlation, none)
        correlation = np.where(mine, told.correlation, rest)
    picked = zip(own, told.verdict, other.verdict, strict=True)
    return replace(
        other,
        mean=np.where(own, told.mean, other.mean),
        low=np.where(own, told.low, other.low),
        high=np.where(own, told.high, other.high),
        verdict=[one if mine else another for mine, one, another in picked],
        curves=curves,
        correlation=correlation,
    )


def covering_both(
    apart: np.ndarray, estimate: Estimate, told: Estimate, other: Estimate, first: Distribution
) -> Estimate:
    """`estimate`, with both intervals and both curves of parameters that are `apart`, (N,) bool.

    Their verdict is what so wide an interval says, and "weak" at most. `first`: the first range.
    """
    if not apart.any():
        return estimate
    names = first.space.names
    low = np.where(apart, np.minimum(told.low, other.low), estimate.low)
    high = np.where(apart, np.maximum(told.high, other.high), estimate.high)
    share = first.to_range_unit(high) - first.to_range_unit(low)
    curves, warnings = dict(estimate.curves), list(estimate.warnings)
    verdict = list(estimate.verdict)
    for i in np.flatnonzero(apart).tolist():
        (one, above), (another, below) = told.curves[names[i]], other.curves[names[i]]
        at = np.union1d(one, another)
        curves[names[i]] = at, (np.interp(at, one, above) + np.interp(at, another, below)) / 2
        ends = (e for its in (told, other) for e in (its.low[i], its.high[i]))
        warnings.append(_CONTRADICTION.format(names[i], *ends))
        verdict[i] = verdict_of(share[i])
    return replace(
        estimate,
        low=low,
        high=high,
        verdict=at_most_weak(verdict, apart),
        curves=curves,
        warnings=warnings,
    )


def doubted_beside_film(
    estimate: Estimate,
    own: np.ndarray,
    unexplained: Unexplained,
    is_trusted: bool,
    names: Sequence[str],
) -> Estimate:
    """The estimate, where no setting explains the motion with videos.

    What readings tell, `own` (N,) bool, stays identified if they are trusted and only what cameras
    see is not explained, with a warning; else it is at most weak, as what videos tell is.
    """
    is_known = own & (np.array(estimate.verdict) == "identified")
    if unexplained == "nothing" or not is_known.any():
        return estimate
    if unexplained == "model" or not is_trusted:
        return replace(estimate, verdict=at_most_weak(estimate.verdict, own))
    told = _OF_FILM.format(", ".join(np.array(names)[is_known]))
    return replace(estimate, warnings=[*estimate.warnings, told])
