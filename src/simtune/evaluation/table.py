"""The output of `simtune evaluate RUN --real DIR`."""

from typing import Any

from simtune.columns import aligned, counted
from simtune.recordings.source import short
from simtune.report.trust import readings_farther
from simtune.report.words import MISSING, diverging, further_off
from simtune.validate import is_number


def table(result: dict[str, Any]) -> list[str]:
    """A table in lines of plain text, and what is to be said of it."""
    sensors, episodes = result["sensors"], result["episodes"]
    head = ("reading", "before", "after", "", "better in")
    rows = [head, *(_cells(name, its, episodes) for name, its in sensors.items())]
    lines = [
        f"root mean square of what open-loop replays of {counted(episodes, 'episode')} leave, "
        "before and after tuning:",
        *aligned(rows, left=[0]),
    ]
    if unknown := result.get("no_offset"):
        lines.append(
            f"note: the run looked at no readings, so it knows no offset of {short(unknown)}: 0 is "
            "assumed"
        )
    if far := result.get("far_off"):
        worst = max(far, key=lambda name: sensors[name]["rms"] / sensors[name]["rms_tuned_to"])
        its = sensors[worst]
        where = f" in {short(result['far_episodes'])}" if result.get("far_episodes") else ""
        contacts = result.get("touching")
        asks = f"In their replays {contacts} If it is so, are" if contacts else "Are"
        lines.append(
            f"warning: far more is left{where} than of the recordings that the run was tuned to "
            f"({worst}: {its['rms']:.3g} {its['unit']} instead of {its['rms_tuned_to']:.3g}). "
            f"{asks} these of the same robot, with the same columns, in the same order and units?"
        )
    astray = result.get("astray")
    lines += [f"note: {said}" for said in diverging(sensors, episodes)]
    worse = readings_farther(sensors)
    if worse and not astray:
        lines.append(
            f"warning: {further_off(worse)} on these recordings: what was found does not hold "
            "here; the run's own warnings may say why"
        )
    if astray:
        lines.append(
            f"note: replays are off by more than the whole travel of {short(astray)}: if the robot "
            "is unstable open loop, such as one that balances, these numbers say little"
        )
    return lines


def _cells(name: str, its: dict[str, Any], episodes: int) -> tuple[str, ...]:
    before, after = its["rms_before"], its["rms"]
    known = [f"{rms:.3g} {its['unit']}" if is_number(rms) else MISSING for rms in (before, after)]
    change = ""
    if is_number(before) and is_number(after) and before > 0:
        change = f"{100 * (after / before - 1):+.0f} %"
    return (name, *known, change, f"{its['better_in']} of {episodes}")
