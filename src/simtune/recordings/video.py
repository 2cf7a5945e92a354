"""Video files in and out: frames at given times, resized; h264 mp4 that browsers play."""

import functools
import itertools
import math
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Self

import av
import av.container
import av.error
import av.video.stream
import numpy as np
from av.video.reformatter import Interpolation

from simtune.errors import InputError

# swscale's default way from YUV to RGB rounds down: every colour 1 of 255 too dark, and chroma
# unsmoothed. This one halves the error at the same speed.
_ACCURATE = Interpolation.BICUBIC | Interpolation.ACCURATE_RND | Interpolation.FULL_CHR_H_INT


@dataclass(frozen=True, kw_only=True)
class VideoFacts:
    codec: str  # e.g. "h264"
    height: int  # pixels
    width: int  # pixels


def probe(path: str | Path) -> VideoFacts:
    """What the file's first video stream says of itself; InputError where there is none."""
    with _open(path) as container:
        stream = _video_stream(container, path)
        return VideoFacts(
            codec=stream.codec_context.name,
            height=stream.codec_context.height,
            width=stream.codec_context.width,
        )


def decode(path: str | Path) -> Iterator[tuple[float, np.ndarray]]:
    """Every frame of a video in the order of showing.

    Yields (time, picture): seconds since the first frame, and (H, W, 3) uint8 RGB.

    Raises:
        InputError: the file is missing or is no video, or its content is damaged.
    """
    for time_s, frame in _decode(path):
        yield time_s, _to_rgb(frame)


def frames_at(
    path: str | Path, times_s: Sequence[float], *, tolerance_s: float
) -> Iterator[np.ndarray | None]:
    """The frame nearest to each time, decoded in one pass and held one at a time.

    `times_s` are seconds since the file's first frame, in rising order. Yields for each of
    them (H, W, 3) uint8 RGB, or None where no frame lies within `tolerance_s` (exclusive).

    Raises:
        InputError: the file is missing or is no video, or its content is damaged.
    """
    assert all(a <= b for a, b in itertools.pairwise(times_s)), "times must rise"
    wanted = iter(times_s)
    time_s = next(wanted, None)
    nearest: tuple[float, av.VideoFrame] | None = None  # the latest frame seen so far

    def picture(time_s: float) -> np.ndarray | None:
        if nearest is None or abs(nearest[0] - time_s) >= tolerance_s:
            return None
        return _to_rgb(nearest[1])

    for shown_s, frame in _decode(path):
        # Shown times rise, so the latest frame is the nearest once the next one is farther.
        while (
            time_s is not None
            and nearest is not None
            and abs(nearest[0] - time_s) <= abs(shown_s - time_s)
        ):
            yield picture(time_s)
            time_s = next(wanted, None)
        if time_s is None:
            return
        nearest = (shown_s, frame)
    while time_s is not None:
        yield picture(time_s)
        time_s = next(wanted, None)


def resize(frame: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Resize by area averaging (anti-aliased), each axis on its own.

    `frame` is (H, W, 3) uint8, `size` the new (height, width); gives (height, width, 3) uint8.
    At whole factors every new pixel is the plain mean of the block that it covers.
    """
    # swscale's own AREA would average in subsampled YUV, which is off at coloured edges.
    if frame.shape[:2] == tuple(size):
        return frame
    rows, columns = (_area_taps(*lengths) for lengths in zip(frame.shape, size, strict=False))
    # A matrix product would do it too, and would wake all of BLAS's threads for each frame.
    shrunk = sum(weight[:, None, None] * frame[index] for index, weight in rows)
    assert isinstance(shrunk, np.ndarray)
    shrunk = sum(weight[:, None] * shrunk[:, index] for index, weight in columns)
    return np.rint(shrunk).astype(np.uint8)


class VideoWriter:
    """An h264 mp4 written frame by frame; appears under its name only once it is complete.

    Use it as a context manager. The video is yuv420p, which every browser plays, and needs an
    even height and width: an odd one is padded by repeating the last row or column.
    `crf` is x264's quality (0 lossless, which browsers may refuse; 18 hardly visible). A keyframe
    every `keyframe_interval` frames makes seeking fast and the file larger; None: x264 decides.
    """

    def __init__(
        self, path: str | Path, fps: float, *, crf: int = 18, keyframe_interval: int | None = None
    ):
        if not (math.isfinite(fps) and fps > 0):
            raise ValueError(f"fps must be a positive number, got {fps}")
        self.path = Path(path)
        self.num_frames = 0
        self._unfinished = self.path.with_name(f".{self.path.name}.{os.getpid()}.part")
        self._rate = Fraction(fps).limit_denominator(100_000)
        self._options = {"crf": str(crf)}
        if keyframe_interval is not None:
            self._options["g"] = str(keyframe_interval)
        self._shape: tuple[int, ...] | None = None
        self._container = av.open(
            str(self._unfinished),
            "w",
            format="mp4",
            options={"movflags": "faststart"},  # a browser may start before it has all
        )
        self._stream: av.video.stream.VideoStream | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, exc_type: type[BaseException] | None, *_: object) -> None:
        try:
            if exc_type is None:
                self._finish()
        finally:
            self._container.close()
            self._unfinished.unlink(missing_ok=True)

    def write(self, frame: np.ndarray) -> None:
        """Append one (H, W, 3) uint8 RGB picture, shown for 1/fps seconds."""
        if frame.dtype != np.uint8 or frame.ndim != 3 or frame.shape[-1] != 3:
            raise ValueError(
                f"a frame must be uint8 (H, W, 3), got {frame.dtype} {tuple(frame.shape)}"
            )
        if self._shape is None:
            self._shape = frame.shape
            self._stream = self._add_stream(frame.shape[0], frame.shape[1])
        elif frame.shape != self._shape:
            raise ValueError(f"frame {self.num_frames} is {frame.shape}, the first {self._shape}")
        assert self._stream is not None
        if frame.shape[0] % 2 or frame.shape[1] % 2:
            frame = np.pad(
                frame, ((0, frame.shape[0] % 2), (0, frame.shape[1] % 2), (0, 0)), mode="edge"
            )
        picture = av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), format="rgb24")
        picture.pts = self.num_frames
        picture.time_base = 1 / self._rate
        self._container.mux(self._stream.encode(picture))
        self.num_frames += 1

    def _finish(self) -> None:
        if self._stream is None:
            raise ValueError("a video needs at least one frame")
        self._container.mux(self._stream.encode(None))
        self._container.close()
        os.replace(self._unfinished, self.path)

    def _add_stream(self, height: int, width: int) -> av.video.stream.VideoStream:
        stream = self._container.add_stream("libx264", rate=self._rate, options=self._options)
        stream.height, stream.width = height + height % 2, width + width % 2
        stream.pix_fmt = "yuv420p"
        return stream


def write_video(
    path: str | Path,
    frames: Iterable[np.ndarray],
    fps: float,
    *,
    crf: int = 18,
    keyframe_interval: int | None = None,
) -> None:
    """Write frames, (T, H, W, 3) uint8 or an iterable of (H, W, 3), as an h264 mp4.

    The file appears whole or not at all. See `VideoWriter` for the options.
    """
    with VideoWriter(path, fps, crf=crf, keyframe_interval=keyframe_interval) as video:
        for frame in frames:
            video.write(frame)


def _decode(path: str | Path) -> Iterator[tuple[float, av.VideoFrame]]:
    """(seconds since the first frame, frame) in the order of showing."""
    start_s: float | None = None
    num_frames = 0
    with _open(path) as container:
        stream = _video_stream(container, path)
        stream.thread_type = "AUTO"
        try:
            for frame in container.decode(stream):
                # A decoder conceals what is missing by making pictures up: never use those.
                if frame.pts is None or frame.is_corrupt:
                    raise InputError(f"{path}: frame {num_frames} is damaged; copy the file again")
                # Files without an edit list start late by the reordering delay of B-frames.
                start_s = frame.time if start_s is None else start_s
                num_frames += 1
                yield frame.time - start_s, frame
        except av.error.FFmpegError as error:
            raise InputError(
                f"{path}: cannot be decoded beyond {num_frames} frames ({error.strerror}); "
                "copy the file again or record anew"
            ) from None


def _to_rgb(frame: av.VideoFrame) -> np.ndarray:
    """(H, W, 3) uint8."""
    # One thread: swscale else starts threads anew for each frame, which costs ten times more.
    return frame.to_ndarray(format="rgb24", interpolation=_ACCURATE, threads=1)


def _open(path: str | Path) -> av.container.InputContainer:
    try:
        return av.open(str(path))
    except (av.error.FFmpegError, OSError) as error:
        if not Path(path).exists():
            raise InputError(f"{path}: no such video") from None
        raise InputError(
            f"{path}: not a readable video ({error.strerror}); it may be truncated, "
            "copy the file again"
        ) from None


def _video_stream(
    container: av.container.InputContainer, path: str | Path
) -> av.video.stream.VideoStream:
    if not container.streams.video:
        raise InputError(f"{path}: holds no video stream")
    return container.streams.video[0]


@functools.cache
def _area_taps(size: int, new_size: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Which old pixels each new one covers, and how much of it they make up.

    Gives pairs (index, weight), each (new_size,): new = sum of weight * old[index].
    """
    edges = np.arange(new_size + 1) * (size / new_size)
    first = np.floor(edges[:-1]).astype(int)
    taps = []
    for index in range(size):
        pixel = first + index
        overlap = np.minimum(edges[1:], pixel + 1) - np.maximum(edges[:-1], pixel)
        if not (overlap > 1e-9).any():
            break
        weight = (overlap.clip(0) * (new_size / size)).astype(np.float32)
        taps.append((pixel.clip(max=size - 1), weight))
    return taps
