"""Warnings of a fit to joint readings: how it ended, what it left, where its replays begin."""

from collections.abc import Mapping, Sequence

import numpy as np

from simtune.columns import cut
from simtune.observation import ObservationModel
from simtune.tuning.readings_agreement import BestDescent

_MOST_NAMED = 6  # parameters at a bound
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
    "tuning file declares none. So whether the model lacks something is not tested, and what "
    "mainly these readings show is not called identified. Give the sensor its noise."
)
_UNEXPLAINED = (
    "The simulator leaves {} off by over four times the noise that the tuning file declares: the "
    "model lacks something, or the search ended beside the truth. Intervals count what is left, "
    "not why, so what mainly these readings show is not called identified."
)
_UNSEEN = (
    "Where {0} begins no sensor measures, and each episode may begin elsewhere: readings alone "
    "cannot be replayed from there, so nothing that they tell is called identified. Measure it, "
    "or look at a camera as well. If the robot always begins the same, say so by a keyframe "
    "([initial_state]); if it is mounted, by fixed_joints."
)
_CARRIED = (
    "No sensor measures how {} moves, and replays can be followed in parts only, as of a robot "
    "that a controller balances. A part begins as fast as the one before ended, which fits allow "
    "for poorly: they may end far from the truth. So intervals are three times wider for that, and "
    "nothing that readings tell is called identified. Measure that speed, tie it to the wheels "
    "(<equality>), or record the robot on a stand, with fixed_joints."
)
_AT_BOUNDS_BUT_OFF = (
    "{} ended at a bound of the range, as happens where replays cannot explain what is read: wider "
    "bounds would not help."
)


def unseen_warning(unseen: Sequence[str]) -> str:
    """On joints that begin anywhere and that no sensor measures."""
    return _UNSEEN.format(", ".join(unseen))


def carried_warning(bases: Sequence[str]) -> str:
    """On joints of bases that no sensor measures, where episodes are fitted in parts."""
    return _CARRIED.format(cut(list(bases), _MOST_NAMED))


def end_warnings(found: BestDescent) -> list[str]:
    """Of how fits ended."""
    warnings = [] if found.is_whole else [_BY_STRETCHES]
    if not found.is_sure:
        many = found.num_fits > 1
        warnings.append(_NOT_FOUND_TWICE.format(found.num_fits) if many else _ONE_FIT)
    return warnings


def misfit_warnings(
    off: np.ndarray, may_be_off: np.ndarray, observation: ObservationModel
) -> list[str]:
    """Of readings that are `unexplained`, and of those that are `untested`, (D,) bool each."""
    warnings = []
    for said, which in ((_UNEXPLAINED, off), (_UNTESTED, may_be_off)):
        labels = [n for n, is_it in zip(observation.reading_labels, which, strict=True) if is_it]
        warnings += [said.format(", ".join(labels))] if labels else []
    return warnings


def bounds_warnings(at_bounds: Mapping[str, str], *, is_futile: bool) -> list[str]:
    """Of parameters at a bound, {name: warning}; one for all if wider bounds would be futile."""
    if is_futile and at_bounds:
        return [_AT_BOUNDS_BUT_OFF.format(cut(list(at_bounds), _MOST_NAMED))]
    return list(at_bounds.values())
