"""Moving parts: distance between video and simulator over time."""

from simtune.before_after.moving_parts import MovingParts
from simtune.report.joint_plots import plot_over_time
from simtune.report.plot import Plot
from simtune.report.trust import CLEARLY
from simtune.run_data import RunData
from simtune.validate import is_number


def moving_parts(run: RunData) -> MovingParts | None:
    """Keypoints in replay.json; None if there are none, or they are invalid."""
    try:
        return MovingParts.from_json(run.replay["keypoints"])
    except (KeyError, TypeError, ValueError):
        return None


def part_distances(run: RunData) -> dict[str, Plot]:
    """{part: its distance, in pixels, between video and simulator, before and after}."""
    known, found = moving_parts(run), {}
    for part, curves in known.distances().items() if known else ():
        title = f"{part}: how far off, before and after"
        if plot := plot_over_time(run, curves, title, "px", zero=True):
            found[part] = plot
    return found


def never_detected(run: RunData) -> list[str]:
    """Parts that the detector is sure of in no picture of the video."""
    return [
        part
        for part, facts in run.object("moving_parts").items()
        if isinstance(facts, dict)
        and not (is_number(facts.get("px")) or is_number(facts.get("px_before")))
    ]


def ends_farther(run: RunData) -> list[str]:
    """Parts that, at the episode's end, are clearly farther from the video than before tuning."""
    found = []
    for part, facts in run.object("moving_parts").items():
        keys = ("end_px_before", "end_px")
        before, after = (facts.get(key) if isinstance(facts, dict) else None for key in keys)
        if is_number(before) and is_number(after) and after > CLEARLY * before:
            found.append(part)
    return found
