"""How a camera's recordings are made: their key, lens and background."""

from collections.abc import Iterable
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Literal

import av.error
import numpy as np

from simtune.cameras.lens import Lens
from simtune.cameras.pictures import as_shown, resize
from simtune.cameras.rectify import rectify
from simtune.errors import InputError

_FRAMES = 200  # used, evenly spread: a median of more is no better
_ASPECT_TOLERANCE = 0.02  # relative difference of width / height


@dataclass(frozen=True, kw_only=True)
class Footage:
    """Properties of one camera's recordings, beyond its pose and field of view."""

    camera: str = ""  # of the model
    name: str = ""  # under which it is observed
    key: str | None = None  # of its videos in recordings; None: the only one, or the one asked for
    lens: Lens | None = None  # None: a pinhole with the model's field of view
    # Background behind all that moves, in place of the model's: a picture by the same camera, or
    # the recordings' own median; "unknown": anything; None: the model's
    background: Path | Literal["recording", "unknown"] | None = None
    latency_s: float = 0.0  # by which a frame shows an earlier moment than its time
    is_square: bool = False  # only the central square is used

    def content(self) -> str:
        """Content from other files, by which a run notices changes."""
        lens = repr(self.lens) if self.lens else ""
        if not isinstance(self.background, Path):
            return lens
        return lens + sha256(self.background.read_bytes()).hexdigest()

    def aspect(self, recorded: tuple[int, ...]) -> float:
        """Width over height of the part that is used; `recorded`: (H, W) of its pictures.

        Raises InputError if a square is asked for, and that part is upright.
        """
        height, width = recorded[:2]
        aspect = self.lens.aspect if self.lens else width / height
        if self.is_square and aspect < 1 - 1e-6:
            raise self._is_upright(f"{width}×{height}", aspect)
        return 1.0 if self.is_square else aspect

    def _is_upright(self, size: str, aspect: float) -> InputError:
        """`size`, in words, is of the whole picture, `aspect` of what is used."""
        expected = "expected one at least as wide as high"
        if not self.lens:
            return InputError(f"the picture is upright, {size}; {expected}; crop it to a square")
        seen = f"upright as a pinhole sees it, {aspect:.3g} times as wide as high; {expected}"
        if not self.lens.region:
            return InputError(
                f"what the lens leaves of the picture of {size} is {seen}; give a region"
            )
        left, top, right, bottom = self.lens.region
        size = f"{right - left:g}×{bottom - top:g}"
        return InputError(f"the region of {size} is {seen}; make it wider or less high")

    def as_pinhole(self, picture: np.ndarray, size: tuple[int, int]) -> np.ndarray:
        """(H, W, 3) as recorded to (height, width) of its `aspect`, as a pinhole camera sees it.

        All of its height is used: MuJoCo's field of view is vertical. Raises InputError for a
        picture that the lens was not calibrated with.
        """
        if self.lens:
            try:
                return rectify(picture, self.lens, size)
            except InputError as error:
                film = f", filmed as {self.key}" if self.key else ""
                raise InputError(
                    f"camera {self.name or self.camera}{film}: {error}, or the video of this camera"
                ) from None
        rows = picture.shape[0]
        return resize(picture, size, (rows, min(rows * size[1] / size[0], picture.shape[1])))

    def plate(self, recorded: Iterable[np.ndarray], size: tuple[int, int]) -> np.ndarray | None:
        """(height, width, 3) uint8 to draw behind what moves; None: the model's
        background, or none that is known.

        `recorded`: (T, height, width, 3) frames of episodes. Raises InputError for a picture that
        cannot be read.
        """
        return median_picture(recorded) if self.background == "recording" else self.picture(size)

    def picture(self, size: tuple[int, int]) -> np.ndarray | None:
        """The plate before anything is recorded: of a picture file; None: there is none.

        Raises InputError for a picture that cannot be read.
        """
        if not isinstance(self.background, Path):
            return None
        picture = _read_picture(self.background)
        self._check_shape(picture.shape, size)
        return self.as_pinhole(picture, size)

    def _check_shape(self, picture: tuple[int, ...], size: tuple[int, int]) -> None:
        """Raise InputError for a background, (H, W, ...), too narrow for (height, width)."""
        (height, width), wanted = picture[:2], size[1] / size[0]
        is_narrow = width / height < wanted * (1 - _ASPECT_TOLERANCE)
        if is_narrow and not self.lens:  # a lens checks by itself
            raise InputError(
                f"{self.background}: {width}×{height}, narrower than the recordings' pictures, "
                f"which are {wanted:.3g} times as wide as high; expected one by the same camera"
            )


PLAIN = Footage()  # a pinhole, with the model's background


def median_picture(recorded: Iterable[np.ndarray]) -> np.ndarray:
    """(H, W, 3) background of episodes of (T, H, W, 3): the median of each pixel."""
    frames = list(recorded)
    begins = np.cumsum([0, *map(len, frames)])
    at = np.linspace(0, begins[-1] - 1, min(_FRAMES, begins[-1])).astype(int)
    episode = np.searchsorted(begins, at, side="right") - 1
    few = [frames[e][t - begins[e]] for e, t in zip(episode, at, strict=True)]
    return np.median(np.stack(few), 0).astype(np.uint8)


def _read_picture(path: Path) -> np.ndarray:
    """(H, W, 3) uint8 RGB."""
    try:
        with av.open(str(path), metadata_errors="ignore") as container:
            frame = next(container.decode(video=0))
    except (OSError, av.error.FFmpegError, StopIteration) as error:
        why = getattr(error, "strerror", None) or "it holds no picture"
        raise InputError(f"{path}: cannot be read as a picture: {why}") from None
    return as_shown(frame.to_ndarray(format="rgb24"), frame)
