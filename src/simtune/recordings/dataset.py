"""Recorded episodes as trajectories, for all kinds of recordings."""

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from simtune.columns import counted
from simtune.errors import InputError
from simtune.recordings.choosing import choose_actions, left_out
from simtune.recordings.facts import SeenPictures, action_ranges
from simtune.recordings.film import Film
from simtune.recordings.fingerprint import fingerprint
from simtune.recordings.held import hold_actions
from simtune.recordings.readings import NO_PERIODS, NO_READINGS, choose_readings
from simtune.recordings.resample import counted_on
from simtune.recordings.source import Source, short
from simtune.recordings.steps import Steps, check_rate, make_steps
from simtune.recordings.turning import Turning, commands_counted_on
from simtune.trajectory import Trajectory, moments

_KEPT_PX = 256  # largest height of frames that `skim` returns


class Dataset:
    """Episodes of a `Source`, read one at a time: chosen actions, one rate, pictures of one size.

    Row t of an episode is a frame and the action that begins then. The last action is left out,
    since its outcome was not filmed. Rewards, states and the like are not read.

    Frames come from a `film`, `image_size` pixels high (None: the recorded height). Without a film,
    no picture is decoded, and frames are empty.

    `actions` names the columns to use, in this order (None: all); `num_actions`, if given, is the
    number that the task needs. `readings`, {sensor: columns}, names the columns of each sensor's
    readings, see `choose_readings`. `control_hz` is the number of steps per second (None: the
    recordings' rate): frames are the nearest in time, actions are averaged over each step, and
    readings are interpolated linearly. `turnings` are actions that may begin again after a turn;
    their columns are those of the used actions, and of all sensors' readings side by side.

    Raises:
        InputError: the recordings do not fit; one line says what was expected and what to do.
    """

    def __init__(
        self,
        source: Source,
        *,
        film: Film | None = None,
        image_size: int | None = None,
        num_actions: int | None = None,
        actions: Sequence[str] | None = None,
        control_hz: float | None = None,
        readings: Mapping[str, Sequence[str]] = NO_READINGS,
        turnings: Sequence[Turning] = (),
    ):
        if image_size is not None and image_size < 1:
            raise InputError(f"image_size must be at least 1 pixel, got {image_size}")
        self._source, self._film, self._image_size = source, film, image_size
        self._columns = choose_actions(source, actions, num_actions)
        self._sensors = choose_readings(source.path, source.readings, readings, source.action_names)
        self._asked, self._turnings = readings, turnings
        self._own_rate = control_hz is None
        self.step_s = 1 / (control_hz or source.fps)
        self._read: dict[int, tuple[Steps, Sequence[SeenPictures]]] = {}  # by episode
        self.where = str(source.path)
        self.action_names = tuple(source.action_names[column] for column in self._columns)
        self.reading_names = tuple(reading.full_name for reading in source.readings)  # available
        self.episodes = [source.episodes[index] for index in source.kept]  # names
        self.num_episodes = len(self.episodes)
        self._left_out = left_out(source)
        self.num_left_out = len(self._left_out)

    @property
    def aspects(self) -> list[float]:
        """Width over height of each camera's view. Raises InputError for unsound pictures."""
        return self._film.aspects if self._film else []

    @property
    def recorded_px(self) -> int | None:
        """Height of the lowest camera's pictures; None without pictures."""
        return self._film.height(None) if self._film else None

    @functools.cached_property
    def content_hash(self) -> str:
        """SHA-256 of the recordings, computed on first use; it changes if they do."""
        path, files = self._source.path, self._film.files if self._film else self._source.files
        return fingerprint(path if path.is_dir() else path.parent, files)

    def read(
        self,
        episode: int,
        periods: Mapping[str, np.ndarray] = NO_PERIODS,
        *,
        pictures: bool = True,
    ) -> Trajectory:
        """Read a whole episode; without `pictures`, none is decoded, and frames are empty.

        Readings are as recorded, and counted on where `periods`, {sensor: (D,)}, say that they
        begin again (`counted_on`). Raises InputError if it is unsound, or a sensor has another
        number of readings.
        """
        steps = self._steps(episode, periods)
        frames = np.empty((len(steps.times_s), 0, 0, 3), np.uint8)
        shown = self._frames(episode, steps, self._image_size) if pictures else ()
        for step, picture in enumerate(shown):
            if step == 0:
                frames = np.empty((len(steps.times_s), *picture.shape), np.uint8)
            frames[step] = picture
        return Trajectory(frames, steps.actions, self.step_s, steps.readings)

    def skim(
        self, episode: int, num_kept: int = 0, within_steps: int | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """An episode's actions (T, A) float32, and a few frames; all frames are decoded.

        `num_kept` frames, (num_kept, H, W, 3), equally spaced over the first `within_steps` steps,
        reduced to at most 256 pixels in height. If there are fewer, frames are repeated; without
        pictures, there are none. Raises InputError if the episode is unsound.
        """
        steps = self._steps(episode)
        last = min(len(steps.actions), within_steps or len(steps.actions))
        kept_steps = moments(last, num_kept)
        kept = {
            step: picture
            for step, picture in enumerate(self._frames(episode, steps, self._kept_px))
            if step in kept_steps
        }
        frames = [kept[step] for step in kept_steps] if kept else []
        return steps.actions, np.stack(frames) if frames else np.empty((0, 0, 0, 3), np.uint8)

    def facts(self, num_episodes: int) -> dict[str, Any]:
        """Facts on the first episodes, which must have been read or skimmed; JSON."""
        read = [self._read[episode] for episode in range(num_episodes)]
        steps, pictures = zip(*read, strict=True)
        named = list(zip(self.episodes, steps, strict=False))
        return {
            "folder": self.where,
            "kind": self._source.kind,
            "dataset_hash": self.content_hash,
            "robot_type": self._source.robot_type,
            "cameras": self._film.facts(steps, pictures, self._image_size) if self._film else [],
            "fps": self._source.fps,
            "control_hz": 1 / self.step_s,
            "readings_hz": min(its.readings_hz for its in steps),
            "action_names": list(self.action_names),
            "action_ranges": action_ranges(steps, self.action_names),
            "gaps": {name: [list(gap) for gap in its.gaps_s] for name, its in named if its.gaps_s},
            "unused_s": {
                name: [its.unused_s, len(its.actions) * self.step_s]
                for name, its in named
                if its.unused_s
            },
            "unfilmed": {name: its.unfilmed for name, its in named if its.unfilmed},
            "readings": {
                sensor: [reading.full_name for reading in readings]
                for sensor, readings in self._sensors.items()
            },
            "names": self.episodes[:num_episodes],
            "episodes": num_episodes,
            "episodes_in_dataset": len(self._source.episodes),
            "left_out": self.num_left_out,
            "names_left_out": self._left_out,
            "steps": sum(len(its.actions) for its in steps),
        }

    def _steps(self, episode: int, periods: Mapping[str, np.ndarray] = NO_PERIODS) -> Steps:
        """An episode without its pictures."""
        where = f"{self.where}: {self.episodes[episode]}"
        asked = [reading for readings in self._sensors.values() for reading in readings]
        index = self._source.kept[episode]
        rows = hold_actions(self._source.rows(index, asked), self._columns)
        if self._own_rate:
            check_rate(where, rows, self.step_s)
        if self._film:
            rows = self._film.seen_rows(index, self._source, rows)
        all_periods = self._of_all(periods)
        rows = replace(
            rows,
            # Before resampling, as readings below
            actions=commands_counted_on(rows.actions, rows.readings, self._turnings),
            # Before resampling: on a line across the jump, an encoder would turn back.
            readings=counted_on(rows.readings, all_periods),
        )
        return make_steps(where, rows, self.step_s, self._sensors)

    def _of_all(self, periods: Mapping[str, np.ndarray]) -> np.ndarray:
        """(D,) of all sensors' readings. Raises InputError if a sensor has another number.

        Without periods, numbers of joints are unknown; then only if a turning joint has no reading.
        """
        found = [np.empty(0)]
        for sensor, readings in self._sensors.items():
            its = periods.get(sensor, np.full(len(readings), np.inf))
            if len(its) != len(readings):
                raise InputError(
                    f"{self.where}: {', '.join(self._asked[sensor])} holds {len(readings)} "
                    f"numbers, sensor {sensor} has {len(its)} joints; name a column for each joint"
                )
            found.append(its)
        all_periods = np.concatenate(found)
        if any(t.reading is not None and t.reading >= len(all_periods) for t in self._turnings):
            columns = [column for columns in self._asked.values() for column in columns]
            raise InputError(
                f"{self.where}: {short(columns)}: {counted(len(all_periods), 'number')}, fewer "
                "than the sensors have joints; name a column for each joint"
            )
        return all_periods

    @property
    def _kept_px(self) -> int | None:
        return self._film.height(_KEPT_PX) if self._film else None

    def _frames(self, episode: int, steps: Steps, height: int | None) -> Iterator[np.ndarray]:
        """Yield an episode's frames (H, W, 3); then it has been read."""
        pictures: Sequence[SeenPictures] = ()
        if self._film:
            pictures = yield from self._film.frames(
                self._source.kept[episode], steps.times_s, height
            )
        self._read[episode] = steps, pictures
