"""Writes video files: h264 mp4 that browsers play."""

import math
import os
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path
from typing import Any, Self

import av
import av.video.stream
import numpy as np


class VideoWriter:
    """Writes an h264 mp4 frame by frame; the file gets its name only once it is complete.

    Use it as a context manager. The video is yuv420p, which every browser plays and which needs
    even sides: odd ones are padded by repeating the last row or column. `crf` is x264's quality
    (0: lossless, which browsers may refuse; 18: the loss is hardly visible). A keyframe every
    `keyframe_interval` frames makes seeking fast and the file larger; None: x264 decides.
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
        self._shape: tuple[int, ...] = ()
        options = {"movflags": "faststart"}  # a browser may start before it has the whole file
        self._container = av.open(str(self._unfinished), "w", format="mp4", options=options)
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
        if self._stream is None:
            self._shape, self._stream = frame.shape, self._add_stream(*frame.shape[:2])
        if frame.shape != self._shape:
            raise ValueError(f"frame {self.num_frames} is {frame.shape}, the first {self._shape}")
        height, width, _ = frame.shape
        if height % 2 or width % 2:
            frame = np.pad(frame, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
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


def write_video(path: str | Path, frames: Iterable[np.ndarray], fps: float, **options: Any) -> None:
    """Write frames, (T, H, W, 3) uint8 or an iterable of (H, W, 3), as an h264 mp4.

    The file is written completely or not at all. See `VideoWriter` for the options.
    """
    with VideoWriter(path, fps, **options) as video:
        for frame in frames:
            video.write(frame)
