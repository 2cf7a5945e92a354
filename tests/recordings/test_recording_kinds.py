"""Pairs of mp4 and csv, robomimic's HDF5, chosen actions, and steps of another rate."""

import csv
import json
import os
import shutil
import struct
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import h5py
import numpy as np
import pytest

from simtune.between_rows import typical_step_s
from simtune.cameras.footage import Footage
from simtune.checking.recorded import look_through
from simtune.config import RecordingsConfig
from simtune.errors import InputError
from simtune.recordings import Dataset, decode, open_dataset, write_dataset, write_video
from simtune.recordings.controllers import named_in
from simtune.recordings.fingerprint import fingerprint
from simtune.recordings.lerobot.features import _names
from simtune.recordings.resample import step_actions, step_readings, step_times
from simtune.recordings.robomimic import RobomimicSource
from simtune.recordings.source import Rows, short
from simtune.recordings.steps import make_steps
from simtune.trajectory import Trajectory

FPS, NUM_STEPS, SIZE = 10.0, 24, 32
NAMES = ["x", "y", "grip"]


def grey(frames: range | list[int]) -> np.ndarray:
    """(T, SIZE, SIZE, 3): frame t is of the grey value 8 t."""
    return (
        np.full((len(frames), SIZE, SIZE, 3), 1, np.uint8)
        * np.uint8(8)
        * np.array(frames, np.uint8).reshape(-1, 1, 1, 1)
    )


def shown(frames: np.ndarray) -> list[int]:
    """The inverse of `grey`."""
    return np.rint(frames.mean((1, 2, 3)) / 8).astype(int).tolist()


def actions(num: int = NUM_STEPS) -> np.ndarray:
    return np.random.default_rng(0).uniform(-1, 1, (num, 3)).astype(np.float32)


def write_pair(
    folder: Path, name: str, rows: np.ndarray, times_s: list[float] | None = None, **video: Any
) -> None:
    folder.mkdir(exist_ok=True)
    frames = grey(range(NUM_STEPS + 1))
    write_video(folder / f"{name}.mp4", frames, video.get("fps", FPS), crf=0)
    with (folder / f"{name}.csv").open("w", newline="") as file:
        header = (["time"] if times_s else []) + NAMES
        table = [[*([times_s[t]] if times_s else []), *row] for t, row in enumerate(rows.tolist())]
        csv.writer(file).writerows([header, *table])


def write_hdf5(path: Path, **options: Any) -> None:
    path.parent.mkdir(exist_ok=True)
    with h5py.File(path, "w") as file:
        for i in (10, 9):
            demo = file.create_group(f"data/demo_{i}")
            demo["actions"] = np.concatenate([actions(), actions(1)])
            for camera in ("agentview", "wrist"):
                demo.create_dataset(
                    f"obs/{camera}_image", data=grey(range(NUM_STEPS + 1)), **options
                )
            demo["obs/state"] = np.zeros((NUM_STEPS + 1, 4))
        arguments = {"env_name": "Lift", "env_kwargs": {"control_freq": FPS}}
        file["data"].attrs["env_args"] = json.dumps(arguments)


def write_variable(path: Path, times_s: list[float]) -> None:
    """A video whose frame t, of the grey value 8 t, is shown at times_s[t]."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=1000, options={"crf": "0"})
        stream.width, stream.height, stream.pix_fmt = SIZE, SIZE, "yuv420p"
        for picture, time_s in zip(grey(range(len(times_s))), times_s, strict=True):
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
            frame.pts, frame.time_base = round(1000 * time_s), Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


def message(path: Path, **options: Any) -> str:
    def read_all() -> None:
        dataset = open_dataset(path, **options)
        for episode in range(dataset.num_episodes):
            dataset.skim(episode)

    with pytest.raises(InputError) as caught:
        read_all()
    return str(caught.value).replace(str(path), "HERE")


def assert_whole(dataset: Dataset, *, frames: int = NUM_STEPS + 1) -> None:
    trajectory = dataset.read(0)
    assert shown(trajectory.frames) == list(range(frames))
    np.testing.assert_array_equal(trajectory.actions, actions()[: frames - 1])
    assert trajectory.step_s == pytest.approx(1 / FPS)


# --- pairs of mp4 and csv -----------------------------------------------------------------


@pytest.mark.parametrize("num_rows", [NUM_STEPS, NUM_STEPS + 1])
def test_a_row_a_frame(tmp_path, num_rows):
    """The last frame may have an action, whose outcome was not filmed, or none."""
    rows = np.concatenate([actions(), actions(1)])[:num_rows]
    write_pair(tmp_path / "pairs", "swing", rows)
    assert_whole(open_dataset(tmp_path / "pairs", num_actions=3))


def test_rows_that_say_when(tmp_path):
    times_s = [t / FPS for t in range(NUM_STEPS)]
    write_pair(tmp_path / "pairs", "swing", actions(), times_s)
    assert_whole(open_dataset(tmp_path / "pairs", num_actions=3))


def test_how_long_a_video_goes_on_after_its_actions_is_among_the_facts(tmp_path):
    write_pair(tmp_path / "pairs", "swing", actions()[:-3], [t / FPS for t in range(NUM_STEPS - 3)])
    dataset = open_dataset(tmp_path / "pairs", num_actions=3)
    dataset.skim(0)
    (unused,) = dataset.facts(1)["unused_s"].values()
    assert unused == pytest.approx([3 / FPS, (NUM_STEPS - 3) / FPS])


def test_a_frame_in_the_far_future_asks_for_no_memory(tmp_path):
    (tmp_path / "pairs").mkdir()
    times_s = [*(t / FPS for t in range(NUM_STEPS)), 1e5]
    write_variable(tmp_path / "pairs" / "swing.mp4", times_s)
    write_pair(tmp_path / "other", "swing", actions())
    shutil.copy(tmp_path / "other" / "swing.csv", tmp_path / "pairs")
    assert "swing lasts 100000 s, by its time stamps" in message(tmp_path / "pairs", control_hz=FPS)


def test_names_as_cameras_and_loggers_give_them(tmp_path):
    write_pair(tmp_path / "pairs", "GX01", actions(), [t / FPS for t in range(NUM_STEPS)])
    table = tmp_path / "pairs" / "GX01.csv"
    table.write_text(table.read_text().replace("time,", "Time_s,", 1))
    table.rename(table.with_suffix(".CSV"))
    (tmp_path / "pairs" / "GX01.mp4").rename(tmp_path / "pairs" / "GX01.MOV")
    assert_whole(open_dataset(tmp_path / "pairs", num_actions=3))
    assert RecordingsConfig(actions="grip, x").action_names == ("grip", "x")
    assert RecordingsConfig(observe="front, joints").observed == ("front", "joints")
    assert RecordingsConfig().observed is None
    (tmp_path / "pairs" / "GX01.mp4").touch()
    assert "GX01.mp4 and GX01.MOV have one name" in message(tmp_path / "pairs")


# What a file notes down of how the phone was held, clockwise, as the track's matrix has it
MATRICES = {0: (1, 0, 0, 1), 90: (0, 1, -1, 0), 180: (-1, 0, 0, -1), 270: (0, -1, 1, 0)}


def write_held(path: Path, picture: np.ndarray, matrix: Sequence[int]) -> None:
    """A video whose track has this matrix."""
    write_video(path, [picture] * 3, FPS, crf=0)
    content = bytearray(path.read_bytes())
    at = content.index(b"tkhd") + 4 + 40
    a, b, c, d = matrix
    content[at : at + 36] = struct.pack(">9i", *np.multiply([a, b, 0, c, d, 0, 0, 0, 2**14], 2**16))
    path.write_bytes(content)


@pytest.mark.parametrize("turned", MATRICES)
def test_a_phone_that_was_turned_films_upright_all_the_same(tmp_path, turned):
    picture = np.zeros((32, 64, 3), np.uint8)
    picture[:8, :16] = 250  # the upper left corner, as stored
    path = tmp_path / "swing.mp4"
    write_held(path, picture, MATRICES[turned])
    _, shown = next(decode(path))
    expected = np.rot90(picture, -turned // 90)
    assert shown.shape == expected.shape
    assert np.abs(shown.astype(int) - expected).mean() < 4
    if turned == 90:
        assert "the picture is upright, 32×64" in message(
            tmp_path, cameras=[Footage(is_square=True)]
        )


@pytest.mark.parametrize(
    ("matrix", "mirrored"),
    [
        ((-1, 0, 0, 1), np.fliplr),
        ((1, 0, 0, -1), np.flipud),
        ((0, 1, 1, 0), lambda picture: picture.swapaxes(0, 1)),
        ((0, -1, -1, 0), lambda picture: np.rot90(picture.swapaxes(0, 1), 2)),
    ],
)
def test_a_camera_that_mirrors_is_shown_as_players_do(tmp_path, matrix, mirrored):
    picture = np.zeros((32, 64, 3), np.uint8)
    picture[:8, :16] = 250
    write_held(tmp_path / "swing.mp4", picture, matrix)
    _, shown = next(decode(tmp_path / "swing.mp4"))
    expected = mirrored(picture)
    assert shown.shape == expected.shape
    assert np.abs(shown.astype(int) - expected).mean() < 4


def write_of_pixels(path: Path, aspect: Fraction) -> None:
    """A video of 64×32 pixels of this width over height; the picture's right half is bright."""
    picture = np.zeros((32, 64, 3), np.uint8)
    picture[:, 32:] = 200
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=10, options={"crf": "0"})
        stream.width, stream.height, stream.pix_fmt = 64, 32, "yuv420p"
        stream.codec_context.sample_aspect_ratio = aspect
        for _ in range(3):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode(None))


@pytest.mark.parametrize(
    ("aspect", "width"), [((4, 3), 85), ((10, 11), 58), ((1, 1), 64), ((0, 1), 64)]
)
def test_pixels_that_are_not_square_are_widened_as_a_player_does(tmp_path, aspect, width):
    write_of_pixels(tmp_path / "swing.mp4", Fraction(*aspect))
    for _, picture in decode(tmp_path / "swing.mp4"):
        assert picture.shape == (32, width, 3)
        bright = picture.mean((0, 2)) > 100
        assert bright.argmax() == pytest.approx(width / 2, abs=1)
    dataset = open_dataset(tmp_path)
    assert dataset.aspects == [width / 32]
    assert dataset.read(0).frames.shape == (3, 32, width, 3)


def test_pictures_are_too_large_as_they_are_shown(tmp_path, monkeypatch):
    monkeypatch.setattr("simtune.recordings.video.MOST_PIXELS", 100 * 32)
    write_of_pixels(tmp_path / "swing.mp4", Fraction(1, 1))
    assert open_dataset(tmp_path).aspects == [2]
    write_of_pixels(tmp_path / "swing.mp4", Fraction(2, 1))
    assert "pictures of 128×32 pixels; expected at most" in message(tmp_path)


def test_the_camera_began_before_the_robot_and_ran_faster(tmp_path):
    times_s = [0.4 + t / FPS for t in range(8)]
    write_pair(tmp_path / "pairs", "swing", actions(8), times_s, fps=2 * FPS)
    trajectory = open_dataset(tmp_path / "pairs").read(0)
    assert shown(trajectory.frames) == list(range(8, 25, 2))
    np.testing.assert_array_equal(trajectory.actions, actions(8))


def test_frames_at_varying_times(tmp_path):
    """Without a column of seconds rows belong to frames, whenever they were shown."""
    late_s = [t / FPS for t in range(NUM_STEPS + 1)]
    late_s[5:8] = [0.53, 0.59, 0.72]
    write_pair(tmp_path / "pairs", "swing", actions())
    write_variable(tmp_path / "pairs" / "swing.mp4", late_s)
    dataset = open_dataset(tmp_path / "pairs")
    trajectory = dataset.read(0)
    assert shown(trajectory.frames) == list(range(NUM_STEPS + 1))
    np.testing.assert_array_equal(trajectory.actions[9:], actions()[9:])
    # The action of row 4 was in force until 0.53 s.
    mixed = 0.3 * actions()[4] + 0.6 * actions()[5] + 0.1 * actions()[6]
    np.testing.assert_allclose(trajectory.actions[5], mixed, atol=1e-6)
    late_ms = dataset.facts(1)["cameras"][0]["time_error_ms"]
    assert late_ms == {"largest": pytest.approx(30), "mean": pytest.approx(60 / 25)}


@pytest.mark.parametrize(
    ("frame_hz", "steps_hz", "frame_ms"),
    [(30, 20, None), (30, 30, None), (30, 60, 33.3), (12, 20, 83.3)],
)
def test_how_often_frames_come_is_told_where_they_are_rarer_than_steps(
    frame_hz, steps_hz, frame_ms, tmp_path
):
    """As a phone films: each frame is up to 8 ms early or late."""
    rng, num = np.random.default_rng(0), 2 * frame_hz
    jitter_s = np.concatenate([[0], rng.uniform(-0.008, 0.008, num)])
    logged_s = np.arange(39) / 20
    write_pair(tmp_path / "pairs", "swing", actions(len(logged_s)), logged_s.tolist())
    write_variable(
        tmp_path / "pairs" / "swing.mp4", (np.arange(num + 1) / frame_hz + jitter_s).tolist()
    )
    dataset = open_dataset(tmp_path / "pairs", control_hz=steps_hz)
    dataset.skim(0)
    (camera,) = dataset.facts(1)["cameras"]
    assert camera["frame_ms"] == (frame_ms and pytest.approx(frame_ms, abs=2))
    assert camera["time_error_ms"]["largest"] < 500 / frame_hz + 8


def test_a_dropped_frame_is_stood_in_for_and_many_are_not(tmp_path):
    times_s = [t / FPS for t in range(NUM_STEPS)]
    write_pair(tmp_path / "pairs", "swing", actions(), times_s)
    left = [t / FPS for t in range(NUM_STEPS + 1) if t != 6]
    write_variable(tmp_path / "pairs" / "swing.mp4", left)
    frames = shown(open_dataset(tmp_path / "pairs").read(0).frames)
    assert frames[:6] + frames[7:] == list(range(24))
    assert frames[6] in (5, 6)
    left = [t / FPS for t in range(NUM_STEPS + 1) if t not in (6, 7, 8, 9)]
    write_variable(tmp_path / "pairs" / "swing.mp4", left)
    assert "swing, step 7: HERE/swing.mp4: no frame is shown" in message(tmp_path / "pairs")


def test_episodes_come_in_the_names_order(tmp_path):
    for name in ("swing10", "swing9", "swing1"):
        write_pair(tmp_path / "pairs", name, actions())
    (tmp_path / "pairs" / "notes.txt").touch()
    dataset = open_dataset(tmp_path / "pairs")
    assert dataset.episodes == ["swing1", "swing9", "swing10"]
    for episode in range(3):
        dataset.skim(episode)
    assert dataset.facts(3)["steps"] == 3 * NUM_STEPS
    assert message(tmp_path / "pairs", cameras=[Footage(key="front")]).startswith(
        "HERE: pairs of mp4 and csv have"
    )


def test_check_looks_at_every_episode(tmp_path):
    for i in range(4):
        rows = actions()
        rows[7, 1] = [0, np.nan, 0, np.inf][i]
        write_pair(tmp_path / "pairs", f"swing{i}", rows)
    said = []
    with pytest.raises(InputError) as caught:
        look_through(open_dataset(tmp_path / "pairs"), lambda doing, done: said.append(done))
    assert "swing1.csv: action is not finite" in str(caught.value)
    assert str(caught.value).endswith("; 1 more of 4 are unsound: swing3")
    assert said == [0, 0.25, 0.5, 0.75]


# --- robomimic's HDF5 ---------------------------------------------------------------------


@pytest.mark.parametrize("options", [{}, {"chunks": (7, SIZE, SIZE, 3), "compression": "gzip"}])
def test_robomimic(tmp_path, options):
    write_hdf5(tmp_path / "robot" / "image.hdf5", **options)
    for path in (tmp_path / "robot", tmp_path / "robot" / "image.hdf5"):
        dataset = open_dataset(path, cameras=[Footage(key="wrist")], num_actions=3)
        assert_whole(dataset)
        assert dataset.episodes == ["demo_9", "demo_10"]
    facts = dataset.facts(1)
    assert [facts[key] for key in ("robot_type", "fps", "kind")] == ["Lift", FPS, "robomimic HDF5"]
    assert [facts["cameras"][0][key] for key in ("key", "codec")] == ["wrist_image", "raw"]


def test_a_robomimic_file_is_open_only_while_it_is_read(tmp_path):
    path = tmp_path / "image.hdf5"
    write_hdf5(path)
    source = RobomimicSource(path, "wrist")
    rows = source.rows(0)
    assert len(list(source.pictures(0, rows.times_s[:2]))) == 2
    with h5py.File(path, "a"):  # refused while it is open elsewhere
        pass


OSC = {"right": {"type": "OSC_POSE", "gripper": {"type": "GRIP"}}}


@pytest.mark.parametrize(
    ("key", "facts", "said"),
    [
        (
            "env_args",
            {"env_kwargs": {"controller_configs": {"type": "OSC_POSE"}}},
            "env_args names the controller OSC_POSE: such actions are for a controller within the "
            "robot, not for actuators; log joint torques (sim.data.ctrl) or joint targets at every",
        ),
        (
            "env_info",  # robosuite 1.5, whose parts have a controller each
            {"controller_configs": {"type": "BASIC", "body_parts": OSC}},
            "env_info names the controller OSC_POSE: ",
        ),
        (
            "env_args",
            {"env_kwargs": {"controller_configs": [{"type": "JOINT_TORQUE"}, {"type": "IK_POSE"}]}},
            "env_args names the controller JOINT_TORQUE and IK_POSE: such actions are for ",
        ),
        ("env_args", {"env_kwargs": {"controller_configs": {"type": ["?"]}}}, "another robot?"),
        ("env_args", [], "another robot?"),
    ],
)
def test_actions_of_a_controller_within_the_robot_are_not_another_robot_s(
    tmp_path, key, facts, said
):
    write_hdf5(tmp_path / "image.hdf5")
    with h5py.File(tmp_path / "image.hdf5", "a") as file:
        del file["data"].attrs["env_args"]
        file["data"].attrs[key] = json.dumps(facts)
    told = message(tmp_path, num_actions=9, control_hz=FPS, cameras=())
    assert "the task takes 9 actions, the recording has 3" in told
    assert said in told


@pytest.mark.parametrize("asked", ["", "bag", "bag/bag_0.mcap"])
def test_a_ros_bag_is_refused_with_where_the_recipe_is(tmp_path, asked):
    (tmp_path / "bags" / "bag").mkdir(parents=True)
    for name in ("metadata.yaml", "bag_0.mcap"):
        (tmp_path / "bags" / "bag" / name).touch()
    with pytest.raises(InputError, match=r"a ROS bag, .* docs/recordings.md, under 'From a ROS 2"):
        open_dataset(tmp_path / "bags" / asked)


@pytest.mark.parametrize("num", [2, 4])
def test_demos_with_another_number_of_actions_are_refused(tmp_path, num):
    write_hdf5(tmp_path / "image.hdf5")
    with h5py.File(tmp_path / "image.hdf5", "r+") as file:
        del file["data/demo_10/actions"]
        file["data/demo_10/actions"] = np.zeros((NUM_STEPS, num))
    dataset = open_dataset(tmp_path, cameras=[Footage(key="wrist")])
    with pytest.raises(InputError, match=r"demo_10: expected actions \(T, 3\), as in demo_9, got"):
        dataset.read(1)


@pytest.mark.parametrize("names", [("agentview", "wrist"), ("wrist", "agentview")])
@pytest.mark.parametrize("num", [5, 400])
def test_demos_whose_cameras_have_other_numbers_of_pictures_are_refused(tmp_path, names, num):
    write_hdf5(tmp_path / "image.hdf5")
    with h5py.File(tmp_path / "image.hdf5", "r+") as file:
        del file["data/demo_10/obs/wrist_image"]
        file["data/demo_10/obs/wrist_image"] = grey(list(range(5)) * (num // 5))
    dataset = open_dataset(tmp_path, cameras=[Footage(key=name) for name in names])
    dataset.read(0)
    with pytest.raises(InputError, match=rf"demo_10 has 25 actions and {num} pictures; expected"):
        dataset.read(1)


def test_robomimic_cameras_and_rate(tmp_path):
    write_hdf5(tmp_path / "image.hdf5")
    said = message(tmp_path)
    assert said.endswith("[[cameras]]: agentview_image, wrist_image")
    said = message(tmp_path, cameras=[Footage(key="front")])
    assert said.endswith("no camera 'front'; there are: agentview_image, wrist_image")
    shutil.copy(tmp_path / "image.hdf5", tmp_path / "depth.hdf5")
    with h5py.File(tmp_path / "depth.hdf5", "r+") as file:
        del file["data"].attrs["env_args"]
    said = message(tmp_path / "depth.hdf5", cameras=[Footage(key="wrist")])
    assert said.endswith("give the rate as --control-hz")
    assert_whole(
        open_dataset(tmp_path / "depth.hdf5", cameras=[Footage(key="wrist")], control_hz=FPS)
    )
    assert message(tmp_path).endswith("give one of them: depth.hdf5, image.hdf5")


@pytest.mark.parametrize(
    ("spoilt", "said"),
    [("data", "no episode"), ("data/demo_9", "no pictures"), ("data/demo_9/obs", "no pictures")],
)
def test_numbers_where_a_group_should_be(tmp_path, spoilt, said):
    write_hdf5(tmp_path / "image.hdf5")
    with h5py.File(tmp_path / "image.hdf5", "a") as file:
        del file[spoilt]
        file[spoilt] = np.zeros(3)
    assert said in message(tmp_path)


def test_without_h5py_it_says_what_to_install(tmp_path, monkeypatch):
    write_hdf5(tmp_path / "image.hdf5")
    monkeypatch.setitem(__import__("sys").modules, "h5py", None)
    assert message(tmp_path).endswith("pip install h5py")


# --- which actions ------------------------------------------------------------------------


def test_chosen_actions_in_the_order_asked_for(tmp_path):
    write_pair(tmp_path / "pairs", "swing", actions())
    dataset = open_dataset(tmp_path / "pairs", num_actions=2, actions=("grip", "x"))
    np.testing.assert_array_equal(dataset.read(0).actions, actions()[:, [2, 0]])
    assert dataset.facts(1)["action_names"] == ["grip", "x"]


def test_actions_that_do_not_fit(tmp_path):
    write_pair(tmp_path / "pairs", "swing", actions())
    assert message(tmp_path / "pairs", num_actions=2) == (
        "HERE: the task takes 2 actions, the recording has 3 (x, y, grip); "
        "name the task's, in its order, by --actions NAME,NAME,...; in a CSV, columns that were "
        "measured are called measured.NAME"
    )
    assert message(tmp_path / "pairs", num_actions=7).endswith(
        "(x, y, grip); is it of another robot?"
    )
    assert message(tmp_path / "pairs", actions=("x", "z")) == (
        "no action 'z' in HERE; there are: x, y, grip"
    )
    assert message(tmp_path / "pairs", actions=("x", "y", "x")) == (
        "HERE: action 'x' is asked for twice; name it once"
    )
    said = message(tmp_path / "pairs", actions=("x",), num_actions=2)
    assert "takes 2 actions, --actions names 1 of 3 (x, y, grip)" in said


@pytest.mark.parametrize("name", ["waist", "shoulder"])
def test_an_action_whose_name_two_have_is_not_chosen_by_it(tmp_path, name):
    names = ["waist", "shoulder", "waist", "shoulder", "grip"]
    trajectory = Trajectory(grey(range(3)), np.eye(2, 5, dtype=np.float32), 1 / FPS)
    write_dataset(tmp_path / "arms", [trajectory], action_names=names, robot_type="", task="")
    assert message(tmp_path / "arms", actions=["grip", name]).startswith(
        f"HERE: more than one action {name!r}; there are: waist, shoulder, "
    )


def test_columns_are_separated_by_commas(tmp_path):
    write_pair(tmp_path / "pairs", "swing", actions())
    table = tmp_path / "pairs" / "swing.csv"
    table.write_text(table.read_text().replace(",", ";"))
    assert "swing.csv: expected commas between columns, got 'x;y;grip'" in message(
        tmp_path / "pairs"
    )


# --- steps of another rate ----------------------------------------------------------------


def test_typical_step():
    times_s = np.round(np.arange(100) / 30, 3)
    assert typical_step_s(times_s) == pytest.approx(1 / 30, rel=1e-4)
    assert typical_step_s(np.delete(times_s, [3, 50, 51])) == pytest.approx(1 / 30, rel=1e-4)


@pytest.mark.parametrize(("num", "together"), [(60, 2), (201, 2), (200, 3), (60, 4)])
def test_rows_in_bursts_come_as_often_as_there_are_of_them(num, together):
    """Stamped as they arrived, 1 ms apart."""
    rows = np.arange(num)
    bursts_s = rows // together * together / 50 + rows % together / 1000
    assert typical_step_s(bursts_s) == pytest.approx(1 / 50, rel=5e-3)


def test_rows_that_a_radio_link_lets_through_now_and_then_are_counted():
    passes_s = np.cumsum(np.random.default_rng(0).exponential(0.06, 300))
    sent_s = np.arange(200) / 50
    arrived_s = passes_s[np.searchsorted(passes_s, sent_s)] + sent_s / 50
    assert typical_step_s(arrived_s) == pytest.approx(1 / 50, rel=0.05)


def test_what_is_usual_of_changes_and_of_a_long_pause_is_what_is_between_them():
    begin_s = np.cumsum(np.random.default_rng(0).exponential(1.2, 80) + 0.2)
    moves_s = np.concatenate([start_s + np.arange(4) / 20 for start_s in begin_s])
    assert typical_step_s(moves_s) < 0.1
    paused_s = np.arange(100) / 20 + 30 * (np.arange(100) > 60)
    assert typical_step_s(paused_s) == pytest.approx(1 / 20)
    jitter_s = np.random.default_rng(0).uniform(-0.01, 0.01, 100)
    assert typical_step_s(np.arange(100) / 20 + jitter_s) == pytest.approx(1 / 20, rel=0.05)


@pytest.mark.parametrize("steps_hz", [50, 33])
def test_an_encoder_slower_than_steps_is_read_at_those_nearest_to_its_readings(steps_hz):
    """At every fourth of 100 rows a second, of which steps fall on others, or on none."""
    rows_s = np.arange(200) / 100
    found = np.full((200, 2), np.nan)
    found[1::4] = np.cos(5 * rows_s[1::4, None])
    found[81:94, 1] = np.nan  # four are missing
    rows = Rows(np.zeros((200, 1)), rows_s, rows_s[-1], found)
    grid_s = step_times(rows, 1 / steps_hz)
    read = step_readings(rows, grid_s)
    away_s = np.abs(grid_s[:, None] - rows_s[1::4]).min(1)
    (known,) = np.nonzero(np.isfinite(read[:, 0]))
    assert len(known) == 49
    assert away_s[known].max() <= 0.5 / steps_hz + 1e-9
    np.testing.assert_allclose(read[known, 0], np.cos(5 * grid_s[known]), atol=3e-4)
    (lost,) = np.nonzero(np.isnan(read[:, 1]) & np.isfinite(read[:, 0]))
    assert ((grid_s[lost] > 0.77) & (grid_s[lost] < 0.97)).all()
    assert len(lost) in (4, 5)


def test_longer_steps_keep_the_impulse():
    rows = Rows(np.array([[1.0], [2.0], [4.0], [8.0], [3.0]]), np.arange(5) / 10, 0.4)
    np.testing.assert_allclose(step_actions(rows, step_times(rows, 0.2)), [[1.5], [6.0]])
    thirds = step_actions(rows, step_times(rows, 0.15))
    np.testing.assert_allclose(thirds, [[(1 + 2 / 2) / 1.5], [(2 / 2 + 4) / 1.5]])
    np.testing.assert_allclose(step_actions(rows, step_times(rows, 0.1)), rows.actions[:4])


def test_long_steps_do_not_reach_beyond_the_last_row():
    times_s = np.arange(180) / 60
    rows = Rows(np.zeros((180, 1)), times_s, times_s[-1])
    np.testing.assert_allclose(step_times(rows, 1.0), [0, 1, 2])
    np.testing.assert_allclose(step_times(replace(rows, until_s=2.9999), 1.0), [0, 1, 2, 3])


def test_shorter_steps_hold():
    rows = Rows(np.array([[1.0], [2.0], [4.0]]), np.arange(3) / 10, 0.2)
    held = step_actions(rows, step_times(rows, 0.05))
    np.testing.assert_allclose(held, [[1.0], [1.0], [2.0], [2.0]])


def sum_of_a_fine_grid(rows: Rows, times_s: np.ndarray) -> np.ndarray:
    fine_s = (np.arange(200_000) + 0.5) / 200_000 * (times_s[-1] - times_s[0]) + times_s[0]
    held = rows.actions[np.searchsorted(rows.times_s, fine_s, side="right") - 1]
    step = np.searchsorted(times_s, fine_s, side="right") - 1
    return np.stack([held[step == k].mean(0) for k in range(len(times_s) - 1)])


def test_a_clock_that_rounds_leaves_actions_as_they_are():
    times_s = np.round(np.arange(31) / 30, 2)
    rows = Rows(np.arange(31.0)[:, None], times_s, times_s[-1])
    grid_s = step_times(rows, typical_step_s(times_s))
    np.testing.assert_array_equal(step_actions(rows, grid_s), rows.actions[: len(grid_s) - 1])


def test_uneven_rows_against_a_plain_mean():
    rng = np.random.default_rng(0)
    times_s = 0.3 + np.cumsum(rng.uniform(0.01, 0.09, 60))
    rows = Rows(rng.normal(size=(60, 2)), times_s, times_s[-1] + 0.05)
    grid_s = step_times(rows, 0.07)
    assert grid_s[0] == times_s[0]
    assert rows.until_s - 0.07 < grid_s[-1] <= rows.until_s + 1e-9
    expected = sum_of_a_fine_grid(rows, grid_s)
    np.testing.assert_allclose(step_actions(rows, grid_s), expected, atol=2e-3)


def write_all(root: Path) -> dict[str, Path]:
    trajectory = Trajectory(grey(range(NUM_STEPS + 1)), actions(), 1 / FPS)
    write_dataset(
        root / "lerobot", [trajectory], action_names=NAMES, robot_type="arm", task="swing", crf=0
    )
    write_pair(root / "pairs", "swing", actions())
    write_hdf5(root / "robot" / "image.hdf5")
    return {"lerobot": root / "lerobot", "pairs": root / "pairs", "robomimic": root / "robot"}


def test_all_kinds_give_the_same(tmp_path):
    for control_hz, frames, late_ms in (
        (None, range(25), 0.0),
        (5, range(0, 25, 2), 0.0),
        (4, [0, 2, 5, 8, 10, 12, 15, 18, 20, 22], 50.0),
        (25, None, 40.0),
    ):
        read = {}
        for kind, path in write_all(tmp_path / str(control_hz)).items():
            key = "wrist" if kind == "robomimic" else None
            dataset = open_dataset(path, cameras=[Footage(key=key)], control_hz=control_hz)
            read[kind] = dataset.read(0)
            facts = dataset.facts(1)
            (camera,) = facts["cameras"]
            assert camera["time_error_ms"]["largest"] == pytest.approx(late_ms, abs=0.01)
            assert facts["control_hz"] == pytest.approx(control_hz or FPS)
            assert facts["fps"] == FPS
        expected = read["robomimic"]
        if frames is not None:
            assert shown(expected.frames) in (list(frames), [0, 2, 5, 7, 10, 12, 15, 17, 20, 22])
        for got in read.values():
            np.testing.assert_allclose(got.actions, expected.actions, atol=1e-6)
            assert np.abs(np.subtract(shown(got.frames), shown(expected.frames))).max() <= 1


# --- gaps between rows --------------------------------------------------------------------


def write_log(folder: Path, name: str, times_s: np.ndarray) -> None:
    folder.mkdir(exist_ok=True)
    lines = [f"{time_s:.3f},{np.sin(time_s):.3f}" for time_s in times_s]
    (folder / f"{name}.csv").write_text("\n".join(["time,force", *lines]))


def gaps(folder: Path) -> dict[str, list]:
    dataset = open_dataset(folder, cameras=(), control_hz=10)
    for episode in range(dataset.num_episodes):
        dataset.skim(episode)
    return json.loads(json.dumps(dataset.facts(dataset.num_episodes)["gaps"]))


def test_rows_that_a_regular_log_lacks_are_among_the_facts(tmp_path):
    times_s = np.arange(100) / 10
    write_log(tmp_path / "logs", "whole", times_s)
    write_log(tmp_path / "logs", "two_lost", np.delete(times_s, [7, 8]))
    write_log(tmp_path / "logs", "cut", times_s[(times_s < 2.95) | (times_s > 5.95)])
    jitter_s = np.random.default_rng(0).uniform(-0.03, 0.03, 100)
    write_log(tmp_path / "logs", "uneven", np.delete(times_s + 1 + jitter_s, range(20, 24)))
    found = gaps(tmp_path / "logs")
    assert found["cut"] == [[2.9, 6.0]]
    assert found["uneven"] == [[pytest.approx(2.9, abs=0.03), pytest.approx(3.4, abs=0.03)]]
    assert set(found) == {"cut", "uneven"}


def test_a_log_of_changes_alone_has_no_gaps(tmp_path):
    """A command that is held for a while, and one that moves now and then."""
    rng = np.random.default_rng(0)
    write_log(tmp_path / "logs", "held", np.cumsum(rng.geometric(0.3, 60)) / 20)
    moves_s = [start_s + np.arange(15) / 50 for start_s in np.arange(0, 20, 1.3)]
    write_log(tmp_path / "logs", "moves", np.concatenate(moves_s))
    write_log(tmp_path / "logs", "a few", np.array([0.0, 1, 2, 3, 9, 10]))
    assert gaps(tmp_path / "logs") == {}


def test_where_nobody_acts_nothing_is_held(tmp_path):
    (tmp_path / "pairs").mkdir()
    times_s = [t / FPS for t in range(NUM_STEPS + 1) if t not in (6, 7, 8)]
    (tmp_path / "pairs" / "swing.csv").write_text("time\n" + "\n".join(map(str, times_s)))
    assert gaps(tmp_path / "pairs") == {}


# --- where files lie, and whether they are the same ---------------------------------------


def test_links_out_of_the_folder_are_followed(tmp_path):
    """Hubs' caches keep a dataset as links to files that lie elsewhere."""
    for kind, path in write_all(tmp_path / "real").items():
        linked = tmp_path / "linked" / kind
        for file in path.rglob("*.*"):
            if file.is_file():
                link = linked / file.relative_to(path)
                link.parent.mkdir(parents=True, exist_ok=True)
                os.symlink(file, link)
        camera = "wrist" if kind == "robomimic" else None
        dataset = open_dataset(linked, cameras=[Footage(key=camera)])
        assert shown(dataset.read(0).frames) == list(range(25))
        assert (
            dataset.content_hash == open_dataset(path, cameras=[Footage(key=camera)]).content_hash
        )


def test_large_files_are_told_apart_by_blocks(tmp_path):
    path = tmp_path / "large.bin"
    with path.open("wb") as file:
        file.truncate(200_000_000)
    before = fingerprint(tmp_path, [path])
    for place in (0, 199_999_999):
        with path.open("r+b") as file:
            file.seek(place)
            file.write(b"x")
        after = fingerprint(tmp_path, [path])
        assert after != before
        before = after
    with path.open("r+b") as file:
        file.truncate(199_999_999)
    assert fingerprint(tmp_path, [path]) != before


@pytest.mark.parametrize("control_hz", [None, 5.0])
def test_videos_alone_are_of_what_nobody_acts_on(control_hz, tmp_path):
    write_pair(tmp_path / "pairs", "swing", actions())
    (tmp_path / "pairs" / "swing.csv").unlink()
    dataset = open_dataset(tmp_path / "pairs", num_actions=0, control_hz=control_hz)
    trajectory = dataset.read(0)
    every = 1 if control_hz is None else 2
    assert shown(trajectory.frames) == list(range(0, NUM_STEPS + 1, every))
    assert trajectory.actions.shape == (NUM_STEPS // every, 0)
    assert dataset.facts(1)["action_ranges"] == {}
    with pytest.raises(
        InputError, match=r"takes 3 actions, .* has none; a CSV beside each video has"
    ):
        open_dataset(tmp_path / "pairs", num_actions=3)


@pytest.mark.parametrize("own_rate", [True, False])
def test_an_action_at_the_last_frame_may_be_missing_since_none_is_carried_out(own_rate):
    times_s, actions = np.arange(5) * 0.1, np.array([[1.0], [2], [3], [4], [np.nan]])
    step_s = 0.1 if own_rate else 0.05
    steps = make_steps("it", Rows(actions, times_s, times_s[-1]), step_s, {})
    assert steps.actions[:, 0].tolist() == np.repeat([1, 2, 3, 4], 1 if own_rate else 2).tolist()
    with pytest.raises(InputError, match="action is not finite"):
        make_steps("it", Rows(actions, times_s, times_s[-1] + 0.1), step_s, {})


def test_names_by_place_are_in_their_order_though_places_are_texts():
    names = {f"j{i}": str(i) for i in range(11)}
    assert list(_names(names)) == [f"j{i}" for i in range(11)]
    assert list(_names({"b": "1", "a": 0})) == ["a", "b"]


def test_a_video_of_one_frame_is_no_recording(tmp_path):
    write_video(tmp_path / "one.mp4", np.zeros((1, 32, 32, 3), np.uint8), 20)
    with pytest.raises(InputError, match=r"one\.mp4: holds one frame; expected at least 2"):
        open_dataset(tmp_path, image_size=32, num_actions=0)


def test_a_video_of_one_frame_has_no_rate_beside_a_table_of_times_either(tmp_path):
    write_pair(tmp_path, "one", actions(2), [0.0, 0.05])
    write_video(tmp_path / "one.mp4", grey([1]), FPS)
    assert message(tmp_path, num_actions=3) == "HERE/one.mp4: holds one frame; expected at least 2"


def test_numbers_have_no_underscore(tmp_path):
    write_pair(tmp_path, "swing", actions())
    table = tmp_path / "swing.csv"
    lines = table.read_text().splitlines()
    table.write_text("\n".join([*lines[:2], "0.5,1_0,0", *lines[3:]]))
    told = message(tmp_path, num_actions=3)
    assert told == "line 3 of HERE/swing.csv: expected a number, got '1_0'"


def test_endings_may_be_in_capitals_whatever_the_kind(tmp_path):
    write_hdf5(robot := tmp_path / "robot" / "A.HDF5")
    np.savez(tmp_path / "a.npz", hz=FPS, actions=actions(), frames=grey(range(NUM_STEPS + 1)))
    (tmp_path / "arrays").mkdir()
    (tmp_path / "a.npz").rename(tmp_path / "arrays" / "A.NPZ")
    write_pair(tmp_path / "pairs", "a", actions())
    for ending in ("mp4", "csv"):
        (tmp_path / "pairs" / f"a.{ending}").rename(tmp_path / "pairs" / f"A.{ending.upper()}")
    cameras = [Footage(key="wrist")]
    for path in (robot.parent, robot):
        assert_whole(open_dataset(path, cameras=cameras))
    with h5py.File(robot, "a") as file:
        file["data"].attrs["env_info"] = json.dumps({"controller_configs": {"type": "OSC_POSE"}})
    assert "controller OSC_POSE" in str(named_in(robot))
    for kind in ("arrays", "pairs"):
        dataset = open_dataset(tmp_path / kind)
        assert_whole(dataset)
        assert list(dataset.episodes) == ["A"]
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "A.MCAP").touch()
    assert "a ROS bag" in message(tmp_path / "bag")


def test_a_long_list_of_names_says_how_many_more_there_are():
    assert short([f"joint {i}" for i in range(14)]).endswith("joint 11 and 2 more")
    assert short(["a\nb"]) == r"'a\nb'"
