"""Expected and actual interval of each parameter, reasons for the difference, and remedies."""

import math
from typing import Any, NamedTuple

from simtune.columns import counted
from simtune.normal import STDS_90
from simtune.report.trust import ranks
from simtune.report.words import number, unit
from simtune.run_data import RunData
from simtune.validate import is_number
from simtune.verdicts import IDENTIFIED_SHARE

_MUCH = 3.0  # ratio of widths above which more time may help
_FEW_REFITS = 4  # fewer refits widen intervals
_AS_TOLD = 1.5  # ratio of widths below which more time hardly helps
_WORSE = 1.2  # ratio of held-out errors to those of known worlds that is worth a reason
_ASSUMED_PX = 0.5  # detector error that `check` assumes


class PrecisionComparison(NamedTuple):
    """Interval of a parameter as `check` expects it, and as it came out, as text."""

    name: str
    expected: str  # half of the 90 % interval that `check` expects: at best, and if a model errs
    found: str  # half of the actual one
    times: float | None  # ratio of that to the expected one, 1 between two
    help: str  # what would narrow the interval; empty: nothing is missing
    is_range: bool = False  # whether two intervals are expected


def compare(run: RunData) -> list[PrecisionComparison]:
    """Of parameters for which `check` expects a number, and of others with wide intervals.

    The others are colours.
    """
    checked = run.object("check")
    found = []
    for name, facts in run.searched.items():
        expectation = checked.get(name)
        if not isinstance(expectation, dict) or not run.result:
            continue
        comparison = _of(run, name, facts, expectation)
        share = facts.get("interval_share")
        if comparison.times is not None or (is_number(share) and share > IDENTIFIED_SHARE):
            found.append(comparison)
    return found


def reasons(run: RunData) -> list[str]:
    """Reasons why intervals are wider than expected, one sentence each."""
    if not run.has_pictures:
        return ["What the model leaves of the readings, and episodes that disagree, widen them."]
    num = _num_refits(run)
    sentences = []
    if num < _FEW_REFITS:
        fitted = f"only {counted(num, 'known world')}" if num else "no known worlds"
        sentences.append(
            f"There was time for {fitted} to compare with, and the fewer, the wider intervals are."
        )
    if worse := _worse(run):
        sentences.append(
            f"Where it was tested, the tuned simulator is {worse:.1f} times as far off as known "
            "worlds are: the model lacks something, and intervals are wider for it."
        )
    error = run.get("detector/error_px")
    if is_number(error) and error > _ASSUMED_PX:
        sentences.append(
            f"The detector is off by {number(error)} pixels in these pictures; simtune check "
            f"takes {_ASSUMED_PX:g}. A larger --image-size, or a region, would show more."
        )
    if run.is_out_of_time:
        sentences.append(
            "The time was over: with more, a fit follows more stretches of the episodes. The same "
            "command with a larger --budget-minutes goes on from here."
        )
    return sentences or [
        "The best fit takes every stretch of every episode and errs by its noise alone. How far "
        "real fits are off was measured in known worlds, and that is what intervals are made of."
    ]


def _of(
    run: RunData, name: str, facts: dict[str, Any], expectation: dict[str, Any]
) -> PrecisionComparison:
    """A parameter's comparison; `facts`: of the result, `expectation`: of `check`."""
    key = "std_percent" if is_number(expectation.get("std_percent")) else "std"
    suffix = " %" if key == "std_percent" else f" {unit(facts)}".rstrip()
    stds = [expectation.get(name) for name in (f"{key}_at_best", key)]
    expected = [STDS_90 * std for std in stds if is_number(std)]
    half = _half(facts, is_log=key == "std_percent") if expected else None
    times = half / min(max(half, min(expected)), max(expected)) if half and all(expected) else None
    told = " to ".join(f"±{number(its)}{suffix}" for its in expected) or "seen in pictures"
    found = "" if half is None else f"±{number(half)}{suffix}"
    more = _help(run, facts, expectation, times)
    return PrecisionComparison(name, told, found, times, more, is_range=len(expected) > 1)


def _half(facts: dict[str, Any], *, is_log: bool) -> float | None:
    """Of a 90 % interval, in percent on a log scale."""
    low, high = facts.get("low"), facts.get("high")
    if not is_number(low) or not is_number(high) or (is_log and not low > 0):
        return None
    return 50 * math.log(high / low) if is_log else (high - low) / 2


def _help(
    run: RunData, facts: dict[str, Any], expectation: dict[str, Any], times: float | None
) -> str:
    """What would narrow the interval of a parameter that is not identified."""
    if facts.get("verdict") not in ("weak", "not identifiable"):
        return ""
    if run.object("held_out").get("passed") is False:
        return "first find what the model lacks"
    note = expectation.get("note")
    if isinstance(note, str) and note.startswith("together with "):
        others = note.removeprefix("together with ").partition(":")[0]
        return f"motions that tell it from {others}"
    is_motion = "std" in expectation or "std_percent" in expectation
    hardly_shows = expectation.get("verdict") == "does not show"
    is_hardly_judged = _num_refits(run) < _FEW_REFITS and run.has_pictures
    is_hardly_judged &= times is None or times > _AS_TOLD
    if run.is_out_of_time and is_hardly_judged and not hardly_shows:
        return "more minutes"
    if not is_motion and run.object("recordings") and not _has_known_colours(run):
        return "a known colour: --known-colour"
    if hardly_shows:
        return "other motions: these hardly show it"
    if run.is_out_of_time and (times is None or times > _MUCH):
        return "more minutes"
    if expectation.get("verdict") == "shows weakly":
        return "motions that show it more, or more episodes"
    return "more episodes"


def _has_known_colours(run: RunData) -> bool:
    """A camera's response is told by known colours alone, but not without a fit."""
    return bool(run.result.get("camera_responses")) or run.has_known_colours


def _num_refits(run: RunData) -> int:
    return max(map(len, ranks(run).values()), default=0)


def _worse(run: RunData) -> float | None:
    """Largest ratio of a sensor's held-out error to the median of known worlds; None if usual."""
    worst = 0.0
    sensors = run.object("held_out").get("sensors")
    for facts in (sensors if isinstance(sensors, dict) else {}).values():
        if not isinstance(facts, dict):
            continue
        known = sorted(d for d in facts.get("known_worlds", []) if is_number(d) and d > 0)
        if known and is_number(facts.get("distance")):
            worst = max(worst, facts["distance"] / known[len(known) // 2])
    return worst if worst > _WORSE else None
