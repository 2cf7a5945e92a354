"""Whether a time is enough: what is refused at once, or said, before minutes are spent."""

import logging
import math

from simtune.errors import InputError
from simtune.tuning.posterior import PosteriorSearch
from simtune.tuning.search import Search, TimeNeeded

log = logging.getLogger(__name__)
_SURE_TIME_SHARE = 0.6  # of the measured time, since the machine may have been busy at that moment
_SHORTENED = "; in --budget-minutes {:g} it is a shortened one, whose intervals may be wider"
# Relative to a whole round: with less time no known world may be fitted, which verdicts need.
_JUDGED_ROUND_SHARE = 0.5
_UNJUDGED = "; in --budget-minutes {:g} perhaps nothing can be called identified: {:g} are enough"
# Of six-minute runs on a busy machine, which had .20 to .24 of a whole round, three of four ended
# without a fit.
_FITTED_ROUND_SHARE = 0.3
_UNFITTED = (
    "In --budget-minutes %g there is hardly time to fit anything: what pictures tell will be first "
    "guesses by networks, whose intervals nothing tests. A fit needs --budget-minutes %d; it is "
    "cheaper with fewer or shorter episodes, or %s"
)


def refuse_if_too_short(minutes: float, other_s: float, needed: TimeNeeded) -> None:
    """Raises InputError for a time too short for a sound answer; says how long a round takes.

    `other_s`: time for all but rounds.
    """
    least_s, whole_s = needed.least_s, needed.whole_s
    if not whole_s:  # a search that cannot tell
        if 60 * minutes < other_s:
            raise InputError(
                f"--budget-minutes {minutes:g} is too short: nothing can be searched in that time, "
                f"as the run takes about {other_s:.0f} s beside the search; give more"
            )
        return
    if 60 * minutes < _SURE_TIME_SHARE * least_s + other_s:
        enough = math.ceil(_with_readings(2 * least_s + other_s, needed) / 6) / 10
        judged_s = _with_readings(whole_s + other_s, needed)
        whole_minutes = max(math.ceil(judged_s / 60), math.ceil(enough))
        raise InputError(
            f"--budget-minutes {minutes:g} is too short: the smallest round takes "
            f"{least_s:.0f} to {2 * least_s:.0f} s on this machine, a whole one {whole_s:.0f} s; "
            f"verdicts need --budget-minutes {whole_minutes}, an answer --budget-minutes "
            f"{enough:g} or more" + (f". {needed.mostly}" if needed.mostly else "")
        )
    first_s, enough_s = _first_s(minutes, needed), _with_readings(whole_s + other_s, needed)
    said = f", after {first_s:.0f} s for readings" * bool(first_s)
    if 60 * minutes < _JUDGED_ROUND_SHARE * whole_s + other_s + first_s:
        said += _UNJUDGED.format(minutes, math.ceil(enough_s / 60))
    elif 60 * minutes < enough_s:
        said += _SHORTENED.format(minutes)
    log.info("a round takes about %.0f s here%s", whole_s, said)


def say_if_unfitted(search: Search, minutes: float, other_s: float, needed: TimeNeeded) -> None:
    """If networks alone will probably have the say, though a fit is possible."""
    whole_s = needed.whole_s
    left_s = 60 * minutes - other_s - _first_s(minutes, needed)
    if not isinstance(search, PosteriorSearch) or not search.context.can_fit:
        return
    if left_s < _FITTED_ROUND_SHARE * whole_s:
        enough_s = _with_readings(_JUDGED_ROUND_SHARE * whole_s + other_s, needed)
        has_readings = bool(search.context.observation.sensors)
        # At a lower rate actions are averaged: servos' dampings came out 7 to 13 % too low
        alone = "from the joint readings alone (--observe joints)"
        cheaper = alone if has_readings else "a lower --control-hz"
        log.info(_UNFITTED, minutes, math.ceil(enough_s / 60), cheaper)


def _first_s(minutes: float, needed: TimeNeeded) -> float:
    """Seconds before the first round: readings are left half of all time at most."""
    return min(needed.first_s, 60 * minutes / 2)


def _with_readings(rest_s: float, needed: TimeNeeded) -> float:
    """Seconds in which `rest_s` are left besides what readings take first: half of it at most."""
    return rest_s + min(needed.first_s, rest_s)
