"""The pictures of recordings: frames of one or several cameras, equally high and side by side."""

import functools
from collections.abc import Generator, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from simtune.cameras.footage import Footage
from simtune.cameras.views import width_of
from simtune.errors import InputError
from simtune.recordings.facts import SeenPictures, picture_facts
from simtune.recordings.source import Rows, Source
from simtune.recordings.steps import Steps

# Different frames to steps. A phone's at 30 Hz, up to 8 ms early or late, are 0.85 to 1 at 30 Hz,
# where some are passed over, so that those seen are farther apart than all are.
_MAX_RARE_SHARE = 0.8


class Shot(NamedTuple):
    """A camera's pictures and their description."""

    source: Source  # opened for this camera
    footage: Footage


class Film:
    """The shots of all cameras, of the same episodes."""

    def __init__(self, shots: Sequence[Shot], where: str):
        """`where`: the recordings' path, for messages. Raises ValueError without pictures."""
        if any(source.camera is None for source, _ in shots):
            raise ValueError("the source was opened without pictures")
        self._shots, self._where, self._first = shots, where, shots[0].source.kept[0]

    @property
    def files(self) -> list[Path]:
        """All files that the content depends on."""
        return sorted({path for source, _ in self._shots for path in source.files})

    def seen_rows(self, episode: int, read: Source, rows: Rows) -> Rows:
        """The same rows, up to when every camera shows the episode; what comes later is not seen.

        `rows` were read from the source `read`, and are not read again.
        Raises InputError if a camera's pictures do not fit the episode.
        """
        of_each = [rows if source is read else source.rows(episode) for source, _ in self._shots]
        both = zip(of_each, self._shots, strict=True)
        until_s = min(its.until_s - footage.latency_s for its, (_, footage) in both)
        return replace(rows, until_s=until_s, unfilmed=max(its.unfilmed for its in of_each))

    @functools.cached_property
    def _sizes(self) -> list[tuple[int, int]]:
        """(height, width) of each camera's pictures, taken from the first picture."""
        first, sizes = self._first, []
        for source, _ in self._shots:
            pictures = source.pictures(first, source.rows(first).times_s[:1])
            _, picture = _next(pictures, f"{source.episodes[first]}, step 0")
            sizes.append(picture.shape[:2])
        return sizes

    @functools.cached_property
    def aspects(self) -> list[float]:
        """Width over height of each camera's view. Raises InputError if pictures do not fit."""
        aspects = []
        for (_, footage), size in zip(self._shots, self._sizes, strict=True):
            try:
                aspects.append(footage.aspect(size))
            except InputError as error:
                raise InputError(f"{self._where}: {error}") from None
        return aspects

    def height(self, at_most: int | None) -> int:
        """Height of the lowest camera's pictures, or `at_most` if that is less."""
        own = min(height for height, _ in self._sizes)
        return own if at_most is None else min(own, at_most)

    def frames(
        self, episode: int, times_s: np.ndarray, height: int | None
    ) -> Generator[np.ndarray, None, list[SeenPictures]]:
        """Yield the frames nearest to `times_s`, (H, W, 3), fitted; return facts on the pictures.

        `height` None: that of the pictures. Raises InputError if pictures are unsound.
        """
        height = height or self.height(None)
        views = [
            self._nearest(number, episode, times_s, (height, width_of(aspect, height)))
            for number, aspect in enumerate(self.aspects)
        ]
        seen: list[SeenPictures] = []
        for _ in times_s:
            frames = [next(view) for view in views]
            yield frames[0] if len(frames) == 1 else np.concatenate(frames, 1)
        for view in views:
            try:
                next(view)
            except StopIteration as end:
                seen.append(end.value)
        return seen

    def facts(
        self,
        steps: Sequence[Steps],
        pictures: Sequence[Sequence[SeenPictures]],
        height: int | None,
    ) -> list[dict[str, Any]]:
        """Facts on each camera, from episodes whose pictures were read; JSON."""
        height = height or self.height(None)
        return [
            {"key": source.camera, "codec": source.codec(self._first)}
            | picture_facts(steps, its, (height, width_of(aspect, height)))
            for (source, _), aspect, its in zip(
                self._shots, self.aspects, zip(*pictures, strict=True), strict=True
            )
        ]

    def _nearest(
        self, number: int, episode: int, times_s: np.ndarray, size: tuple[int, int]
    ) -> Generator[np.ndarray, None, SeenPictures]:
        """Like `frames`, for one camera."""
        (source, footage), recorded = self._shots[number], self._sizes[number]
        times_s = times_s + footage.latency_s
        name, shown_s = source.episodes[episode], []
        pictures = source.pictures(episode, times_s)
        for step in range(len(times_s)):
            seen_s, picture = _next(pictures, f"{name}, step {step}")
            if picture.shape[:2] != recorded:
                height, width = picture.shape[:2]
                raise InputError(
                    f"{self._where}: {name}, step {step}: a picture of {width}×{height} pixels, "
                    f"the first of {source.episodes[self._first]} has {recorded[1]}×{recorded[0]}; "
                    "expected one camera that films all alike"
                )
            shown_s.append(seen_s)
            yield footage.as_pinhole(picture, size)
        errors_s = np.abs(np.array(shown_s) - times_s)
        errors = float(errors_s.max()), float(errors_s.mean())
        return SeenPictures(size=recorded, time_errors_s=errors, frame_s=_if_rare(shown_s))


def _if_rare(shown_s: Sequence[float]) -> float | None:
    """Seconds from frame to frame (median), where several steps show the same one; else None.

    `shown_s`: each step's frame. Only if frames are rarer than steps, all of them are seen.
    """
    frames_s = np.unique(shown_s)
    if 1 < len(frames_s) < _MAX_RARE_SHARE * len(shown_s):
        return float(np.median(np.diff(frames_s)))
    return None


def _next(pictures: Iterator[tuple[float, np.ndarray]], where: str) -> tuple[float, np.ndarray]:
    """The next picture. Raises InputError, with `where` in front, if it is not sound."""
    try:
        return next(pictures)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
