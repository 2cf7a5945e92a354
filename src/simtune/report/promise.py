"""What could have been told of each parameter, beside what came out, why, and what would help."""

import math
from typing import Any, NamedTuple

from simtune.report.data import RunData
from simtune.report.trust import ranks
from simtune.report.words import number, unit
from simtune.tuning.range_update import RangeUpdateConfig
from simtune.validate import is_number

_90 = 1.645  # standard deviations
_MUCH = 3.0  # times as wide: worth a reason
_FEW_REFITS = 4
_AS_TOLD = 1.5  # times as wide: more time would hardly make it narrower
_WORSE = 1.2  # times as far off as known worlds
_ASSUMED_PX = 0.5  # by which `check` takes a detector to be off


class Promise(NamedTuple):
    """Of a parameter, in words."""

    name: str
    at_best: str  # half of the 90 % interval, as `check` has it
    found: str
    times: float | None  # as wide
    help: str  # what would tell more; empty: nothing is missing


def compare(run: RunData) -> list[Promise]:
    """Of all that `check` put in figures; of colours, which it does not, where they are wide."""
    checked, found = run.object("check"), []
    narrow = RangeUpdateConfig.identified_share
    for name, facts in run.parameters.items():
        its = checked.get(name)
        if not isinstance(its, dict) or not run.result:
            continue
        promise = _of(run, name, facts, its)
        share = facts.get("interval_share")
        if promise.times is not None or (is_number(share) and share > narrow):
            found.append(promise)
    return found


def reasons(run: RunData) -> list[str]:
    """Why intervals are wider than at best, a sentence each, of what the run knows."""
    num, said = _num_refits(run), []
    if not run.has_pictures:
        return ["What the model leaves of the readings, and episodes that disagree, widen them."]
    if num < _FEW_REFITS:
        fitted = f"only {num}" if num else "no"
        said.append(
            f"There was time for {fitted} known world{'s' * (num != 1)} to compare with, and the "
            "fewer, the wider intervals are."
        )
    if worse := _worse(run):
        said.append(
            f"Where it was tested, the tuned simulator is {worse:.1f} times as far off as known "
            "worlds are: the model lacks something, and intervals are wider for it."
        )
    error = run.get("detector/error_px")
    if is_number(error) and error > _ASSUMED_PX:
        said.append(
            f"The detector is off by {number(error)} pixels in these pictures; simtune check "
            f"takes {_ASSUMED_PX:g}. A larger --image-size, or a region, would show more."
        )
    if run.is_out_of_time:
        said.append(
            "The time was over: with more, a fit follows more stretches of the episodes. The same "
            "command with a larger --budget-minutes goes on from here."
        )
    return said or [
        "The best fit takes every stretch of every episode and errs by its noise alone. How far "
        "real fits are off was measured in known worlds, and that is what intervals are made of."
    ]


def _of(run: RunData, name: str, facts: dict[str, Any], its: dict[str, Any]) -> Promise:
    at_best, half, what = None, None, f" {unit(facts)}".rstrip()
    low, high = facts.get("low"), facts.get("high")
    if is_number(std := its.get("std_percent")):
        at_best, what = _90 * std, " %"
        if is_number(low) and is_number(high) and low > 0:
            half = 50 * math.log(high / low)
    elif is_number(std := its.get("std")):
        at_best = _90 * std
        half = (high - low) / 2 if is_number(low) and is_number(high) else None
    times = half / at_best if half and at_best else None
    said = "seen in pictures" if at_best is None else f"±{number(at_best)}{what}"
    found = "" if half is None else f"±{number(half)}{what}"
    return Promise(name, said, found, times, _help(run, facts, its, times))


def _help(run: RunData, facts: dict[str, Any], its: dict[str, Any], times: float | None) -> str:
    """What would tell more of a parameter that is not identified."""
    if facts.get("verdict") not in ("weak", "not identifiable"):
        return ""
    if run.object("held_out").get("passed") is False:
        return "first find what the model lacks"
    note = its.get("note")
    if isinstance(note, str) and note.startswith("together with "):
        others = note.removeprefix("together with ").partition(":")[0]
        return f"motions that tell it from {others}"
    is_motion = "std" in its or "std_percent" in its
    if not is_motion and run.object("recordings") and not run.result.get("camera_responses"):
        return "a known colour: --known-colour"
    if its.get("verdict") == "does not show":
        return "other motions: these hardly show it"
    is_hardly_judged = _num_refits(run) < _FEW_REFITS and run.has_pictures
    is_hardly_judged &= times is None or times > _AS_TOLD
    if run.is_out_of_time and (is_hardly_judged or times is None or times > _MUCH):
        return "more minutes"
    if its.get("verdict") == "shows weakly":
        return "motions that show it more, or more episodes"
    return "more episodes"


def _num_refits(run: RunData) -> int:
    return max(map(len, ranks(run).values()), default=0)


def _worse(run: RunData) -> float | None:
    """How many times as far off as known worlds in the median, where that is more than usual."""
    worst = 0.0
    sensors = run.object("held_out").get("sensors")
    for its in (sensors if isinstance(sensors, dict) else {}).values():
        known = sorted(d for d in its.get("known_worlds", []) if is_number(d) and d > 0)
        if known and is_number(its.get("distance")):
            worst = max(worst, its["distance"] / known[len(known) // 2])
    return worst if worst > _WORSE else None
