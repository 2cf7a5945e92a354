"""What to note down of recordings, for reports and to know them again."""

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
    """What is to be noted down of an episode."""

    num_steps: int
    lowest: np.ndarray  # (A,) of the actions
    highest: np.ndarray  # (A,)
    pictures: SeenPictures | None  # None: none was looked at


def action_ranges(seen: Sequence[Seen], names: Sequence[str]) -> dict[str, list[float]]:
    """{name: [lowest, highest]} of all episodes."""
    ranges = [np.min([s.lowest for s in seen], 0), np.max([s.highest for s in seen], 0)]
    return dict(zip(names, np.transpose(ranges).tolist(), strict=True))


def picture_facts(seen: Sequence[Seen], image_size: tuple[int, int] | int | None) -> dict[str, Any]:
    """Of pictures that are resized to `image_size`; null where none was looked at."""
    pictures = [s.pictures for s in seen if s.pictures]
    if not pictures:
        return dict.fromkeys(("source_size", "image_size", "time_error_ms"))
    size = image_size or pictures[0].size
    frames = np.array([s.num_steps + 1 for s in seen])
    largest, mean = np.array([p.time_errors_s for p in pictures]).T
    return {
        "source_size": list(pictures[0].size),
        "image_size": [size, size] if isinstance(size, int) else list(size),
        "time_error_ms": {
            "largest": round(1e3 * float(largest.max()), 3),
            "mean": round(1e3 * float(mean @ frames / frames.sum()), 3),
        },
    }
