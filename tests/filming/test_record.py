"""`record`: what it films comes back by reading it, and simtune tunes to it."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from servo_arm import HEAD, write_arm
from short_training import STEPS, WORLDS

from simtune.algorithm import train
from simtune.cameras.lens import Lens
from simtune.cameras.views import View
from simtune.config import RecordConfig, TrainConfig
from simtune.errors import InputError
from simtune.filming import film as recording
from simtune.filming import record
from simtune.filming.cameras import _aspect, views_of
from simtune.filming.checks import check_written
from simtune.real.recorded import RecordedReal
from simtune.recordings import open_dataset
from simtune.tasks import Task, load_task

TASK = load_task("cartpole")
PARAMETER = '[[parameters]]\nname = "upper"\nkind = "mass"\nobjects = "upper"\n'


@pytest.fixture(autouse=True)
def short(monkeypatch):
    monkeypatch.setattr(
        recording, "load_task", lambda n: replace(load_task(n), episode_steps=STEPS)
    )


def asked(out: Path, **changes) -> RecordConfig:
    return replace(RecordConfig(task="cartpole", out=out, episodes=2, image_size=64), **changes)


def read(folder: Path, size: int = 64):
    return RecordedReal(open_dataset(folder, image_size=size, num_actions=1)).collect()


def test_a_recorded_dataset_is_read_back_as_it_was_filmed(tmp_path):
    trajectories = read(record(asked(tmp_path / "dataset")))
    assert [len(trajectory) for trajectory in trajectories] == [STEPS, STEPS]
    assert trajectories[0].step_s == pytest.approx(TASK.step_s)
    assert not np.array_equal(trajectories[0].actions, trajectories[1].actions)
    # The same seed films the same, and the pictures are the simulator's but for compression.
    again = read(record(asked(tmp_path / "again")))
    np.testing.assert_array_equal(again[1].frames, trajectories[1].frames)
    other = read(record(asked(tmp_path / "other", seed=1)))
    assert not np.array_equal(other[0].actions, trajectories[0].actions)
    simulator = TASK.simulator(image_size=64)
    rng = np.random.default_rng(0)
    actions = trajectories[0].actions[None].astype(float)
    rollouts = simulator.roll_out(TASK.parameters.nominal[None], actions, rng)
    drawn = simulator.film(rollouts)[0].astype(float)
    assert np.abs(drawn[-1] - trajectories[0].frames[-1]).mean() < 12  # of 255: the same scene


def test_a_world_has_the_parameters_of_the_file(tmp_path):
    file = tmp_path / "red.json"
    file.write_text(json.dumps({"ground_r": 1.0, "ground_g": 0.0, "ground_b": 0.0}))
    red, plain = (
        read(record(asked(tmp_path / name, parameters=given, episodes=1)))[0].frames[0]
        for name, given in (("red", file), ("plain", None))
    )
    changed = plain.astype(int) - red
    assert changed[..., 1:].mean() > 10  # less green and blue
    assert abs(changed[..., 0].mean()) < 3


@pytest.mark.thorough
def test_a_trained_policy_can_be_filmed(tmp_path, quick):
    run = tmp_path / "run"
    settings = {"policy_steps": 3 * WORLDS * STEPS, "scored_episodes": 1}
    train(TrainConfig(task="cartpole", out=run, method="oracle", **settings), settings=quick)
    asked_for = asked(tmp_path / "dataset", episodes=1, policy=str(run))
    (trajectory,) = read(record(asked_for, settings=quick))
    held = trajectory.actions.reshape(-1, 4)
    assert (np.ptp(held, axis=1) > 0).any()  # random actions are held for four steps
    with pytest.raises(InputError, match="was trained for cartpole, not for walker"):
        record(asked(tmp_path / "walker", task="walker", policy=str(run)), settings=quick)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"episodes": 0}, "--episodes must be at least 1, got 0"),
        ({"image_size": 65}, "--image-size must be an even number from 16 to 1024, got 65"),
        ({"policy": "nowhere"}, "must be random, scripted or a folder .* got nowhere"),
        ({"parameters": Path("nowhere.json")}, r"cannot read nowhere\.json"),
        ({"task": "cartpol"}, "did you mean 'cartpole'"),
    ],
)
def test_wrong_input_is_refused_and_nothing_is_written(changes, message, tmp_path):
    with pytest.raises(InputError, match=message):
        record(asked(tmp_path / "dataset", **changes))
    assert not list(tmp_path.iterdir())


def test_record_refuses_a_folder_that_is_not_empty(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match="exists already and is not empty"):
        record(asked(tmp_path))
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ([{"latency_s": 0.1}], "encoders of .* has a latency_s, and what simtune films is in time"),
        ([{}, {"name": "speeds"}], "two sensors of .* would both be written as 'shoulder'"),
        (
            [{"columns": ("observation.state[1]", "observation.state[0]")}],
            r"'observation.state\[1\]' of .* would be written as number 0 of",
        ),
        ([{"columns": ("elbow", "observation.state[2]")}], "would be written as number 1 of"),
        ([{"columns": ("observation.qpos",)}], "reads all of 'observation.qpos', and simtune"),
    ],
)
def test_what_would_not_be_read_back_is_not_recorded(changes, said, tmp_path):
    task = load_task(str(write_arm(tmp_path)))
    sensors = tuple(replace(task.sensors[0], **change) for change in changes)
    with pytest.raises(InputError, match=said):
        check_written(replace(task, sensors=sensors))
    check_written(task)
    in_order = ("observation.state[0]", "observation.state[1]")
    check_written(replace(task, sensors=(replace(task.sensors[0], columns=in_order),)))


def test_a_model_without_actuators_is_not_recorded(tmp_path):
    write_arm(tmp_path, HEAD + PARAMETER)
    model = tmp_path / "arm.xml"
    model.write_text(re.sub("<actuator>.*</actuator>", "", model.read_text(), flags=re.DOTALL))
    out = tmp_path / "dataset"
    with pytest.raises(InputError, match="has no actions, and a LeRobotDataset needs some"):
        record(RecordConfig(task=str(tmp_path / "tune.toml"), out=out))
    assert not out.exists()


def looking_at_a_region(task: Task, width: int, height: int) -> Task:
    """The same whose camera films width × height pixels, of which the middle is used."""
    (camera,) = task.cameras
    model = task.load_model()
    lens = Lens.pinhole(width, height, float(model.camera(camera.camera).fovy[0]))
    middle = (0.25 * width, 0.25 * height, 0.75 * width, 0.75 * height)
    return replace(task, cameras=(replace(camera, lens=replace(lens, region=middle)),))


@pytest.mark.parametrize(("size", "width"), [(128, 228), (96, 170)])
def test_a_region_of_a_wide_picture_has_an_even_width(size, width, tmp_path):
    lens = Lens.pinhole(1280, 720, fovy_deg=45)
    aspect = _aspect(asked(tmp_path, image_size=size), lens)
    assert View("front", aspect).width(size) == width
    assert _aspect(asked(tmp_path, image_size=size, width=width), lens) == aspect


@pytest.mark.thorough
def test_a_region_of_a_wide_picture_is_recorded_with_the_default_options(tmp_path, monkeypatch):
    task = replace(looking_at_a_region(TASK, 1280, 720), episode_steps=2)
    monkeypatch.setattr(recording, "load_task", lambda _: task)
    folder = record(asked(tmp_path / "dataset", episodes=1, image_size=128))
    dataset = open_dataset(folder, cameras=task.cameras, image_size=64)
    assert dataset.read(0).frames.shape == (3, 64, 113, 3)
    assert dataset.facts(1)["cameras"][0]["source_size"] == [128, 228]


@pytest.mark.parametrize("size", [{"width": 128, "image_size": 128}, {"image_size": 64}])
def test_pictures_of_another_shape_than_a_regions_are_not_recorded(size, tmp_path, monkeypatch):
    """Whoever reads them would be told that they are not of the tuning file's shape."""
    task = looking_at_a_region(TASK, 640, 480)
    monkeypatch.setattr(recording, "load_task", lambda _: task)
    with pytest.raises(InputError, match=r"of another shape than those .* 640×480; leave --width"):
        record(asked(tmp_path / "dataset", **size))
    assert not list(tmp_path.iterdir())


def test_a_region_is_filmed_before_all_of_the_background_picture(tmp_path):
    from matplotlib.image import imsave

    picture = np.random.default_rng(0).integers(0, 256, (48, 64, 3)).astype(np.uint8)
    imsave(tmp_path / "room.png", picture)
    task = looking_at_a_region(TASK, 640, 480)
    camera = replace(task.cameras[0], background=tmp_path / "room.png")
    (view,) = views_of(asked(tmp_path, image_size=48), replace(task, cameras=(camera,)))
    np.testing.assert_array_equal(view.plate, picture)
