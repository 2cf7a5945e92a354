"""The real world as a robot and a camera. The robot keeps to its workspace and speed limit."""

import logging
import sys
import termios
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from simtune.cameras.pictures import resize
from simtune.errors import InputError
from simtune.observation import ObservationModel
from simtune.random_streams import Purpose, stream
from simtune.real import RealWorld, remembers_nothing
from simtune.real.archive import RecordingArchive, RecordingSession
from simtune.real.meaning import meaning_of
from simtune.real.robot_checks import check_actions, footage_of
from simtune.real.robot_session import ActOnFrames, acting, connected, limits_of
from simtune.robot.displacements import Displacements
from simtune.robot.robot_file import RobotConfig
from simtune.simulation import PixelPolicy, random_actions, scale_actions
from simtune.tasks import AnyTask
from simtune.trajectory import Trajectory

log = logging.getLogger(__name__)
A_FEW = 5  # episodes filmed if no number is given


class RobotReal(RealWorld):
    """A robot as the real world; docs/robot.md describes its safety.

    The constructor connects to nothing. All episodes are stored in `folder` and read back from
    there, so a resumed run sees the same data as before. Without `move`, nothing moves.
    """

    def __init__(
        self,
        config: RobotConfig,
        task: AnyTask,
        *,
        image_size: int,
        seed: int,
        folder: Path,
        move: bool,
    ):
        """Raises InputError if the task's actions or cameras do not fit the robot.

        Or if what `folder` holds was filmed with something else in the robot's or the tuning file.
        """
        footage, mapping = footage_of(task), task.load_actions()
        check_actions(config, task, mapping)
        self.observation = ObservationModel.of_reality(films=(footage,))
        self.step_s, self.num_actions = task.step_s, len(mapping.names)
        self._config, self._task, self._mapping = config, task, mapping
        self._image_size, self._seed, self._move = image_size, seed, move
        meaning = meaning_of(config, task)
        self._filmed = RecordingArchive(folder, self.num_actions, footage, meaning)
        self._displacements = Displacements.of(
            config.moved, config.step, mapping.range, config.axes, config.start
        )

    @property
    def facts(self) -> dict[str, Any]:
        """The robot's file and driver; JSON."""
        return {"robot": str(self._config.file), "driver": self._config.driver}

    @property
    def num_filmed(self) -> int:
        """Number of episodes filmed so far."""
        return self._filmed.num_episodes

    def dry_run(self) -> str:
        """Connect, measure the pose, take a picture; nothing moves. Returns a sentence.

        Raises InputError, RobotError if something would prevent moving.
        """
        with connected(self._config) as (robot, camera):
            place = robot.measure()
            limits_of(self._config).check(place)
            height, width, _ = camera.take_picture().pixels.shape
        where = ", ".join(
            f"{axis} {value:.1f}" for axis, value in zip(robot.axes, place, strict=True)
        )
        return f"the robot is at {where}, within its workspace; pictures are {width}×{height}"

    def collect(self, num_episodes: int | None = None) -> list[Trajectory]:
        """Episodes of random actions, by default 5; those filmed earlier come first.

        Raises InputError if more must be filmed and nothing may move, RobotError if the robot
        fails; episodes filmed until then are kept.
        """
        num_episodes = num_episodes or A_FEW
        done = self.num_filmed
        if done:
            used = min(done, num_episodes)
            log.info("%d episodes of earlier sessions in %s are used", used, self._filmed.folder)

        def draw(episode: int) -> ActOnFrames:
            rng = stream(self._seed, Purpose.ROBOT, done + episode)
            drawn = random_actions(1, self._task.episode_steps, self._mapping, rng)[0]
            return lambda t, _: drawn[t]

        if num_episodes > done:
            self._film(num_episodes - done, draw)
        return self._filmed.read(self._image_size)[:num_episodes]

    def run_policy(
        self,
        policy: PixelPolicy,
        num_stacked: int,
        num_episodes: int,
        seed: int,
        begin: Callable[[], None] = remembers_nothing,
    ) -> list[Trajectory]:
        """See `RealWorld`; nothing depends on the seed. Raises as `collect` does."""
        size = (self._image_size, self._image_size)

        def act(t: int, frames: list[np.ndarray]) -> np.ndarray:
            latest = np.maximum(np.arange(t + 1 - num_stacked, t + 1), 0)
            seen = np.stack([resize(frames[i], size) for i in latest])
            return scale_actions(self._mapping, policy(seen[None]))[0]

        def begin_acting(_: int) -> ActOnFrames:
            begin()
            return act

        return list(self._film(num_episodes, begin_acting).read(self._image_size))

    def _film(self, num_episodes: int, begin: Callable[[int], ActOnFrames]) -> RecordingSession:
        if not self._move:
            raise InputError("the robot has to move for this: give --move")
        ask = self._config.ask
        if ask and not sys.stdin.isatty():
            raise InputError(
                f"nobody can say when an episode may begin: run it in a terminal, "
                f"or write ask = false into {self._config.file}"
            )
        with acting(self._config, self.step_s, self._displacements) as session:
            sitting = self._filmed.new_session(
                action_names=self._mapping.names,
                robot_type=self._config.driver,
                task=self._task.description,
            )
            for episode in range(num_episodes):
                which = f"episode {episode + 1} of {num_episodes}"
                if ask:
                    _ask(f"{which}: clear the robot's way to its start")
                session.go_to_start()
                if ask:
                    _ask(f"{which}: set the scene up, and stand back")
                begun = partial(begin, episode)
                sitting.add(session.play(begun, self._task.episode_steps, sitting.note))
        return sitting


def _ask(what: str) -> None:
    """Wait until a person presses Enter. Raises InputError if the terminal is gone."""
    with suppress(termios.error, OSError):  # not a terminal: there is nothing to discard
        termios.tcflush(sys.stdin.fileno(), termios.TCIFLUSH)  # discard what was typed earlier
    print(f"{what}, then press Enter ", end="", file=sys.stderr, flush=True)
    if not sys.stdin.readline():
        raise InputError("nobody is there to say when the episode may begin")
