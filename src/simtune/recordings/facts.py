"""Facts on recordings, for reports."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, kw_only=True)
class SeenPictures:
    size: tuple[int, int]  # (height, width), pixels
    time_errors_s: tuple[float, float]  # largest and mean distance of frames from their steps


@dataclass(frozen=True, kw_only=True)
class Seen:
    """Facts on an episode that was read."""

    num_steps: int
    lowest: np.ndarray  # (A,) actions
    highest: np.ndarray  # (A,) actions
    pictures: Sequence[SeenPictures]  # of each camera; empty if no pictures were read
    gaps_s: Sequence[tuple[float, float]]  # start and end of each, see `find_gaps`
    unused_s: float  # for which the pictures go on after the last action
    unfilmed: int  # last rows for which a video has no frame
    readings_hz: float  # how often the fastest reading was measured; 0: none was


def action_ranges(seen: Sequence[Seen], names: Sequence[str]) -> dict[str, list[float]]:
    """{name: [lowest, highest]} action over all episodes."""
    ranges = [np.min([s.lowest for s in seen], 0), np.max([s.highest for s in seen], 0)]
    return dict(zip(names, np.transpose(ranges).tolist(), strict=True))


def picture_facts(seen: Sequence[Seen], camera: int, fitted: tuple[int, int]) -> dict[str, Any]:
    """Facts on the pictures of one camera, by its number; `fitted`: their (height, width)."""
    pictures = [s.pictures[camera] for s in seen]
    frames = np.array([s.num_steps + 1 for s in seen])
    largest, mean = np.array([p.time_errors_s for p in pictures]).T
    return {
        "source_size": list(pictures[0].size),
        "image_size": list(fitted),
        "time_error_ms": {
            "largest": round(1e3 * float(largest.max()), 3),
            "mean": round(1e3 * float(mean @ frames / frames.sum()), 3),
        },
    }
