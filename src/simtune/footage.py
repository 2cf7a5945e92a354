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
from simtune.pictures import resize

_FRAMES = 200  # looked at, evenly spread: a median of more is no better


@dataclass(frozen=True, kw_only=True)
class Footage:
    """What recordings of one camera are, beyond its pose and field of view."""

    camera: str = ""  # the model's, that films so
    name: str = ""  # by which it is observed
    key: str | None = None  # of its videos in recordings; None: the only one, or what is asked for
    lens: Lens | None = None  # None: a pinhole, whose field of view the model says
    # What stands still behind all that moves, in place of what the model has there: a picture by
    # the same camera, or the recordings' own median; None: what the model has
    background: Path | Literal["recording"] | None = None
    latency_s: float = 0.0  # by which a frame shows what was earlier than it says
    is_square: bool = False  # only the middle is looked at, as wide as it is high

    def content(self) -> str:
        """What of it stands in other files, by which a run notices that it is another one."""
        lens = repr(self.lens) if self.lens else ""
        if not isinstance(self.background, Path):
            return lens
        return lens + sha256(self.background.read_bytes()).hexdigest()

    def aspect(self, recorded: tuple[int, ...]) -> float:
        """Width over height of what is looked at; `recorded`: (H, W) of its pictures.

        Raises InputError where a square is asked for, and the picture is upright.
        """
        height, width = recorded[:2]
        aspect = self.lens.aspect if self.lens else width / height
        if self.is_square and aspect < 1 - 1e-6:
            raise InputError(
                f"the picture is upright, {width}×{height}; expected one at least as wide as high; "
                "crop it to a square"
            )
        return 1.0 if self.is_square else aspect

    def fit(self, picture: np.ndarray, size: tuple[int, int]) -> np.ndarray:
        """(H, W, 3) as recorded as a pinhole camera sees it, in (height, width) of its `aspect`.

        It is whole in height: MuJoCo's field of view is vertical. Raises InputError for a picture
        that the lens was not calibrated with.
        """
        if self.lens:
            return self.lens.rectify(picture, size)
        rows = picture.shape[0]
        return resize(picture, size, (rows, min(rows * size[1] / size[0], picture.shape[1])))

    def plate(self, recorded: Iterable[np.ndarray], size: tuple[int, int]) -> np.ndarray | None:
        """(height, width, 3) uint8 to draw behind what moves; None: what the model has.

        `recorded`: (T, height, width, 3) frames of episodes. Raises InputError for a picture that
        cannot be read.
        """
        if self.background is None:
            return None
        if isinstance(self.background, Path):
            return self.fit(_read_picture(self.background), size)
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
