"""Recorded episodes as trajectories: what all kinds of recordings have in common."""

import functools
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from simtune.errors import InputError
from simtune.footage import PLAIN, Footage
from simtune.pictures import resize
from simtune.recordings.facts import Seen, SeenPictures, action_ranges, picture_facts
from simtune.recordings.fingerprint import fingerprint
from simtune.recordings.readings import NO_READINGS, choose_readings
from simtune.recordings.source import Source, choose_actions
from simtune.recordings.steps import Steps, check_rate, make_steps
from simtune.trajectory import Trajectory

_KEPT_PX = 256  # side of frames that are kept to be looked at


class Dataset:
    """Episodes of a `Source`, read one at a time: chosen actions, one rate, pictures of one size.

    Row t of an episode is a frame and the action that begins then. What the last action did was
    not filmed, so it is left out. Rewards, states and the like are left unread.

    Frames are resized to `image_size` by area averaging. One number is the side of a square, as
    `footage` has it: the middle of a landscape picture, whole in height, which is what a square
    MuJoCo camera of the same field of view (it is vertical) films, or what a lens leaves of it.
    (height, width) keeps the whole picture and squeezes it where its aspect is another one. None
    keeps the source's size. Without `pictures` none is decoded, and frames are empty.

    `actions` names the columns to take, in this order (None: all); `num_actions`, where given, is
    how many the task needs. `readings` names the columns that each sensor's readings are of,
    {sensor: its columns}, see `choose_readings`. `control_hz` is how many steps a second makes
    (None: the recordings' own rate): frames are those nearest in time, actions the means over each
    step, readings on a straight line between those recorded.

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
        readings: Mapping[str, Sequence[str]] = NO_READINGS,
        pictures: bool = True,
        footage: Footage = PLAIN,
    ):
        if image_size is not None and np.min(image_size) < 1:
            raise InputError(f"image_size must be at least 1 pixel, got {image_size}")
        if pictures and source.camera is None:
            raise ValueError("the source was opened without pictures")
        self._source, self._image_size, self._with_pictures = source, image_size, pictures
        self._columns = choose_actions(source, actions, num_actions)
        self._sensors = choose_readings(source.path, source.readings, readings)
        self._own_rate, self._footage = control_hz is None, footage
        self.step_s = 1 / (control_hz or source.fps)
        self._seen: dict[int, Seen] = {}
        self.where = str(source.path)
        self.action_names = tuple(source.action_names[column] for column in self._columns)
        self.reading_names = tuple(reading.full_name for reading in source.readings)  # to choose of
        self.episodes = source.episodes  # what each is called
        self.num_episodes = len(source.episodes)

    @functools.cached_property
    def content_hash(self) -> str:
        """SHA-256, when first asked for, by which a change of the recordings is noticed."""
        path = self._source.path
        return fingerprint(path if path.is_dir() else path.parent, self._source.files)

    def read(self, episode: int) -> Trajectory:
        """An episode, whole. Raises InputError where it is unsound."""
        steps = self._steps(episode)
        frames: np.ndarray | None = None
        for step, picture in enumerate(self._frames(episode, steps)):
            picture = self._fit(picture)
            if frames is None:
                frames = np.empty((len(steps.times_s), *picture.shape), np.uint8)
            frames[step] = picture
        if frames is None:
            frames = np.empty((len(steps.times_s), 0, 0, 3), np.uint8)
        return Trajectory(frames, steps.actions, self.step_s, steps.readings)

    def skim(
        self, episode: int, num_kept: int = 0, within_steps: int | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """An episode's actions (T, A) float32, and a few of its frames, after a look at each.

        `num_kept` frames, (num_kept, side, side, 3), equally spaced from the first one to the last
        of the first `within_steps` steps: the squares in their middles, made smaller if larger
        than 256 pixels a side. Fewer frames are repeated; without pictures there are none.
        Raises InputError where the episode is unsound.
        """
        steps = self._steps(episode)
        last = min(len(steps.actions), within_steps or len(steps.actions))
        kept_steps = np.linspace(0, last, num_kept).astype(int)
        kept = {
            step: self._footage.square(picture, min(*picture.shape[:2], _KEPT_PX))
            for step, picture in enumerate(self._frames(episode, steps))
            if step in kept_steps
        }
        frames = [kept[step] for step in kept_steps] if kept else []
        return steps.actions, np.stack(frames) if frames else np.empty((0, 0, 0, 3), np.uint8)

    def measured(self, episode: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """An episode's actions (T, A), and {sensor: (T + 1, D)} readings; no picture is decoded."""
        steps = self._steps(episode)
        return steps.actions, dict(steps.readings)

    def facts(self, num_episodes: int) -> dict[str, Any]:
        """What to note down of the first episodes, once they were read or skimmed; JSON.

        Without pictures what tells of them is null.
        """
        seen = [self._seen[episode] for episode in range(num_episodes)]
        return {
            "folder": self.where,
            "kind": self._source.kind,
            "dataset_hash": self.content_hash,
            "robot_type": self._source.robot_type,
            "camera": self._source.camera if self._with_pictures else None,
            "codec": self._source.codec if self._with_pictures else None,
            **picture_facts(seen, self._image_size),
            "fps": self._source.fps,
            "control_hz": 1 / self.step_s,
            "action_names": list(self.action_names),
            "action_ranges": action_ranges(seen, self.action_names),
            "readings": {
                sensor: [reading.full_name for reading in readings]
                for sensor, readings in self._sensors.items()
            },
            "episodes": num_episodes,
            "episodes_in_dataset": self.num_episodes,
            "steps": sum(s.num_steps for s in seen),
        }

    def _steps(self, episode: int) -> Steps:
        """An episode but for its pictures."""
        where = f"{self.where}: {self.episodes[episode]}"
        asked = [reading for readings in self._sensors.values() for reading in readings]
        rows = self._source.rows(episode, asked)
        if self._own_rate:
            check_rate(where, rows, self.step_s)
        rows = replace(rows, actions=rows.actions[:, self._columns])
        return make_steps(where, rows, self.step_s, self._sensors)

    def _frames(self, episode: int, steps: Steps) -> Iterator[np.ndarray]:
        """An episode's frames (H, W, 3) as recorded; what there is to note of it is noted."""
        pictures: SeenPictures | None = None
        if self._with_pictures:
            pictures = yield from self._nearest(episode, steps.times_s)
        self._seen[episode] = Seen(
            num_steps=len(steps.actions),
            lowest=steps.actions.min(0),
            highest=steps.actions.max(0),
            pictures=pictures,
        )

    def _nearest(
        self, episode: int, times_s: np.ndarray
    ) -> Generator[np.ndarray, None, SeenPictures]:
        """The frames nearest to times; returns what they are like."""
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
        return SeenPictures(size=size, time_errors_s=(max(errors_s), float(np.mean(errors_s))))

    def _check_size(self, name: str, shape: tuple[int, ...]) -> tuple[int, int]:
        height, width = shape[:2]
        if isinstance(self._image_size, int) and height > width and not self._footage.lens:
            raise InputError(
                f"{self.where}: {name}: the picture is upright, {width}×{height}; "
                "expected one at least as wide as high; crop it to a square"
            )
        first = next((seen.pictures for seen in self._seen.values()), None)
        if first is not None and first.size != (height, width):
            raise InputError(
                f"{self.where}: {name}: pictures of {width}×{height} pixels, those of other "
                f"episodes have {first.size[1]}×{first.size[0]}; "
                "expected one camera that films all alike"
            )
        return height, width

    def _fit(self, picture: np.ndarray) -> np.ndarray:
        if self._image_size is None:
            return picture
        if isinstance(self._image_size, int):
            return self._footage.square(picture, self._image_size)
        return resize(picture, self._image_size)
