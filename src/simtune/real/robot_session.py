"""Sessions with a connected robot and camera: to measure only, or to act."""

import fcntl
import logging
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from simtune.cameras.pictures import middle_square, resize
from simtune.errors import InputError, RobotError
from simtune.networks.cuda_graph import CALLS_BEFORE_REPLAY
from simtune.robot.displacements import Displacements
from simtune.robot.latch import Latch
from simtune.robot.limits import Limits
from simtune.robot.robot import Camera, Robot
from simtune.robot.robot_file import RobotConfig
from simtune.robot.safe_arm import SafeArm
from simtune.robot.signals import ended_in_order
from simtune.trajectory import Trajectory

log = logging.getLogger(__name__)
Note = Callable[[dict[str, Any]], None]
# Step t and the (t + 1, H, W, 3) uint8 frames so far to an action (A,)
ActOnFrames = Callable[[int, list[np.ndarray]], np.ndarray]


@contextmanager
def connected(config: RobotConfig) -> Iterator[tuple[Robot, Camera]]:
    """Lock the robot, connect it and the camera; nothing moves. Raises InputError, RobotError."""
    latch = Latch(config.latch)
    latch.check()
    with _alone(config.file), ExitStack() as open_ones:
        robot, camera = _make(config, latch)
        for device in (robot, camera):
            device.connect()
            open_ones.push(_closing(device))
        yield robot, camera


def _closing(device: Robot | Camera) -> Callable[..., None]:
    """Closes a device at a context's end; if that fails after an error, the error is what shows."""

    def close(_: object, error: BaseException | None, __: object) -> None:
        try:
            device.close()
        except Exception as failed:  # drivers may raise anything
            if error is None:
                raise
            log.warning("while closing after another error: %s", failed)

    return close


@contextmanager
def acting(config: RobotConfig, step_s: float, actions: Displacements) -> Iterator["Session"]:
    """Like `connected`, but the robot is ready to move. Raises InputError, RobotError.

    SIGTERM and SIGHUP raise ToldToEnd meanwhile, so that they stop a robot that moves.
    """
    with ended_in_order(), connected(config) as (robot, camera):
        arm = SafeArm(robot, limits_of(config), step_s, Latch(config.latch))
        try:
            yield Session(arm, camera, actions, step_s, config.camera.recorded_px)
        finally:
            arm.close()


class Session:
    """Plays episodes on a robot that is ready to move."""

    def __init__(
        self, arm: SafeArm, camera: Camera, actions: Displacements, step_s: float, recorded_px: int
    ):
        self._arm, self._camera, self._actions = arm, camera, actions
        self._step_s, self._recorded_px = step_s, recorded_px

    def go_to_start(self) -> None:
        """Move to the episodes' start pose. Raises RobotError."""
        self._arm.go_to(self._actions.start)

    def play(self, begin: Callable[[], ActOnFrames], num_steps: int, note: Note) -> Trajectory:
        """Play one episode; its actions are those sent. `note` is called immediately per step."""
        act, first = begin(), [self._look()[0]]
        for _ in range(CALLS_BEFORE_REPLAY):  # slow on a GPU, so make these before the clock runs
            act(0, first)
        act = begin()  # those actions were never sent
        frames, sent_actions = [], []
        with self._arm.moving():
            begun_s = time.monotonic()
            for t in range(num_steps):
                frame, taken_s = self._look()
                frames.append(frame)
                asked = act(t, frames)
                measured = self._arm.measure()
                if time.monotonic() > begun_s + (t + 1) * self._step_s:
                    raise RobotError(f"step {t} came late, by more than its {self._step_s:g} s")
                sent = self._arm.send(self._actions.target(asked, measured), measured)
                step = {"step": t, "frame_s": taken_s, "sent_s": time.time()}
                action = self._actions.action(sent, measured)
                note(step | {"asked": asked, "measured": measured, "sent": sent, "action": action})
                sent_actions.append(action)
                self._arm.wait_until(begun_s + (t + 1) * self._step_s)
            frame, taken_s = self._look()
            note({"step": num_steps, "frame_s": taken_s})
        return Trajectory(np.stack([*frames, frame]), np.stack(sent_actions), self._step_s)

    def _look(self) -> tuple[np.ndarray, float]:
        """The picture's middle square, and the time when it was taken."""
        pixels, taken_s = self._camera.take_picture()
        size = (self._recorded_px, self._recorded_px)
        return resize(middle_square(pixels), size), taken_s


def limits_of(config: RobotConfig) -> Limits:
    """Limits from the robot's file, in the robot's units."""
    low, high = np.array(list(config.workspace.values()), float).T
    return Limits(low=low, high=high, speed=config.speed, tolerance=config.tolerance)


def _make(config: RobotConfig, latch: Latch) -> tuple[Robot, Camera]:
    """Robot and camera of the driver; packages are imported here, since few machines have them."""
    if config.driver == "lerobot":
        from simtune.robot.lerobot import LeRobot, LeRobotCamera, make_lerobot

        made = make_lerobot(config.address, config.file.parent)
        return LeRobot(made, config.axes), LeRobotCamera(made, config.camera.name)
    from simtune.robot.realsense import RealSense
    from simtune.robot.xarm import XArm

    arm = XArm(
        config.address,
        acceleration=config.acceleration,
        collision_sensitivity=config.collision_sensitivity,
        latch=latch,
    )
    return arm, RealSense(config.camera.name, config.camera.playback)


@contextmanager
def _alone(file: Path) -> Iterator[None]:
    """Hold a lock on the robot's file, so that two commands do not move one robot."""
    with file.open() as held:
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(f"another simtune is moving the robot of {file}") from None
        yield
