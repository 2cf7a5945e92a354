"""`simtune check` of joint readings: what shows in them, against derivatives done by hand."""

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import MagicMock

import mujoco
import numpy as np
import pytest
from matplotlib.image import imread
from servo_arm import write_arm

from simtune import cli
from simtune.checking import check, table
from simtune.checking.mistakes.joint_ranges import beyond_ranges
from simtune.checking.reading_errors import of_recorded, of_simulated
from simtune.checking.readings import (
    ReadEpisodes,
    look_at_servos,
    read_episodes,
    reading_changes,
)
from simtune.checking.sensitivity.parameters import one_by_one
from simtune.checking.sensitivity.reading_changes import ReadingChanges, ReplayedReadings
from simtune.checking.servos.commands import commands_of, servos_of
from simtune.config import CheckConfig, TuneConfig
from simtune.errors import InputError
from simtune.experiment.settings import Settings
from simtune.fit import OpenLoopReplay, Readings
from simtune.observation import JointSensor
from simtune.real.observed import observed, open_recordings
from simtune.recordings import write_dataset
from simtune.tasks import Task, load_task
from simtune.trajectory import Trajectory
from simtune.tuning.search import TimeNeeded
from simtune.tuning_run import tune

STEP_S, NUM_STEPS = 0.05, 60
SCENE = """
<mujoco>
  <option timestep="0.005" gravity="0 0 0" integrator="implicitfast"/>
  <worldbody>
    <camera name="front" pos="0 -3 0" xyaxes="1 0 0 0 0 1"/>
    <body name="cart">
      <joint name="slide" type="slide" axis="1 0 0" damping="1"/>
      <geom size=".1" mass="2"/>
    </body>
    <body name="arm" pos="0 0 1">
      <joint name="elbow" axis="0 1 0" damping=".1"/>
      <geom type="capsule" fromto="0 0 0 .4 0 0" size=".03" mass="1"/>
    </body>
  </worldbody>
  <actuator>
    <motor name="push" joint="slide" ctrllimited="true" ctrlrange="-4 4"/>
    <position name="servo" joint="elbow" kp="40" kv="4" gear="2"/>
  </actuator>
  <keyframe><key name="rest" qpos="0 0"/></keyframe>
</mujoco>
"""
TUNE = """
model = "scene.xml"
control_timestep_s = 0.05
episode_steps = 60
camera = "front"

[initial_state]
kind = "keyframe"
keyframe = "rest"

[[sensors]]
name = "arm"
joints = "elbow"
unit = "deg"
noise = 0.1

[[sensors]]
name = "cart"
joints = "slide"

[[parameters]]
name = "cart_mass"
kind = "mass"
objects = "cart"

[[parameters]]
name = "push_gain"
kind = "gain"
objects = "push"

[[parameters]]
name = "servo_gain"
kind = "gain"
objects = "servo"

[[parameters]]
name = "arm_r"
field = "geom_rgba"
objects = "geom 1"
component = 0
low = 0
high = 1
"""
BLIND = TUNE.replace('camera = "front"\n', "")
TRUTH = {"servo_gain": 55.0}


def write_task(folder: Path, text: str = BLIND) -> Task:
    (folder / "scene.xml").write_text(SCENE)
    (folder / "tune.toml").write_text(text)
    return load_task(str(folder / "tune.toml"))


@pytest.fixture(scope="module")
def blind(tmp_path_factory) -> Task:
    return write_task(tmp_path_factory.mktemp("blind"))


def episodes(task: Task, num: int = 3) -> list[Trajectory]:
    """Of a world with another gain; targets of the elbow in rad: half the control, by the gear."""
    times, rng = np.arange(NUM_STEPS) * STEP_S, np.random.default_rng(0)
    simulator = task.simulator(image_size=16)
    phases = rng.uniform(0, 6, (num, 2, 1))
    push = 3 * np.sign(np.sin(3 * times + phases[:, 0]))
    turn = 1.2 * np.sin((2 + 0.1 * phases[:, 1]) * times)  # from rest
    actions = np.stack([push, turn], -1)
    worlds = np.tile(task.parameters.from_dict(TRUTH), (num, 1))
    model = observed(task, ["joints"], is_simulated=True)
    played = simulator.roll_out(worlds, actions, rng, model.observe_beside())
    readings = model.readings(played.observed, rng)
    return [
        Trajectory(
            np.empty((NUM_STEPS + 1, 0, 0, 3), np.uint8),
            actions[i].astype(np.float32),
            STEP_S,
            {s.name: s.to_recorded(readings[s.name][i]) for s in task.sensors},
        )
        for i in range(num)
    ]


def write_recordings(folder: Path, trajectories: list[Trajectory]) -> Path:
    names = {"arm": ["elbow"], "cart": ["slide"]}
    write_dataset(
        folder,
        trajectories,
        action_names=["push", "servo"],
        robot_type="arm",
        task="swing",
        reading_names=names,
    )
    return folder


@pytest.fixture(scope="module")
def recorded(blind, tmp_path_factory) -> Path:
    return write_recordings(tmp_path_factory.mktemp("recorded") / "dataset", episodes(blind))


def test_changes_equal_a_plain_replay(blind):
    simulator, space = blind.simulator(image_size=16), blind.parameters
    seen = observed(blind, None, is_simulated=True)
    actions = np.stack([t.actions for t in episodes(blind)])
    changed = one_by_one(space, space.nominal)
    replayed = ReplayedReadings(simulator, seen, space.nominal, actions)
    found = replayed.changes(changed, np.array([1e-3, 1e-3]))
    rng, worlds = np.random.default_rng((0, 1)), np.tile(space.nominal, (3, 1))
    before = simulator.roll_out(worlds, actions.astype(float), rng, seen.observe_beside())
    for i, parameters in enumerate(changed):
        after = simulator.roll_out(
            np.tile(parameters, (3, 1)),
            actions.astype(float),
            rng,
            seen.observe_beside(),
            starts=before.states[:, 0],
        )
        away = after.observed - before.observed
        np.testing.assert_allclose(found.rms[i], np.sqrt(np.square(away).mean((0, 1))), atol=1e-9)
        np.testing.assert_allclose(found.largest[i], np.abs(away).max((0, 1)), atol=1e-9)
    assert found.labels == ("elbow", "slide")
    assert found.units == ("rad", "m")
    assert found.changes.tolist() == [True, True, True, False]
    assert found.main[:3].tolist() == [1, 1, 0]


def test_how_large_actions_are_is_told_where_every_episode_diverges(blind):
    simulator, seen = blind.simulator(image_size=16), observed(blind, None, is_simulated=True)
    actions = np.zeros((2, NUM_STEPS, 2))
    actions[0, 3:, 1], actions[1, 3:, 1] = 1e9, -2e9
    said = r"every episode diverged\. The largest actions are servo 2e\+09: are they in"
    with pytest.raises(RuntimeError, match=said):
        ReplayedReadings(simulator, seen, blind.parameters.nominal, actions)
    actions[:, 3:, 0] = 1e9
    clipped = r"servo 2e\+09, push 1e\+09 \(the model's range is -4 to 4\): are they in"
    with pytest.raises(RuntimeError, match=clipped):
        ReplayedReadings(simulator, seen, blind.parameters.nominal, actions)


@pytest.mark.parametrize("num", [0, 1])
def test_a_model_that_diverges_of_itself_is_not_asked_for_the_unit_of_its_actions(tmp_path, num):
    motor = '<motor name="push" joint="slide"/>' * num
    (tmp_path / "scene.xml").write_text(
        '<mujoco><option timestep="0.1"/><worldbody><body><joint name="slide" type="slide"/>'
        '<joint name="hinge" stiffness="1e9" ref="1" springref="3"/>'
        f'<geom size=".1" pos=".1 0 0"/></body></worldbody><actuator>{motor}</actuator></mujoco>'
    )
    (tmp_path / "tune.toml").write_text(
        'model = "scene.xml"\ncontrol_timestep_s = 0.1\n[[sensors]]\nname = "s"\n'
        'joints = "slide"\nunit = "m"\n[[parameters]]\nname = "d"\nkind = "damping"\n'
        'objects = "slide"\nnominal = 1\n'
    )
    task = load_task(str(tmp_path / "tune.toml"))
    simulator, seen = task.simulator(image_size=16), observed(task, None, is_simulated=True)
    with pytest.raises(RuntimeError, match="diverged, without any action: the timestep may be"):
        ReplayedReadings(simulator, seen, task.parameters.nominal, np.zeros((1, 40, num)))


def test_twice_the_noise_tells_a_quarter(blind):
    simulator, space = blind.simulator(image_size=16), blind.parameters
    seen = observed(blind, None, is_simulated=True)
    actions = np.stack([t.actions for t in episodes(blind)])
    replayed = ReplayedReadings(simulator, seen, space.nominal, actions)
    # Starts, of which a little is known before, blur that hardly
    one, two = (replayed.changes(space.nominal[None], np.full(2, n)) for n in (1e-3, 2e-3))
    gains = np.array([1, 2])
    np.testing.assert_allclose(
        two.information[gains, gains] / one.information[gains, gains], 0.25, rtol=0.3
    )
    eigenvalues = np.linalg.eigvalsh(one.information[:2, :2])
    assert eigenvalues[0] < 0.03 * eigenvalues[1]  # mass and gain: their ratio alone


def test_readings_that_may_be_late_tell_less_of_what_looks_alike(tmp_path):
    """As in a fit, where a servo's gain and the lateness of its encoder go together."""
    task = load_task(str(write_arm(tmp_path)))
    simulator, space = task.simulator(image_size=16), task.parameters
    act = simulator.explore(3, task.episode_steps, rng := np.random.default_rng(0))
    worlds = np.tile(space.nominal, (3, 1))
    actions = simulator.play(worlds, act, task.episode_steps, rng).actions
    std = []
    for is_simulated in (True, False):
        seen = observed(task, None, is_simulated=is_simulated)
        replayed = ReplayedReadings(simulator, seen, space.nominal, actions)
        found = replayed.changes(space.nominal[None], np.full(2, 1e-3))
        std.append(np.sqrt(np.diag(np.linalg.inv(found.information))))
    less = dict(zip(space.names, std[1] / std[0], strict=True))
    assert min(less.values()) >= 1 - 1e-9
    assert less["shoulder_kp"] > 1.2


def test_servos_of_recordings(blind, recorded):
    config = CheckConfig(task="blind", real=recorded)
    seen = observed(blind, None, is_simulated=False)
    dataset = open_recordings(recorded, blind, config, 16, seen)
    simulator = blind.simulator(image_size=16, step_s=dataset.step_s)
    read = read_episodes(dataset, 3, simulator, seen)
    assert list(read.servos) == ["elbow"]  # the cart has a motor
    servo = read.servos["elbow"]
    assert read.facts["elbow"]["unit"] == "rad"
    # Of a servo the error in velocity is kv / kp of it, beside the joint's own damping
    assert 0.03 < servo.lag_s < 0.15
    assert servo.commanded == pytest.approx(1.2, rel=0.02)  # half of −1.2 to 1.2
    assert abs(servo.offset) < 0.02
    assert servo.filtered_rms < servo.rms < 0.05
    assert read.warnings == []
    curve = read.curves["elbow"]
    left = curve.measured[: len(curve.predicted)] - curve.predicted
    assert np.sqrt(np.mean(left**2)) < 2 * servo.filtered_rms
    changes, assumed = reading_changes(simulator, seen, np.zeros((1, 20, 2)), read, 0)
    assert "0.5 s at a time" in assumed
    assert changes.information_at_best is not None  # the elbow declares a noise of .1°
    assert changes.information_at_best[2, 2] > 9 * changes.information[2, 2]


def test_recorded_readings_may_leave_their_own_noise_at_best(blind):
    seen, real = observed(blind, None, is_simulated=False), episodes(blind)
    sensors = seen.sensors
    values = Readings.of(
        [replace(t, readings=seen.in_units(t.readings, STEP_S)) for t in real], sensors
    )
    errors = of_recorded(values.values, {}, seen.reading_labels, sensors, STEP_S)
    assert errors.at_best is not None
    elbow, slide = errors.at_best
    assert elbow == pytest.approx(np.deg2rad(0.1)), "declared"
    assert slide == pytest.approx(0.001, rel=0.6), "by how rough they are"
    assert np.all(errors.noise > 10 * errors.at_best)
    assert of_simulated(sensors).at_best is None


@pytest.mark.parametrize(
    ("actions", "target"),
    [
        ("", 0.6),  # the control, by the gear
        ("mapping = 'scaled'\nactuators = ['servo', 'push']\ngain = [0.5, 1]\noffset = 0.2", 0.4),
        ("mapping = 'joints'\nactuators = ['servo']\nper_unit = 0.1", 0.25 + 0.1),  # by 1 at most
    ],
)
def test_commands_of_a_servo_by_hand(tmp_path, actions, target):
    task = write_task(tmp_path, BLIND + f"\n[actions]\n{actions}\n" * bool(actions))
    simulator = task.simulator(image_size=16)
    num, column = len(simulator.action_mapping.names), 0 if "servo" in actions else 1
    given = np.zeros((300, num), np.float32)
    given[:, column] = 1.2
    frames = np.empty((301, 0, 0, 3), np.uint8)
    readings = {"arm": np.full((301, 1), 0.25), "cart": np.zeros((301, 1))}
    trajectory = Trajectory(frames, given, STEP_S, readings)
    servo, none = servos_of(simulator, task.sensors)
    assert none is None  # a motor moves the cart
    assert servo is not None
    (controls,) = commands_of(simulator, task.sensors, [trajectory])
    np.testing.assert_allclose(servo.targets(controls), np.full(300, target), rtol=1e-6)


def test_what_integrates_its_control_is_no_servo_of_positions(tmp_path):
    scene = SCENE.replace('<position name="servo" joint="elbow" kp="40" kv="4" gear="2"/>', "")
    speed = '<intvelocity name="servo" joint="elbow" kp="40" kv="4" actrange="-1 1"/>'
    (tmp_path / "scene.xml").write_text(scene.replace("</actuator>", f"{speed}</actuator>"))
    (tmp_path / "tune.toml").write_text(BLIND)
    task = load_task(str(tmp_path / "tune.toml"))
    assert servos_of(task.simulator(image_size=16), task.sensors) == [None, None]


def test_a_lost_packet_changes_no_servo(blind):
    simulator, seen = blind.simulator(image_size=16), observed(blind, None, is_simulated=False)
    sound = [replace(t, readings=seen.in_units(t.readings, STEP_S)) for t in episodes(blind)]
    spoilt = [replace(t, readings={k: v.copy() for k, v in t.readings.items()}) for t in sound]
    spoilt[1].readings["arm"][30] = 655.35
    spoilt[2].readings["cart"][10:] = np.nan
    expected, found = (look_at_servos(t, simulator, seen) for t in (sound, spoilt))
    missing, lost = found.warnings
    assert "84% of the steps of episode 2, counted from 0, lack slide" in missing
    assert "elbow reads 655 rad at step 30 of episode 1" in lost
    servo = expected.servos["elbow"]
    assert found.servos["elbow"].rms == pytest.approx(servo.rms, rel=0.02)
    assert found.servos["elbow"].lag_s == pytest.approx(servo.lag_s, rel=0.02)


def test_readings_in_other_units_are_noticed(recorded, tmp_path):
    task = write_task(tmp_path, BLIND.replace('unit = "deg"\nnoise = 0.1', 'unit = "rad"'))
    config = CheckConfig(task="x", real=recorded)
    seen = observed(task, None, is_simulated=False)
    dataset = open_recordings(recorded, task, config, 16, seen)
    (said,) = read_episodes(dataset, 3, task.simulator(image_size=16, step_s=STEP_S), seen).warnings
    assert 'are its readings degrees? give the sensor unit = "deg"' in said


def test_a_run_warns_of_its_readings_as_check_does(recorded, tmp_path, monkeypatch, caplog):
    task = write_task(tmp_path, BLIND.replace('unit = "deg"\nnoise = 0.1', 'unit = "rad"'))
    seen = observed(task, None, is_simulated=False)
    dataset = open_recordings(recorded, task, CheckConfig(task="x", real=recorded), 16, seen)
    simulator = task.simulator(image_size=16, step_s=STEP_S)
    real = read_episodes(dataset, 3, simulator, seen).trajectories
    real[1].readings["arm"][30] = 1e5
    search = SimpleNamespace(
        measure_time=lambda _: TimeNeeded(1.0, 1.0, 0.1, ""), stop_reason="done"
    )
    config = TuneConfig(task="x", real=str(recorded), out=tmp_path / "run")
    begun = SimpleNamespace(
        warnings=lambda _: ["a gap"],
        film_warnings=lambda: ["a film"],
        recordings=real,
        real=SimpleNamespace(facts={"names": ["episode 4", "episode 6", "episode 7"]}),
        search=search,
        search_name="posterior",
        simulator=simulator,
        context=SimpleNamespace(observation=seen),
        config=config,
    )
    ended = MagicMock(num_rounds=1, wall_s=0.0)
    ended.__enter__.return_value = ended
    asked_s = []

    def look_in_time(*given: Any) -> ReadEpisodes:
        asked_s.append(given[-1])
        return look_at_servos(*given)

    monkeypatch.setattr("simtune.checking.expected_precision.look_at_servos", look_in_time)
    monkeypatch.setattr("simtune.tuning_run.build_experiment", lambda *_: begun)
    monkeypatch.setattr("simtune.tuning_run.Run", lambda *_: ended)
    tune(config, settings=cast(Settings, object()))
    _, found, warnings, _ = ended.finish.call_args.args
    assert asked_s == [0.05 * 60 * config.budget_minutes]  # for mistakes in readings
    assert "servo_gain" in found["check"]
    gap, film, lost, said = warnings
    assert (gap, film) == ("a gap", "a film")
    assert "reads 1e+05 rad at step 30 of episode 6 " in lost
    assert 'are its readings degrees? give the sensor unit = "deg"' in said
    assert warnings == [record.getMessage() for record in caplog.records][:4]

    # A session that only ends the run is too short to look again
    kept = json.loads(json.dumps(ended.to_keep))
    monkeypatch.setattr("simtune.tuning_run.kept_state", lambda _: kept)
    tune(replace(config, budget_minutes=0.01), settings=cast(Settings, object()))
    _, again, kept_warnings, _ = ended.finish.call_args.args
    assert (again, kept_warnings) == (found, warnings)
    assert len(asked_s) == 1


def test_check_without_a_camera(tmp_path):
    write_task(tmp_path)
    result = check(CheckConfig(task=str(tmp_path / "tune.toml"), episodes=3))
    said = result["parameters"]
    assert said["servo_gain"]["verdict"] == "shows clearly"
    assert said["servo_gain"]["reading"] == "elbow"
    assert said["arm_r"]["verdict"] == "does not show"
    assert said["arm_r"]["note"] == "changes no reading: it cannot be found from these sensors"
    assert "picture_levels" not in said["servo_gain"]
    (pair,) = result["pairs"]
    assert pair["parameters"] == ["cart_mass", "push_gain"]
    assert "their ratio, cart_mass / push_gain" in pair["says"]
    printed = "\n".join(table(result))
    assert "told to  standard deviation that the best fit to such readings could have" in printed
    for word in ("picture", "video", "pixel"):
        assert word not in printed


@pytest.mark.thorough
def test_check_with_a_camera_and_sensors_shows_both(tmp_path):
    write_task(tmp_path, TUNE)
    config = CheckConfig(task=str(tmp_path / "tune.toml"), episodes=2)
    both = check(config)
    one = check(CheckConfig(task=config.task, episodes=2, observe="cameras"))
    assert both["parameters"]["arm_r"]["verdict"] == "shows clearly"
    gain = both["parameters"]["servo_gain"]
    assert gain["std_percent"] < one["parameters"]["servo_gain"]["std_percent"]
    assert gain["reading_rms"] > 0 < gain["motion_rms_px"]
    assert "reading" not in one["parameters"]["servo_gain"]
    printed = "\n".join(table(both))
    assert "best fit to such videos and readings could have" in printed


@pytest.mark.parametrize("steps", [1, 2])
def test_an_episode_that_broke_off_is_warned_of(blind, tmp_path, steps):
    whole, other = episodes(blind, 2)
    broken = replace(
        other,
        frames=other.frames[: steps + 1],
        actions=other.actions[:steps],
        readings={name: values[: steps + 1] for name, values in other.readings.items()},
    )
    folder = write_recordings(tmp_path / "recorded", [whole, broken])
    write_task(tmp_path)
    result = check(CheckConfig(task=str(tmp_path / "tune.toml"), real=folder))
    assert set(result["servos"]) == {"elbow"}
    (said,) = [warning for warning in result["warnings"] if "leave it out" in warning]
    assert f"episode 1 has {steps} steps: `simtune tune` needs at least 8" in said
    assert (result["episodes"], result["steps"]) == (1, NUM_STEPS)


def test_recordings_without_an_episode_that_is_long_enough_are_refused(blind, tmp_path):
    (short,) = episodes(blind, 1)
    short = replace(
        short,
        frames=short.frames[:5],
        actions=short.actions[:4],
        readings={name: values[:5] for name, values in short.readings.items()},
    )
    folder = write_recordings(tmp_path / "recorded", [short, short])
    write_task(tmp_path)
    with pytest.raises(InputError, match=r"no episode has the 8 steps .*, the longest has 4: rec"):
        check(CheckConfig(task=str(tmp_path / "tune.toml"), real=folder))


def test_the_command_says_how_servos_follow(recorded, tmp_path, monkeypatch, capsys):
    write_task(tmp_path)
    arguments = ["simtune", "check", str(tmp_path / "tune.toml"), "--real", str(recorded)]
    monkeypatch.setattr(sys, "argv", arguments)
    cli.main()
    lines = capsys.readouterr().out.splitlines()
    assert any(" at best  told to  verdict" in line for line in lines)
    assert any(
        line.startswith("  at best  the same if it left nothing of the readings") for line in lines
    )
    head, row = next((a, b) for a, b in pairwise(lines) if "lag" in a)
    assert head.split()[:4] == ["joint", "moves", "lag", "steps"]
    assert row.startswith("elbow")
    drawn = tmp_path / "follow.png"
    monkeypatch.setattr(sys, "argv", [*arguments, "--json", "--pictures", str(drawn)])
    cli.main()
    result = json.loads(capsys.readouterr().out)
    gain = result["parameters"]["servo_gain"]
    assert gain["std_percent_at_best"] < gain["std_percent"]
    assert gain["interval_share_at_best"] < gain["interval_share"]
    assert set(result["servos"]) == {"elbow"}
    assert result["recordings"]["cameras"] == []
    assert "films" not in result
    assert result["servo_pictures"] == str(drawn)
    picture = imread(drawn)
    assert picture.shape[1] == 1100
    assert np.ptp(picture[..., :3]) > 0.5


def test_readings_that_span_more_than_a_joint_can_move_are_noticed():
    scene = SCENE.replace('type="slide"', 'type="slide" limited="true" range="-.2 .3"')
    model = mujoco.MjModel.from_xml_string(scene)
    slide = SimpleNamespace(joints=("slide",), is_position=True, unit="m")
    sensors = cast(list[JointSensor], [slide])
    read = np.linspace(0, 1, 200).reshape(2, 100, 1)
    (said,) = beyond_ranges(model, sensors, read, [1.25])
    assert said.startswith("slide reads 0.01 to 0.99 m, farther apart than the model's joint can")
    assert "-0.2 to 0.3" in said
    assert not beyond_ranges(model, sensors, 5 + 0.5 * read, [1.25]), "its zero may be anywhere"
    assert beyond_ranges(model, sensors, 1.6 * read, [3.0]), "as nothing that strikes it explains"
    assert not beyond_ranges(model, sensors, read, [3.0]), "compared with its commands"
    free = mujoco.MjModel.from_xml_string(SCENE)
    assert not beyond_ranges(free, sensors, read, [1.25])
    assert not beyond_ranges(model, sensors, np.full_like(read, np.nan), [1.25])


def astray(monkeypatch, which: slice) -> None:
    """The model diverges from where the readings of some of three stretches begin."""
    play = OpenLoopReplay.play

    def diverging(self, stretches, starts, worlds):
        predicted, states = play(self, stretches, starts, worlds)
        if predicted.shape[1] == 3:
            predicted[:, which] = np.nan
        return predicted, states

    monkeypatch.setattr(OpenLoopReplay, "play", diverging)


def test_a_model_that_goes_astray_is_told_with_what_readings_show(recorded, tmp_path, monkeypatch):
    write_task(tmp_path, BLIND.replace('unit = "deg"\nnoise = 0.1', 'unit = "rad"'))
    astray(monkeypatch, slice(None))
    with pytest.raises(InputError, match=r"are its readings degrees.*the model goes astray there"):
        check(CheckConfig(task=str(tmp_path / "tune.toml"), real=recorded))


def changes_of(task: Task) -> Callable[[], ReadingChanges]:
    """How its readings change with its parameters, in simulated episodes."""
    simulator, space = task.simulator(image_size=16), task.parameters
    seen, changed = observed(task, None, is_simulated=True), one_by_one(space, space.nominal)
    actions = np.stack([t.actions for t in episodes(task)])
    replayed = ReplayedReadings(simulator, seen, space.nominal, actions)
    return lambda: replayed.changes(changed, np.array([1e-3, 1e-3]))


def test_episodes_from_which_the_model_goes_astray_tell_nothing(blind, monkeypatch):
    changes = changes_of(blind)
    whole = changes()
    astray(monkeypatch, slice(1))
    found = changes()
    assert np.isfinite(found.rms).all()
    assert 0 < np.abs(found.rms - whole.rms).max() < whole.rms.max()
    assert np.isfinite(found.information).all()


def test_a_wheel_that_has_turned_many_times_has_not_gone_astray(blind, monkeypatch):
    changes = changes_of(blind)
    expected, play = changes(), OpenLoopReplay.play

    def far_from_zero(self, stretches, starts, worlds):
        predicted, states = play(self, stretches, starts, worlds)
        return predicted + 3000.0, states

    monkeypatch.setattr(OpenLoopReplay, "play", far_from_zero)
    np.testing.assert_allclose(changes().rms, expected.rms, rtol=1e-6)
