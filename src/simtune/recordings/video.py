"""Reads video files: every frame, or the frames at given times."""

import contextlib
import itertools
from collections.abc import Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any, NamedTuple

import av
import av.container
import av.error
import av.video.stream
import numpy as np
from av.video.reformatter import Interpolation

from simtune.cameras.pictures import as_shown
from simtune.errors import InputError

# swscale's default conversion from YUV to RGB rounds down (colours are 1 of 255 too dark) and does
# not smooth chroma. This one halves the error at the same speed; PyAV before 18 does not have it.
TO_RGB: dict[str, Any] = {"format": "rgb24", "interpolation": "BICUBIC"}
if hasattr(Interpolation, "ACCURATE_RND"):
    TO_RGB["interpolation"] = (
        Interpolation.BICUBIC | Interpolation.ACCURATE_RND | Interpolation.FULL_CHR_H_INT
    )
    TO_RGB["threads"] = 1

# 8K. A decoder holds a dozen pictures, of whatever size the file claims.
MOST_PIXELS = 7680 * 4320
_HDR = (16, 18)  # transfer functions PQ and HLG, as H.273 numbers them


def codec_of(path: str | Path) -> str:
    """Of the file's first video stream, e.g. "h264". Raises InputError if there is none."""
    with _open(path) as (_, stream):
        return stream.codec.canonical_name  # not the decoder's name, such as libdav1d


def decode(path: str | Path) -> Iterator[tuple[float, np.ndarray]]:
    """Every frame of a video in presentation order.

    Yields (time, picture): seconds since the first frame, and (H, W, 3) uint8 RGB.

    Raises:
        InputError: the file is missing or is no video, or its content is damaged.
    """
    for shown in _decode(path):
        yield shown.time_s, shown.to_rgb()


def frame_times(path: str | Path) -> np.ndarray:
    """(F,) presentation times of the frames, seconds since the first; nothing is decoded.

    Raises:
        InputError: the file is missing or is no video, or its content is damaged.
    """
    with _open(path) as (container, stream):
        try:
            packets = (p for p in container.demux(stream) if p.size and not p.is_discard)
            shown = sorted(packet.pts for packet in packets if packet.pts is not None)
        except av.error.FFmpegError as error:
            raise InputError(f"{path}: {error.strerror}; copy the file again") from None
        if not shown or stream.time_base is None:
            raise InputError(f"{path}: holds no frame; copy the file again or record anew")
        return (np.array(shown) - shown[0]) * float(stream.time_base)


def frames_at(
    path: str | Path, times_s: Sequence[float], *, tolerance_s: float
) -> Iterator[tuple[float, np.ndarray]]:
    """The frame nearest to each time, decoded in one pass and held one at a time.

    `times_s` are seconds since the file's first frame, in rising order. Yields (time, picture) for
    each: the frame's presentation time, and (H, W, 3) uint8 RGB.

    Raises:
        InputError: the file is missing or is no video, its content is damaged, or no frame is
            shown within `tolerance_s` (exclusive) of a time.
    """
    assert all(a <= b for a, b in itertools.pairwise(times_s)), "times must rise"
    frames = _decode(path, next(iter(times_s), 0.0) - tolerance_s)
    nearest, following = next(frames, None), next(frames, None)
    for time_s in times_s:
        # Presentation times rise, so a frame is the nearest once the following one is farther away.
        while (
            nearest and following and abs(following.time_s - time_s) < abs(nearest.time_s - time_s)
        ):
            nearest, following = following, next(frames, None)
        if nearest is None or abs(nearest.time_s - time_s) >= tolerance_s:
            if nearest and not following:
                raise InputError(
                    f"{path}: ends at {nearest.time_s:g} s, and a row asks for the frame at "
                    f"{time_s:g} s: there are fewer frames than rows; copy the file again, or "
                    "leave the episode out (--leave-out)"
                )
            raise InputError(
                f"{path}: no frame is shown within {tolerance_s:.3g} s of {time_s:g} s; "
                "the video is truncated or lacks frames, copy the file again"
            )
        yield nearest.time_s, nearest.to_rgb()


class _Shown(NamedTuple):
    """A decoded frame."""

    time_s: float  # seconds since the first frame
    frame: av.VideoFrame
    pixel_aspect: Fraction  # width over height of a stored pixel

    def to_rgb(self) -> np.ndarray:
        """(H, W, 3) uint8 as a player shows it: square pixels, turned as a phone was held."""
        width = _square(self.frame.width, self.pixel_aspect)
        # One thread: otherwise swscale starts new ones for each frame, and takes ten times longer.
        pixels = self.frame.to_ndarray(width=width, **TO_RGB)
        return as_shown(pixels, self.frame)


def _square(width: int, pixel_aspect: Fraction) -> int:
    """The width in square pixels of a row of `width` pixels, whose height is kept."""
    return max(1, round(width * pixel_aspect))


def _pixel_aspect(stream: av.video.stream.VideoStream) -> Fraction:
    return stream.sample_aspect_ratio or Fraction(1)  # 0: not said


def _decode(path: str | Path, from_s: float = 0.0) -> Iterator[_Shown]:
    """Frames in presentation order.

    Those before `from_s` are skipped as far as the file's keyframes allow.
    """
    reached_s = 0.0
    with _open(path) as (container, stream):
        stream.thread_type = "AUTO"
        try:
            frames = container.decode(stream)
            first = next(frames, None)
            if first is None or first.time is None:
                return
            # Files without an edit list start late by the reordering delay of B-frames.
            start_s = first.time
            frames = itertools.chain([first], frames)
            if from_s > 0:
                frames = _seek(container, stream, start_s + from_s)
            for frame in frames:
                # A decoder makes up pictures for missing data: never use those.
                if frame.time is None or frame.is_corrupt:
                    raise InputError(
                        f"{path}: the frame after {reached_s:g} s is damaged; copy the file again"
                    )
                reached_s = frame.time - start_s
                yield _Shown(reached_s, frame, _pixel_aspect(stream))
        except av.error.FFmpegError as error:
            raise InputError(
                f"{path}: cannot be decoded beyond {reached_s:g} s ({error.strerror}); "
                "copy the file again or record anew"
            ) from None


def _seek(
    container: av.container.InputContainer, stream: av.video.stream.VideoStream, time_s: float
) -> Iterator[av.VideoFrame]:
    """Frames starting at the last keyframe before a presentation time."""
    assert stream.time_base is not None
    container.seek(int(time_s / stream.time_base), stream=stream)
    # The first frames may depend on skipped ones, and are then marked as corrupt.
    frames = itertools.dropwhile(lambda frame: frame.is_corrupt, container.decode(stream))
    first = next(frames, None)
    if first is not None and first.time is not None and first.time <= time_s:
        return itertools.chain([first], frames)
    container.seek(stream.start_time or 0, stream=stream)  # the index is wrong: read everything
    return container.decode(stream)


@contextlib.contextmanager
def _open(
    path: str | Path,
) -> Iterator[tuple[av.container.InputContainer, av.video.stream.VideoStream]]:
    """The file and its first video stream. Raises InputError if it has none."""
    try:
        container = av.open(str(path), metadata_errors="ignore")  # a title may be in Latin-1
    except (av.error.FFmpegError, OSError) as error:
        if not Path(path).exists():
            raise InputError(f"{path}: no such video") from None
        raise InputError(
            f"{path}: not a readable video ({error.strerror}); it may be truncated, "
            "copy the file again"
        ) from None
    with container:
        if not container.streams.video:
            raise InputError(f"{path}: holds no video stream")
        stream = container.streams.video[0]
        if stream.codec_context is None:  # PyAV's types know nothing of it
            raise InputError(f"{path}: no decoder for its codec; convert it to h264")
        width = _square(stream.codec_context.width, _pixel_aspect(stream))
        height = stream.codec_context.height
        if width * height > MOST_PIXELS:
            raise InputError(
                f"{path}: pictures of {width}×{height} pixels; expected at most 7680×4320, "
                "make the video smaller"
            )
        if stream.codec_context.color_trc in _HDR:
            raise InputError(
                f"{path}: its colours are HDR, which looks flat and grey on a plain screen; record "
                "in SDR, or convert it (for example with FFmpeg's zscale and tonemap)"
            )
        # Decoded pictures may be larger than the file claims.
        stream.codec_context.options = {"max_pixels": str(MOST_PIXELS)}
        yield container, stream
