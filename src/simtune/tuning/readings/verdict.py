"""Turns fits to joint readings into an estimate with intervals and warnings."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from simtune.fit import OutputErrorFit, bound_warnings, correlated_pairs
from simtune.fit.lateness import is_too_late
from simtune.fit.readings.replay_objective import PRIOR_STD
from simtune.fit.result import block_correlation, diluted
from simtune.normal import STDS_90
from simtune.observation import ObservationModel
from simtune.parameters import ParameterSpace
from simtune.randomization import Distribution
from simtune.tuning.estimate import Estimate
from simtune.tuning.range_update import read_curves
from simtune.tuning.readings.agreement import BestDescent, unexplained, untested
from simtune.tuning.readings.horizons import Latency
from simtune.tuning.readings.warnings import Unmeasured, all_warnings
from simtune.tuning.survival_curves import normal_curves
from simtune.verdicts import at_most_weak

_CURVE_WIDTH_STDS = 6.0  # half-width in which curves are drawn
_LEAST_STD = 1e-3  # in unit coordinates
_UNKNOWN_STD = 1.0  # of parameters that only pictures show
_DELTA = 1e-4  # in unit coordinates
_KNOWN_STD = 0.1  # of a combination, in unit coordinates
_MAIN_EFFECT_SHARE = 0.5  # of what a parameter changes
# Factor on errors if no second fit says whether there are several minima, and once more if that
# one does not explain what is read
_UNSURE_FACTOR = 3.0


class ReadingsResult(NamedTuple):
    """What D readings tell of parameters, and how far that can be trusted."""

    estimate: Estimate
    distribution: Distribution  # the part of the first range in which curves are drawn
    # Whether two fits agree, readings say where all joints begin, no more is left than the tuning
    # file declares, and `is_in_time`
    is_trusted: bool
    # Whether no delay is left that the fit cannot describe: other parameters would take its place
    is_in_time: bool
    found: BestDescent
    noise: np.ndarray  # (D,) root mean square of the residuals
    # Whether something was left out that more time may tell: a longer delay, another fit
    lacked_time: bool = False


def conclude(
    judged: OutputErrorFit,
    found: BestDescent,
    first: Distribution,
    observation: ObservationModel,
    latency: Latency,
    step_s: float,
    unmeasured: Unmeasured,
) -> ReadingsResult:
    """What a fit within the `first` range tells, and how far it can be trusted."""
    space, sensors = first.space, observation.sensors
    off, may_be_off = unexplained(judged.noise, sensors), untested(judged.noise, sensors)
    reasons = int(not found.is_sure) * (1 + int(off.any()))
    std, correlation = _errors(judged, found, space, observation, _UNSURE_FACTOR**reasons)
    read, seen = _read(judged.unit, std, first)
    is_in_time = latency.is_known and not is_too_late(judged.late_steps[0])
    is_sure = found.is_sure and is_in_time and not unmeasured.unseen
    at_bounds = bound_warnings(space, judged.unit, np.ones(len(space), bool))
    doubtful = np.array([not is_sure or name in at_bounds for name in space.names])
    doubtful[~space.is_appearance] |= judged.shares[:, off | may_be_off].sum(1) > _MAIN_EFFECT_SHARE
    estimate = replace(
        read,
        mean=space.from_unit(judged.unit),
        verdict=at_most_weak(read.verdict, doubtful),
        correlation=correlation,
        correlations=correlated_pairs(correlation, space),
        warnings=all_warnings(judged, found, space, observation, latency, step_s, unmeasured, std),
        start=None if judged.start is None else judged.start.tolist(),
        latency_steps=latency.steps,
        readings_late_s=(judged.late_steps[0] * step_s, judged.late_steps[1] * step_s),
        offsets=dict(zip(observation.reading_labels, judged.offsets.tolist(), strict=True)),
    )
    is_trusted = is_sure and not off.any()
    lacked_time = found.lacked_time or not latency.is_known
    return ReadingsResult(estimate, seen, is_trusted, is_in_time, found, judged.noise, lacked_time)


def _read(unit: np.ndarray, std: np.ndarray, first: Distribution) -> tuple[Estimate, Distribution]:
    """Of (N,) values and standard deviations in unit coordinates: what their normal curves say.

    Also the range in which the curves are drawn.
    """
    space = first.space
    mean, ends = space.from_unit(unit), unit + _CURVE_WIDTH_STDS * np.array([-std, std])
    low, high = (space.from_unit(np.clip(end, 0, 1)) for end in ends)
    seen = first.with_interval(mean, low, high)
    curves = normal_curves(seen.to_range_unit(mean), std / seen.unit_width)
    return read_curves(curves, seen, first), seen


def _errors(
    judged: OutputErrorFit,
    found: BestDescent,
    space: ParameterSpace,
    observation: ObservationModel,
    unsure: float,
) -> tuple[np.ndarray, np.ndarray]:
    """(N,) standard deviations in unit coordinates, and the (N, N) correlation of errors.

    `unsure`: factor on the fit's own.
    """
    is_appearance, fitted = space.is_appearance, np.flatnonzero(~space.is_appearance)
    covariance = _by_data(judged.covariance + np.outer(found.apart, found.apart))
    wider = _along_sums(space, judged.unit, fitted, covariance)
    wider, by_timestep = wider * unsure, judged.by_timestep[fitted]
    covariance = covariance * np.outer(wider, wider) + np.outer(by_timestep, by_timestep)
    of_fit = np.full(len(is_appearance), _UNKNOWN_STD)
    of_fit[fitted] = np.sqrt(np.diag(covariance))
    of_model = observation.discrepancy_std(is_appearance)
    std = np.maximum(np.hypot(of_fit, of_model), _LEAST_STD)
    correlation = block_correlation(len(std), [(fitted, covariance)])
    return std, diluted(correlation, of_fit / std)


def _by_data(covariance: np.ndarray) -> np.ndarray:
    """(P, P) without the fit's prior, which only keeps steps short: it is not information.

    A combination that no reading shows, such as of two dampings that act as one, gets the standard
    deviation of a parameter that no reading shows.
    """
    values, combinations = np.linalg.eigh(
        np.linalg.inv(covariance) - np.eye(len(covariance)) / PRIOR_STD**2
    )
    return combinations / (np.maximum(values, 0) + _UNKNOWN_STD**-2) @ combinations.T


def _along_sums(
    space: ParameterSpace, unit: np.ndarray, fitted: np.ndarray, covariance: np.ndarray
) -> np.ndarray:
    """(P,) factors on standard deviations for sums that are known better than what they are of.

    Two dampings that act as one can be exchanged at a constant rate on their own scale. On the
    logarithmic scale of unit coordinates that line is a curve, and its tangent understates how far
    the stiff one can fall. So for each poorly known combination its main parameter is moved by its
    interval, the others follow on their own scale, and it is measured how far each gets.
    """
    std, at = np.sqrt(np.diag(covariance)), space.from_unit(unit)
    inside = np.clip(unit, _DELTA, 1 - _DELTA)
    slope = (space.from_unit(inside + _DELTA) - space.from_unit(inside - _DELTA)) / (2 * _DELTA)
    reached = std.copy()
    values, combinations = np.linalg.eigh(covariance)
    for value, combination in zip(values, combinations.T, strict=True):
        if np.sqrt(value) < _KNOWN_STD:
            continue
        most, change = int(np.abs(combination).argmax()), slope[fitted] * combination
        own = STDS_90 * np.sqrt(value) * abs(combination[most])
        for side in (-1, 1):
            end = unit.copy()
            end[fitted[most]] = np.clip(unit[fitted[most]] + side * own, 0, 1)
            moved = (space.from_unit(end) - at)[fitted[most]]
            end = at.copy()
            end[fitted] += change / change[most] * moved
            gone = (space.to_unit(space.clip(end)) - unit)[fitted]
            reached = np.maximum(reached, np.abs(gone) / STDS_90)
    return reached / std
