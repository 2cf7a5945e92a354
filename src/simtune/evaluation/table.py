"""The output of `simtune evaluate RUN --real DIR`."""

from typing import Any

from simtune.columns import aligned, counted


def table(result: dict[str, Any]) -> list[str]:
    """A table in lines of plain text, and a line if tuning made a reading's replay worse."""
    sensors, episodes = result["sensors"], result["episodes"]
    head = ("reading", "before", "after", "", "better in")
    rows = [head, *(_cells(name, its, episodes) for name, its in sensors.items())]
    lines = [
        f"root mean square of what open-loop replays of {counted(episodes, 'episode')} leave, "
        "before and after tuning:",
        *aligned(rows, left=[0]),
    ]
    if worse := [name for name, its in sensors.items() if its["rms"] > its["rms_before"]]:
        lines.append(
            f"warning: after tuning, {', '.join(worse)} is further off than before on these "
            "recordings: what was found does not hold here; the run's own warnings may say why"
        )
    return lines


def _cells(name: str, its: dict[str, Any], episodes: int) -> tuple[str, ...]:
    before, after, unit = its["rms_before"], its["rms"], its["unit"]
    change = f"{100 * (after / before - 1):+.0f} %" if before else ""
    return (
        name,
        f"{before:.3g} {unit}",
        f"{after:.3g} {unit}",
        change,
        f"{its['better_in']} of {episodes}",
    )
