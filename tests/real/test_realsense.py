"""librealsense's own pipeline, on what its own recorder wrote; and an xArm that it films."""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from servo import cartpole_with_servo

from simtune.errors import RobotError
from simtune.real.robot import RobotReal
from simtune.robot.realsense import RealSense
from simtune.robot.robot_file import read_robot
from simtune.simulation import JointActions
from simtune.tasks import load_task

rs = pytest.importorskip("pyrealsense2", exc_type=ImportError)  # also where libusb is missing

WIDTH, HEIGHT, NUM_FRAMES = 64, 48, 200
FIRST_MS, EVERY_MS = 5000.0, 1000 / 30


@pytest.fixture(scope="module")
def recording(tmp_path_factory) -> Path:
    """Of four seconds."""
    return record(tmp_path_factory.mktemp("camera") / "camera.db3", NUM_FRAMES)


def record(path: Path, num_frames: int) -> Path:
    """Every frame brighter by one than the one before, its left half black."""
    device = rs.software_device()
    sensor = device.add_sensor("Color")
    profile = sensor.add_video_stream(_stream()).as_video_stream_profile()
    recorder = rs.recorder(str(path), device)
    recorded = recorder.query_sensors()[0]
    recorded.open(recorded.get_stream_profiles()[0])
    recorded.start(rs.frame_queue(num_frames))
    kept = []  # librealsense reads the pictures later
    for number in range(num_frames):
        pixels = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
        pixels[:, WIDTH // 2 :] = number
        frame = rs.software_video_frame()
        frame.pixels, frame.stride, frame.bpp = pixels, 3 * WIDTH, 3
        frame.timestamp, frame.frame_number = FIRST_MS + number * EVERY_MS, number
        frame.domain, frame.profile = rs.timestamp_domain.system_time, profile
        sensor.on_video_frame(frame)
        kept.append(pixels)
        time.sleep(0.02)  # it plays at the speed that it was recorded at
    recorded.stop()
    recorded.close()
    del recorded, recorder  # which ends the file
    return path


def _stream():
    stream, lens = rs.video_stream(), rs.intrinsics()
    lens.width, lens.height, lens.ppx, lens.ppy, lens.fx, lens.fy = WIDTH, HEIGHT, 32, 24, 50, 50
    lens.model, lens.coeffs = rs.distortion.none, [0.0] * 5
    stream.type, stream.index, stream.uid = rs.stream.color, 0, 0
    stream.width, stream.height, stream.fps = WIDTH, HEIGHT, 30
    stream.bpp, stream.fmt, stream.intrinsics = 3, rs.format.rgb8, lens
    return stream


def test_pictures_come_with_their_times(recording):
    camera = RealSense(playback=recording)
    camera.connect()
    try:
        pictures = [camera.take_picture() for _ in range(20)]
    finally:
        camera.close()
    assert pictures[0].pixels.shape == (HEIGHT, WIDTH, 3)
    assert pictures[0].pixels.dtype == np.uint8
    numbers = np.array([picture.pixels[0, -1, 0] for picture in pictures], int)
    assert (np.diff(numbers) >= 1).all()
    assert all(not picture.pixels[:, : WIDTH // 2].any() for picture in pictures)
    times_s = np.array([picture.time_s for picture in pictures])
    np.testing.assert_allclose(times_s, (FIRST_MS + numbers * EVERY_MS) / 1000, atol=1e-3)


def test_a_camera_that_falls_silent_is_noticed(tmp_path):
    camera = RealSense(playback=record(tmp_path / "camera.db3", 50))
    camera.connect()
    try:
        for _ in range(25):
            camera.take_picture()
        with pytest.raises(RobotError, match="no picture within 100 ms"):
            list(iter(camera.take_picture, None))
    finally:
        camera.close()


def test_a_missing_camera_is_refused(tmp_path):
    with pytest.raises(RobotError, match="no RealSense 123 is connected; there are: "):
        RealSense(serial="123").connect()


@pytest.mark.thorough
def test_an_xarm_filmed_by_a_realsense(controller, recording, tmp_path):
    file = tmp_path / "arm.toml"
    file.write_text(
        f"""
        address = "{controller.ip}"
        ask = false
        actions = {{ moved = "-y", step = 10 }}
        workspace = {{ x = [200, 500], y = [-200, 200], z = [100, 400] }}
        start = {{ x = 305, y = 5, z = 200 }}
        camera = {{ playback = "{recording}", recorded_px = 32 }}
        """
    )
    steps = {"action_repeat": 20, "episode_steps": 5}
    task = replace(
        load_task("cartpole"), load_spec=cartpole_with_servo, **steps, map_actions=JointActions
    )
    settings = {"image_size": 16, "seed": 0, "folder": tmp_path / "filmed"}
    said = RobotReal(read_robot(file, "xarm"), task, move=False, **settings).dry_run()
    assert said.startswith("the robot is at x 300.0, y 0.0, z 200.0")
    assert not controller.moves
    real = RobotReal(read_robot(file, "xarm"), task, move=True, **settings)
    (trajectory,) = real.collect(1)
    sent = np.array([line[:3] for _, line in controller.moves[-5:]])
    assert (np.abs(sent[:, [0, 2]] - [305, 200]) < 0.01).all()
    # On the wire is the place before, which the fake has reached by then, less 10 an action.
    before = np.array([5.0, *sent[:-1, 1]])
    np.testing.assert_allclose(sent[:, 1] - before, -10 * trajectory.actions[:, 0], atol=2.6)
    assert controller.state == 4  # it does not stay ready to move
    assert np.ptp(trajectory.frames[:, :, -1].mean((1, 2))) > 5  # pictures of one after the other
