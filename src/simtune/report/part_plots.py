"""Moving parts: distance between video and simulator over time."""

from simtune.before_after.moving_parts import MovingParts
from simtune.report.data import RunData
from simtune.report.joint_plots import plot_over_time
from simtune.report.plot import Plot
from simtune.validate import is_number


def moving_parts(run: RunData) -> MovingParts | None:
    """Keypoints in replay.json; None if there are none, or they are invalid."""
    try:
        return MovingParts.from_json(run.replay["keypoints"])
    except (KeyError, TypeError, ValueError):
        return None


def part_plot(run: RunData, part: str) -> Plot | None:
    """Distance, in pixels, of a part in the video and in the simulator, before and after."""
    known = moving_parts(run)
    curves = known.distances().get(part) if known else None
    if not curves:
        return None
    return plot_over_time(run, curves, f"{part}: how far off, before and after", "px", zero=True)


def ends_farther(run: RunData) -> list[str]:
    """Parts that, at the episode's end, are farther from the video after tuning than before."""
    found = []
    for part, facts in run.object("moving_parts").items():
        keys = ("end_px_before", "end_px")
        before, after = (facts.get(key) if isinstance(facts, dict) else None for key in keys)
        if is_number(before) and is_number(after) and after > before:
            found.append(part)
    return found
