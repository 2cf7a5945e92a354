"""Recorded episodes as trajectories: what all kinds of recordings have in common."""

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from simtune.errors import InputError
from simtune.pictures import middle_square, resize
from simtune.recordings.fingerprint import fingerprint
from simtune.recordings.resample import step_actions, step_times, typical_step_s
from simtune.recordings.source import MOST_ROWS, Rows, Source, choose_actions, first_wrong, short
from simtune.trajectory import Trajectory

_KEPT_PX = 256  # side of frames that are kept to be looked at


@dataclass(frozen=True, kw_only=True)
class _Seen:
    """What is to be noted down of an episode."""

    num_steps: int
    source_size: tuple[int, int]  # (height, width), pixels
    time_errors_s: tuple[float, float]  # largest and mean distance of frames from their steps
    lowest: np.ndarray  # (A,) of the actions
    highest: np.ndarray  # (A,)


class Dataset:
    """Episodes of a `Source`, read one at a time: chosen actions, one rate, pictures of one size.

    Row t of an episode is a frame and the action that begins then. What the last action did was
    not filmed, so it is left out. Rewards, states and the like are left unread.

    Frames are resized to `image_size` by area averaging. One number is the side of a square: the
    middle of a landscape picture, whole in height, which is what a square MuJoCo camera of the
    same field of view (it is vertical) films. (height, width) keeps the whole picture and squeezes
    it where its aspect is another one. None keeps the source's size.

    `actions` names the columns to take, in this order (None: all); `num_actions`, where given, is
    how many the task needs. `control_hz` is how many steps a second makes (None: the recordings'
    own rate): frames are those nearest in time, actions the means over each step.

    Raises:
        InputError: the recordings do not fit; one line says what was expected and what to do.
    """

    def __init__(
        self,
        source: Source,
        *,
        image_size: tuple[int, int] | int | None = None,
        num_actions: int | None = None,
        actions: Sequence[str] | None = None,
        control_hz: float | None = None,
    ):
        if image_size is not None and np.min(image_size) < 1:
            raise InputError(f"image_size must be at least 1 pixel, got {image_size}")
        self._source, self._image_size = source, image_size
        self._columns = choose_actions(source, actions, num_actions)
        self._own_rate = control_hz is None
        self.step_s = 1 / (control_hz or source.fps)
        self._seen: dict[int, _Seen] = {}
        self.where = str(source.path)
        self.action_names = tuple(source.action_names[column] for column in self._columns)
        self.episodes = source.episodes  # what each is called
        self.num_episodes = len(source.episodes)

    @functools.cached_property
    def content_hash(self) -> str:
        """SHA-256, when first asked for, by which a change of the recordings is noticed."""
        path = self._source.path
        return fingerprint(path if path.is_dir() else path.parent, self._source.files)

    def read(self, episode: int) -> Trajectory:
        """An episode, whole. Raises InputError where it is unsound."""
        times_s, actions = self._steps(episode)
        frames: np.ndarray | None = None
        for step, picture in enumerate(self._pictures(episode, times_s, actions)):
            picture = self._fit(picture)
            if frames is None:
                frames = np.empty((len(times_s), *picture.shape), np.uint8)
            frames[step] = picture
        assert frames is not None
        return Trajectory(frames, actions, self.step_s)

    def skim(
        self, episode: int, num_kept: int = 0, within_steps: int | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """An episode's actions (T, A) float32, and a few of its frames, after a look at each.

        `num_kept` frames, (num_kept, side, side, 3), equally spaced from the first one to the last
        of the first `within_steps` steps: the squares in their middles, made smaller if larger
        than 256 pixels a side. Fewer frames are repeated.
        Raises InputError where the episode is unsound.
        """
        times_s, actions = self._steps(episode)
        last = min(len(actions), within_steps or len(actions))
        steps = np.linspace(0, last, num_kept).astype(int)
        kept = {
            step: _small_square(picture)
            for step, picture in enumerate(self._pictures(episode, times_s, actions))
            if step in steps
        }
        frames = [kept[step] for step in steps]
        return actions, np.stack(frames) if frames else np.empty((0, 0, 0, 3), np.uint8)

    def facts(self, num_episodes: int) -> dict[str, Any]:
        """What to note down of the first episodes, once they were read or skimmed; JSON."""
        seen = [self._seen[episode] for episode in range(num_episodes)]
        size = self._image_size or seen[0].source_size
        ranges = [np.min([s.lowest for s in seen], 0), np.max([s.highest for s in seen], 0)]
        frames = np.array([s.num_steps + 1 for s in seen])
        largest, mean = np.array([s.time_errors_s for s in seen]).T
        return {
            "folder": self.where,
            "kind": self._source.kind,
            "dataset_hash": self.content_hash,
            "robot_type": self._source.robot_type,
            "camera": self._source.camera,
            "codec": self._source.codec,
            "source_size": list(seen[0].source_size),
            "image_size": [size, size] if isinstance(size, int) else list(size),
            "fps": self._source.fps,
            "control_hz": 1 / self.step_s,
            "time_error_ms": {
                "largest": round(1e3 * float(largest.max()), 3),
                "mean": round(1e3 * float(mean @ frames / frames.sum()), 3),
            },
            "action_names": list(self.action_names),
            "action_ranges": dict(
                zip(self.action_names, np.transpose(ranges).tolist(), strict=True)
            ),
            "episodes": num_episodes,
            "episodes_in_dataset": self.num_episodes,
            "steps": int(frames.sum()) - num_episodes,
        }

    def _steps(self, episode: int) -> tuple[np.ndarray, np.ndarray]:
        """(K + 1,) seconds of an episode's frames, and (K, A) float32 actions between them."""
        where, rows = f"{self.where}: {self.episodes[episode]}", self._source.rows(episode)
        if self._own_rate:
            self._check_rate(where, rows)
        actions = rows.actions[:, self._columns]
        if (row := first_wrong(np.any(~np.isfinite(actions), axis=1))) is not None:
            raise InputError(
                f"{where}, row {row}: action is not finite: "
                f"[{short([f'{value:g}' for value in actions[row]])}]; drop or repair the episode"
            )
        lasts_s = rows.until_s - rows.times_s[0]
        if lasts_s > MOST_ROWS * self.step_s:
            raise InputError(
                f"{where} lasts {lasts_s:.3g} s, by its time stamps; expected at most {MOST_ROWS} "
                f"steps of {self.step_s:.3g} s; mend them, or split the episode"
            )
        times_s = step_times(rows, self.step_s)
        if len(times_s) < 2:
            raise InputError(
                f"{where} lasts {lasts_s:.3g} s; expected at least one step of "
                f"{self.step_s:.3g} s, a frame before and a frame after an action"
            )
        chosen = Rows(actions, rows.times_s, rows.until_s)
        return times_s, step_actions(chosen, times_s).astype(np.float32)

    def _check_rate(self, where: str, rows: Rows) -> None:
        own_hz = 1 / typical_step_s(rows.times_s) if len(rows) > 1 else 1 / self.step_s
        if abs(own_hz * self.step_s - 1) > 0.01:
            raise InputError(
                f"{where} has {own_hz:.4g} actions/s, the first episode "
                f"{1 / self.step_s:.4g}; give one rate for all as --control-hz"
            )

    def _pictures(
        self, episode: int, times_s: np.ndarray, actions: np.ndarray
    ) -> Iterator[np.ndarray]:
        """An episode's frames (H, W, 3) as recorded; what there is to note of it is noted."""
        name, errors_s = self.episodes[episode], []
        size: tuple[int, int] | None = None
        pictures = self._source.pictures(episode, times_s)
        for time_s in times_s:
            try:
                seen_s, picture = next(pictures)
            except InputError as error:
                raise InputError(f"{name}, step {len(errors_s)}: {error}") from None
            size = size or self._check_size(name, picture.shape)
            errors_s.append(abs(seen_s - time_s))
            yield picture
        assert size is not None
        self._seen[episode] = _Seen(
            num_steps=len(actions),
            source_size=size,
            time_errors_s=(max(errors_s), float(np.mean(errors_s))),
            lowest=actions.min(0),
            highest=actions.max(0),
        )

    def _check_size(self, name: str, shape: tuple[int, ...]) -> tuple[int, int]:
        height, width = shape[:2]
        if isinstance(self._image_size, int) and height > width:
            raise InputError(
                f"{self.where}: {name}: the picture is upright, {width}×{height}; "
                "expected one at least as wide as high; crop it to a square"
            )
        first = next(iter(self._seen.values()), None)
        if first is not None and first.source_size != (height, width):
            raise InputError(
                f"{self.where}: {name}: pictures of {width}×{height} pixels, those of other "
                f"episodes have {first.source_size[1]}×{first.source_size[0]}; "
                "expected one camera that films all alike"
            )
        return height, width

    def _fit(self, picture: np.ndarray) -> np.ndarray:
        if self._image_size is None:
            return picture
        if isinstance(self._image_size, int):
            return resize(middle_square(picture), (self._image_size, self._image_size))
        return resize(picture, self._image_size)


def _small_square(picture: np.ndarray) -> np.ndarray:
    """The middle of a picture, to look at."""
    square = middle_square(picture)
    side = min(len(square), _KEPT_PX)
    return resize(square, (side, side))
