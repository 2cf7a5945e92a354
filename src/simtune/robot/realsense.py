"""An Intel RealSense camera, or a recording by one, through librealsense's pipeline."""

from pathlib import Path
from typing import Any

import numpy as np

from simtune.errors import InputError, RobotError
from simtune.robot.robot import Picture

_WIDTH, _HEIGHT, _FPS = 640, 480, 30  # supported by every model
_NEXT_WITHIN_MS = 100  # time of three pictures; the robot is not watched during the wait
_FIRST_WITHIN_MS = 5000  # exposure must settle, and USB wake up


class RealSense:
    """A `Camera`; times are seconds of the camera's clock, which follows the host's clock."""

    def __init__(self, serial: str | None = None, playback: Path | None = None):
        """`serial` chooses among several cameras; `playback`: a recorded .db3 or .bag instead."""
        self._serial, self._playback = serial, playback
        self._pipeline: Any = None

    def connect(self) -> None:
        rs = _librealsense()
        config, pipeline = rs.config(), rs.pipeline()
        if self._playback:
            config.enable_device_from_file(str(self._playback), repeat_playback=False)
        else:
            config.enable_device(self._find(rs))
            config.enable_stream(rs.stream.color, _WIDTH, _HEIGHT, rs.format.rgb8, _FPS)
        try:
            pipeline.start(config)
        except RuntimeError as error:
            raise RobotError(f"the RealSense does not start: {error}") from None
        self._pipeline = pipeline
        self._next(_FIRST_WITHIN_MS)

    def _find(self, rs: Any) -> str:
        """The serial number; checked first, since a pipeline waits long for a missing camera."""
        known = [d.get_info(rs.camera_info.serial_number) for d in rs.context().query_devices()]
        if self._serial in known or (self._serial is None and len(known) == 1):
            return self._serial or known[0]
        wanted = f"no RealSense {self._serial} is" if self._serial else "not just one RealSense is"
        raise RobotError(f"{wanted} connected; there are: {', '.join(known) or 'none'}")

    def take_picture(self) -> Picture:
        if not self._playback:  # drop old pictures; a file has none
            while self._pipeline.poll_for_frames():
                pass
        return self._next(_NEXT_WITHIN_MS)

    def close(self) -> None:
        if self._pipeline is not None:
            self._pipeline.stop()
            self._pipeline = None

    def _next(self, within_ms: int) -> Picture:
        try:
            frame = self._pipeline.wait_for_frames(within_ms).get_color_frame()
        except RuntimeError:
            raise RobotError(f"the camera gave no picture within {within_ms} ms") from None
        if not frame:
            raise RobotError("the camera gave no colour picture")
        # A copy, since librealsense reuses the memory.
        return Picture(np.array(frame.get_data()), frame.get_timestamp() / 1000)


def _librealsense() -> Any:
    try:
        import pyrealsense2
    except ModuleNotFoundError:
        raise InputError("a RealSense needs pyrealsense2: pip install pyrealsense2") from None
    except ImportError as error:  # a system library is missing
        raise InputError(
            f"pyrealsense2 cannot be loaded: {error}; on Debian: apt install libusb-1.0-0"
        ) from None
    return pyrealsense2
