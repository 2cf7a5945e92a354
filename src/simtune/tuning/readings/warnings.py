"""Warnings of a fit to joint readings: how it ended, what it left, where its replays begin."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from simtune.columns import cut
from simtune.fit import (
    READINGS,
    OutputErrorFit,
    bound_warnings,
    delay_warnings,
    timestep_warning,
)
from simtune.observation import ObservationModel
from simtune.parameters import ParameterSpace
from simtune.tuning.readings.agreement import BestDescent, unexplained, untested
from simtune.tuning.readings.horizons import Latency

_MOST_NAMED = 6  # parameters at a bound
_MAX_OFF_SHARE = 0.8  # of the readings: with more off, single parameters tell nothing
_NOT_FOUND_TWICE = (
    "Fits to whole episodes, or to what of them can be followed, ended at no answer twice ({} "
    "tried, from as many starts), so how sure the best of them is cannot be said, and nothing is "
    "called identified. Leave parameters out that go with others, or give better first guesses{}."
)
_OR_MORE_TIME = ", or more minutes"  # as long as the most fits have not been made
_ONE_FIT = (
    "There was time for one fit to whole episodes of readings, or to what of them can be followed. "
    "So how sure it is cannot be said, and nothing that it tells is called identified. Give it "
    "more minutes."
)
_BY_STRETCHES = (
    "Fits to whole episodes ended at no answer twice, as where the least change throws a motion "
    "elsewhere; fits to shorter stretches did, and leave little but noise: the estimate is theirs."
)
_UNTESTED = (
    "The simulator leaves {} off by over four times the noise that encoders usually have, and the "
    "tuning file declares none. So whether the model lacks something is not tested, and what "
    "mainly these readings show is not called identified. Give the sensor its noise."
)
_UNEXPLAINED = (
    "The simulator leaves {} off by over four times the noise that the tuning file declares: the "
    "model lacks something, or the search ended beside the truth. Intervals count what is left, "
    "not why, so what mainly these readings show is not called identified."
)
_LEFT_OUT = (
    " Nothing touches {} in these replays, since no sensor says where it is: where the robot "
    "pushes or holds it, its resistance and its weight pass for friction and offsets. Episodes "
    "without that tell the robot's parameters best (--leave-out)."
)
_NO_OFFSET = (
    "The offsets of {} are smaller than what else is left of their readings: do not correct an "
    "encoder by them."
)
_UNSEEN = (
    "Where {0} begins no sensor measures, and each episode may begin elsewhere: readings alone "
    "cannot be replayed from there, so nothing that they tell is called identified. Measure it, "
    "or look at a camera as well. If the robot always begins the same, say so by a keyframe "
    "([initial_state]); if it is mounted, by fixed_joints; if it moves with a measured joint, by "
    "an equality of the two in the model."
)
_MAYBE_LATER = (
    "There was no time to look for a longer delay of actions: it may pass for damping, so nothing "
    "that readings tell is called identified. Give it more minutes, or declare a parameter of kind "
    "delay."
)
_AT_BOUNDS_BUT_OFF = (
    "{} ended at a bound of the range, as happens where replays cannot explain what is read: wider "
    "bounds would not help."
)


class Unmeasured(NamedTuple):
    """Joints that no sensor measures, though readings depend on them."""

    unseen: tuple[str, ...] = ()  # those that begin anywhere
    left_out: tuple[str, ...] = ()  # loose objects, which nothing touches in replays


def all_warnings(
    judged: OutputErrorFit,
    found: BestDescent,
    space: ParameterSpace,
    observation: ObservationModel,
    latency: Latency,
    step_s: float,
    unmeasured: Unmeasured,
    std: np.ndarray,
) -> list[str]:
    """Of a fit with errors of (N,) `std` in unit coordinates; the rest as in `conclude`."""
    unseen, left_out = unmeasured
    late_s = {READINGS: (judged.late_steps[0] * step_s, judged.late_steps[1] * step_s)}
    sensors = observation.sensors
    off, may_be_off = unexplained(judged.noise, sensors), untested(judged.noise, sensors)
    is_futile = bool(unseen) or off.mean() > _MAX_OFF_SHARE  # to look at single parameters
    # What the timestep changes by more than all other errors
    by_timestep = np.where(2 * judged.by_timestep**2 > std**2, judged.by_timestep, 0.0)
    return [
        *([unseen_warning(unseen)] if unseen else []),
        *delay_warnings(late_s, latency.steps, step_s),
        *([] if latency.is_known else [_MAYBE_LATER]),
        *timestep_warning(space, judged.unit, by_timestep * (not is_futile), judged.timestep_s),
        *([] if unseen else _of_end(found)),
        *_of_offsets(judged.offsets, judged.noise * (off | may_be_off), observation),
        *_of_misfit(judged.noise, observation, left_out),
        *_of_bounds(bound_warnings(space, judged.unit, np.ones(len(space), bool)), is_futile),
    ]


def unseen_warning(unseen: Sequence[str]) -> str:
    """On joints that begin anywhere and that no sensor measures."""
    return _UNSEEN.format(", ".join(unseen))


def _of_end(found: BestDescent) -> list[str]:
    """Of how fits ended."""
    warnings = [] if found.is_whole else [_BY_STRETCHES]
    if found.is_sure:
        return warnings
    if found.num_fits > 1:
        more = _OR_MORE_TIME * found.lacked_time
        return [*warnings, _NOT_FOUND_TWICE.format(found.num_fits, more)]
    return [*warnings, _ONE_FIT]
    return warnings


def _of_misfit(
    noise: np.ndarray, observation: ObservationModel, left_out: Sequence[str]
) -> list[str]:
    """Of readings whose residuals, (D,), are `unexplained`, and of those that are `untested`."""
    warnings, sensors = [], observation.sensors
    for said, which in ((_UNEXPLAINED, unexplained), (_UNTESTED, untested)):
        labels = _labels(observation, which(noise, sensors))
        warnings += [said.format(", ".join(labels))] if labels else []
    also = _LEFT_OUT.format(cut(left_out, _MOST_NAMED)) if left_out else ""
    return [warning + also for warning in warnings]


def _of_offsets(offsets: np.ndarray, noise: np.ndarray, observation: ObservationModel) -> list[str]:
    """Of (D,) offsets that are smaller than the (D,) noise."""
    labels = _labels(observation, (offsets != 0) & (np.abs(offsets) < noise))
    return [_NO_OFFSET.format(cut(labels, _MOST_NAMED))] if labels else []


def _labels(observation: ObservationModel, which: np.ndarray) -> list[str]:
    """Of the readings, (D,) bool."""
    return [label for label, is_it in zip(observation.reading_labels, which, strict=True) if is_it]


def _of_bounds(at_bounds: Mapping[str, str], is_futile: bool) -> list[str]:
    """Of parameters at a bound, {name: warning}; one for all if wider bounds would be futile."""
    if is_futile and at_bounds:
        return [_AT_BOUNDS_BUT_OFF.format(cut(list(at_bounds), _MOST_NAMED))]
    return list(at_bounds.values())
