"""Turns fits to joint readings into an estimate with intervals and warnings."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from simtune.fit import (
    OutputErrorFit,
    bound_warnings,
    correlated_pairs,
    latency_warning,
    lateness_warning,
    too_late_warning,
)
from simtune.fit.lateness import is_too_late
from simtune.fit.readings.replay_objective import PRIOR_STD
from simtune.fit.result import block_correlation, diluted
from simtune.normal import STDS_90
from simtune.observation import ObservationModel, assumed_noise, declared_noise, joints_of
from simtune.parameters import ParameterSpace
from simtune.randomization import Distribution
from simtune.tuning.estimate import Estimate, at_most_weak
from simtune.tuning.range_update import RangeUpdateConfig, read_curves
from simtune.tuning.readings_agreement import FAR_MORE, BestDescent, unexplained
from simtune.tuning.survival_curves import normal_curves

_SEEN_WIDTH = 6.0  # half-width in which curves are drawn, in standard deviations
_LEAST_STD = 1e-3  # in unit coordinates
_UNKNOWN_STD = 1.0  # of parameters that only pictures show
_SMALL = 1e-4  # in unit coordinates
_HARDLY_KNOWN = 0.1  # standard deviation of a combination, in unit coordinates
_MAINLY = 0.5  # share of what a parameter changes
_UNSURE = 3.0  # factor on errors if no second fit says whether there are several minima
_NOT_FOUND_TWICE = (
    "Fits to whole episodes, or to what of them can be followed, ended at no answer twice ({} "
    "tried, from as many starts), so how sure the best of them is cannot be said, and nothing is "
    "called identified. Leave parameters out that go with others, give better first guesses, or "
    "more minutes."
)
_ONE_FIT = (
    "There was time for one fit to whole episodes of readings, or to what of them can be followed. "
    "So how sure it is cannot be said, and nothing that it tells is called identified. Give it "
    "more minutes."
)
_BY_STRETCHES = (
    "Fits to whole episodes ended at no answer twice, as where the least change throws a motion "
    "elsewhere; fits to stretches of two seconds did, and leave little but noise: the estimate is "
    "theirs."
)
_UNTESTED = (
    "The simulator leaves {} off by over four times the noise that encoders usually have, and the "
    "tuning file declares none: whether the model lacks something is not tested. Give the sensor "
    "its noise."
)
_UNEXPLAINED = (
    "The simulator leaves {} off by over four times the noise that the tuning file declares: the "
    "model lacks something, or the search ended beside the truth. Intervals count what is left, "
    "not why, so what mainly these readings show is not called identified."
)
_UNSEEN = (
    "Where {} begins no sensor measures, and it differs from episode to episode: readings alone "
    "cannot be replayed from there. Measure it, or look at a camera as well."
)


class ReadingsFit(NamedTuple):
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


def conclude(
    judged: OutputErrorFit,
    found: BestDescent,
    first: Distribution,
    observation: ObservationModel,
    late: int,
    step_s: float,
    unseen: Sequence[str] = (),
) -> ReadingsFit:
    """What a fit within the `first` range tells, and how far it can be trusted.

    `late`: steps by which actions were found to be late; `unseen`: joints that begin anywhere and
    that no sensor measures.
    """
    late_s = (judged.late_steps[0] * step_s, judged.late_steps[1] * step_s)
    space = first.space
    std, correlation = _errors(judged, found, space, observation)
    read, seen = _read(judged.unit, std, first)
    is_in_time = not is_too_late(judged.late_steps[0])
    at_bounds = bound_warnings(space, judged.unit, np.ones(len(space), bool))
    is_sure = found.is_sure and is_in_time and not unseen
    doubtful = np.array([not is_sure or name in at_bounds for name in space.names])
    off = unexplained(judged.noise, joints_of(observation.sensors))
    doubtful[~space.is_appearance] |= judged.shares[:, off].sum(1) > _MAINLY
    estimate = replace(
        read,
        mean=space.from_unit(judged.unit),
        verdict=at_most_weak(read.verdict, doubtful),
        correlation=correlation,
        correlations=correlated_pairs(correlation, space),
        warnings=[
            *latency_warning(late),
            *lateness_warning("readings", *late_s),
            *([] if is_in_time else [too_late_warning("Readings", late_s[0])]),
            *_warnings(judged.noise, off, found, observation),
            *at_bounds.values(),
            *([_UNSEEN.format(", ".join(unseen))] if unseen else []),
        ],
        start=None if judged.start is None else judged.start.tolist(),
        latency_steps=late,
        readings_late_s=late_s,
        offsets=dict(zip(observation.reading_labels, judged.offsets.tolist(), strict=True)),
    )
    is_trusted = is_sure and not off.any()
    return ReadingsFit(estimate, seen, is_trusted, is_in_time, found, judged.noise)


def _read(unit: np.ndarray, std: np.ndarray, first: Distribution) -> tuple[Estimate, Distribution]:
    """Of (N,) values and standard deviations in unit coordinates: what their normal curves say.

    Also the range in which the curves are drawn.
    """
    space = first.space
    mean, ends = space.from_unit(unit), unit + _SEEN_WIDTH * np.array([-std, std])
    low, high = (space.from_unit(np.clip(end, 0, 1)) for end in ends)
    seen = first.with_interval(mean, low, high)
    curves = normal_curves(seen.to_range_unit(mean), std / seen.unit_width)
    return read_curves(curves, seen, first, RangeUpdateConfig()), seen


def _errors(
    judged: OutputErrorFit, found: BestDescent, space: ParameterSpace, observation: ObservationModel
) -> tuple[np.ndarray, np.ndarray]:
    """(N,) standard deviations in unit coordinates, and the (N, N) correlation of errors."""
    is_appearance, fitted = space.is_appearance, np.flatnonzero(~space.is_appearance)
    covariance = _by_data(judged.covariance + np.outer(found.apart, found.apart))
    wider = _along_sums(space, judged.unit, fitted, covariance)
    covariance = covariance * np.outer(wider, wider)
    of_fit = np.full(len(is_appearance), _UNKNOWN_STD)
    of_fit[fitted] = np.sqrt(np.diag(covariance)) * (1.0 if found.is_sure else _UNSURE)
    std = np.maximum(np.hypot(of_fit, observation.discrepancy_std(is_appearance)), _LEAST_STD)
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
    inside = np.clip(unit, _SMALL, 1 - _SMALL)
    slope = (space.from_unit(inside + _SMALL) - space.from_unit(inside - _SMALL)) / (2 * _SMALL)
    reached = std.copy()
    values, combinations = np.linalg.eigh(covariance)
    for value, combination in zip(values, combinations.T, strict=True):
        if np.sqrt(value) < _HARDLY_KNOWN:
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


def _warnings(
    noise: np.ndarray, off: np.ndarray, found: BestDescent, observation: ObservationModel
) -> list[str]:
    """Of how fits ended, and of readings that are `off`, (D,) bool, or may be."""
    warnings = []
    if not found.is_whole:
        warnings.append(_BY_STRETCHES)
    if not found.is_sure:
        many = found.num_fits > 1
        warnings.append(_NOT_FOUND_TWICE.format(found.num_fits) if many else _ONE_FIT)
    sensors = joints_of(observation.sensors)
    is_declared = np.isfinite(declared_noise(sensors))
    is_place = np.repeat([not s.is_velocity for s in sensors], [s.size for s in sensors])
    far = noise > FAR_MORE * assumed_noise(sensors)
    untested = far & ~is_declared & is_place  # what is usual of speeds differs too much
    for said, which in ((_UNEXPLAINED, off), (_UNTESTED, untested)):
        labels = [n for n, is_it in zip(observation.reading_labels, which, strict=True) if is_it]
        warnings += [said.format(", ".join(labels))] if labels else []
    return warnings
