"""Facts on recordings, for reports."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from simtune.recordings.steps import Steps


@dataclass(frozen=True, kw_only=True)
class SeenPictures:
    """Of an episode's pictures by one camera."""

    size: tuple[int, int]  # (height, width), pixels
    time_errors_s: tuple[float, float]  # largest and mean distance of frames from their steps
    frame_s: float | None = None  # between frames (median), if they are rarer than steps


def action_ranges(steps: Sequence[Steps], names: Sequence[str]) -> dict[str, list[float]]:
    """{name: [lowest, highest]} action over all episodes."""
    ranges = [
        np.min([its.actions.min(0) for its in steps], 0),
        np.max([its.actions.max(0) for its in steps], 0),
    ]
    return dict(zip(names, np.transpose(ranges).tolist(), strict=True))


def picture_facts(
    steps: Sequence[Steps], pictures: Sequence[SeenPictures], fitted: tuple[int, int]
) -> dict[str, Any]:
    """Facts on the pictures of one camera, of each episode; `fitted`: their (height, width)."""
    frames = np.array([len(its.times_s) for its in steps])
    largest, mean = np.array([its.time_errors_s for its in pictures]).T
    rare_s = [its.frame_s for its in pictures if its.frame_s]
    return {
        "source_size": list(pictures[0].size),
        "image_size": list(fitted),
        "time_error_ms": {
            "largest": round(1e3 * float(largest.max()), 3),
            "mean": round(1e3 * float(mean @ frames / frames.sum()), 3),
        },
        "frame_ms": round(1e3 * max(rare_s), 3) if rare_s else None,
    }
