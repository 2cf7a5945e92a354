"""Last rows of an episode for which its video has no frame: some recorders lose one or two."""

from pathlib import Path

import numpy as np

from simtune.errors import InputError
from simtune.recordings import video
from simtune.recordings.source import MOST_UNFILMED

# Of a frame, a little more than half: midway between two frames, either is accepted.
NEAR = 0.51


def num_unfilmed(seen_s: np.ndarray, asked_s: np.ndarray, until_s: float, fps: float) -> int:
    """How many of the last rows of an episode, whose frames are due at (T,) times, have none.

    `seen_s`: (F,) times of its video's frames, which are another episode's from `until_s` on. 0 if
    more rows have none than recorders lose: reading the pictures then says so.
    """
    if not len(seen_s):
        return 0
    after = np.searchsorted(seen_s, asked_s).clip(max=len(seen_s) - 1)
    beside_s = seen_s[np.stack([after, (after - 1).clip(0)])]
    is_near = np.abs(beside_s - asked_s).min(0) < NEAR / fps
    is_shown = is_near & (asked_s <= until_s - 0.5 / fps)
    num = int(is_shown[::-1].argmax())  # 0 as well if none is shown
    return num if num <= MOST_UNFILMED else 0


def shown_s(path: Path) -> np.ndarray:
    """(F,) times of a video's frames; none if it cannot be read, which decoding it will explain."""
    try:
        return video.frame_times(path)
    except InputError:
        return np.empty(0)
