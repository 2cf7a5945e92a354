"""How a camera's recordings come about: under which key, through which lens, before what."""

from collections.abc import Iterable
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Literal

import av.error
import numpy as np

from simtune.errors import InputError
from simtune.lens import Lens
from simtune.pictures import middle_square, resize

_FRAMES = 200  # looked at, evenly spread: a median of more is no better


@dataclass(frozen=True, kw_only=True)
class Footage:
    """What recordings of one camera are, beyond its pose and field of view."""

    key: str | None = None  # of its videos in recordings; None: the only one, or what is asked for
    lens: Lens | None = None  # None: a pinhole, whose field of view the model says
    # What stands still behind all that moves, in place of what the model has there: a picture by
    # the same camera, or the recordings' own median; None: what the model has
    background: Path | Literal["recording"] | None = None

    def content(self) -> str:
        """What of it stands in other files, by which a run notices that it is another one."""
        lens = repr(self.lens) if self.lens else ""
        if not isinstance(self.background, Path):
            return lens
        return lens + sha256(self.background.read_bytes()).hexdigest()

    def square(self, picture: np.ndarray, side: int) -> np.ndarray:
        """(H, W, 3) as recorded to (side, side, 3) as a square pinhole camera sees it.

        Raises InputError for a picture that the lens was not calibrated with.
        """
        if self.lens:
            return self.lens.rectify(picture, side)
        return resize(middle_square(picture), (side, side))

    def plate(self, recorded: Iterable[np.ndarray], side: int) -> np.ndarray | None:
        """(side, side, 3) uint8 to draw behind what moves; None: what the model has.

        `recorded`: (T, side, side, 3) frames of episodes. Raises InputError for a picture that
        cannot be read.
        """
        if self.background is None:
            return None
        if isinstance(self.background, Path):
            return self.square(_read_picture(self.background), side)
        return median_picture(recorded)


PLAIN = Footage()  # of a pinhole, before what the model has


def median_picture(recorded: Iterable[np.ndarray]) -> np.ndarray:
    """(H, W, 3) what stands still in episodes of (T, H, W, 3): the median at each pixel."""
    frames = list(recorded)
    every = np.cumsum([0, *map(len, frames)])
    at = np.linspace(0, every[-1] - 1, min(_FRAMES, every[-1])).astype(int)
    episode = np.searchsorted(every, at, side="right") - 1
    few = [frames[e][t - every[e]] for e, t in zip(episode, at, strict=True)]
    return np.median(np.stack(few), 0).astype(np.uint8)


def _read_picture(path: Path) -> np.ndarray:
    """(H, W, 3) uint8 RGB."""
    try:
        with av.open(str(path)) as container:
            frame = next(container.decode(video=0))
    except (OSError, av.error.FFmpegError, StopIteration) as error:
        why = getattr(error, "strerror", None) or "it holds no picture"
        raise InputError(f"{path}: cannot be read as a picture: {why}") from None
    return frame.to_ndarray(format="rgb24")
