"""An xArm, through its maker's SDK: the tool's centre moves in straight lines, pointing down."""

import math
import time
from typing import Any

import numpy as np

from simtune.errors import RobotError
from simtune.robot.controller_limits import check_controller, limit_controller
from simtune.robot.latch import Latch
from simtune.robot.limits import Limits
from simtune.robot.watchdog import Watchdog
from simtune.robot.xarm_sdk import open_arm

# In this mode a new target replaces the previous one, and the controller plans a path of limited
# speed and acceleration to it. If everything else dies, the arm comes to rest at the latest target.
_ONLINE_MODE = 7
_FIRST_FIRMWARE = (1, 11, 100)  # the first with this mode, and with a single command for lines
_CAN_MOVE = (0, 1, 2)  # ready, moving, resting
_STOPPED_STATE = 4
_ENABLED_WITHIN_S = 3.0
_MIN_DOWN_COSINE = math.cos(math.radians(5))


class XArm:
    """A `Robot`; positions are in mm in the controller's base frame."""

    axes: tuple[str, ...] = ("x", "y", "z")

    def __init__(self, ip: str, *, acceleration: float, collision_sensitivity: int, latch: Latch):
        """`acceleration`: mm/s²; `collision_sensitivity`: 1 to 5, which is the most sensitive."""
        self._ip, self._acceleration, self._latch = ip, acceleration, latch
        self._collision_sensitivity = collision_sensitivity
        self._arm: Any = None
        self._is_woken = False
        self._limits: Limits | None = None  # set once the arm may move
        self._yaw_deg = 0.0

    def connect(self) -> None:
        self._arm = open_arm(self._ip)
        if tuple(self._arm.version_number) < _FIRST_FIRMWARE:
            self.close()
            found = ".".join(map(str, self._arm.version_number))
            raise RobotError(f"the xArm's firmware is {found}, expected 1.11.100 or newer")

    def allow_motion(self, limits: Limits) -> Watchdog:
        self.measure()  # an error stays until a person clears it
        self._yaw_deg = self._pose()[5]
        self._is_woken = True
        self.stop()  # drops commands that may still be queued
        demanded = (limits, self._collision_sensitivity)
        limit_controller(self._arm, *demanded)
        self._demand("enable its motors", self._arm.motion_enable(True))
        self._demand("change its mode", self._arm.set_mode(_ONLINE_MODE))
        self._demand("get ready", self._arm.set_state(0))
        deadline_s = time.monotonic() + _ENABLED_WITHIN_S
        while self._arm.mode != _ONLINE_MODE or self._arm.state not in _CAN_MOVE:
            if time.monotonic() > deadline_s:
                raise RobotError(
                    f"the xArm is in mode {self._arm.mode} and state {self._arm.state}, not ready"
                )
            time.sleep(0.02)
        check_controller(self._arm, *demanded)
        self._limits = limits
        return Watchdog(self._ip, self._latch)

    def measure(self) -> np.ndarray:
        if not self._arm.connected:
            raise RobotError(f"the connection to the xArm at {self._ip} is lost")
        code, (error, _) = self._arm.get_err_warn_code()
        self._demand("tell its errors", code)
        if error:
            raise RobotError(
                f"the xArm reports error {error} ({_words(error)}): see to it, and clear it there"
            )
        code, state = self._arm.get_state()
        self._demand("tell its state", code)
        if self._limits is not None and (state not in _CAN_MOVE or self._arm.mode != _ONLINE_MODE):
            raise RobotError(
                f"the xArm was stopped or taken over: state {state}, mode {self._arm.mode}"
            )
        return self._pose()[:3]

    def move_to(self, target: np.ndarray) -> np.ndarray:
        assert self._limits is not None, "allow_motion comes first"
        sent = np.asarray(target, np.float32)
        x, y, z = map(float, sent)
        code = self._arm.set_position(
            x,
            y,
            z,
            roll=180.0,
            pitch=0.0,
            yaw=self._yaw_deg,
            speed=self._limits.speed,
            mvacc=self._acceleration,
            wait=False,
        )
        self._demand(f"move to {x:.1f}, {y:.1f}, {z:.1f}", code)
        return sent.astype(float)

    def stop(self) -> None:
        self._demand("stop", self._arm.set_state(_STOPPED_STATE))

    def close(self) -> None:
        if self._arm is None:
            return
        try:
            if self._is_woken and self._arm.connected:
                self.stop()
        finally:
            self._is_woken, self._limits = False, None
            self._arm.disconnect()

    def _pose(self) -> np.ndarray:
        """(6,) x, y, z in mm and roll, pitch, yaw in degrees, with the tool pointing down."""
        # Not the SDK's get_position, which replaces NaN by the previous position.
        code, *pose = self._arm.core.get_tcp_pose()
        if code not in (0, 2) or len(pose) != 6 or not np.isfinite(pose).all():
            raise RobotError(f"the xArm does not tell where it is (code {code}, {pose})")
        roll, pitch = pose[3:5]
        if -math.cos(roll) * math.cos(pitch) < _MIN_DOWN_COSINE:
            raise RobotError(
                f"the tool must point down: roll is {math.degrees(roll):.0f}° and pitch "
                f"{math.degrees(pitch):.0f}°, expected 180° and 0°; turn it by hand"
            )
        return np.array([*pose[:3], *np.degrees(pose[3:])])

    @staticmethod
    def _demand(what: str, code: int) -> None:
        if code != 0:
            raise RobotError(f"the xArm does not {what} (code {code})")


def _words(error: int) -> str:
    from xarm.core.config.x_code import ControllerError

    return ControllerError(error).title["en"].strip()
