"""A robot whose joints are read, and a loose box that it pushes."""

from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from keypoint_evidence import tracks_at

from simtune.fit import JointMotion, Observed, Physics, left_open
from simtune.fit.motion.shooting import Shooting, ShootingFit
from simtune.fit.motion.shooting_config import ShootingConfig
from simtune.fit.readings.joint_motion import (
    keep_moved_keypoints,
    smoothed,
    told_offsets,
    without_readings,
)
from simtune.fit.readings.loop_setup import set_up_loop
from simtune.observation import AllEvidence, ObservationModel, finds_offset
from simtune.tasks import Task, load_task
from simtune.vision.keypoints import Keypoints, every_keypoint

MJCF = """<mujoco>
  <option timestep=".005" integrator="implicitfast"/>
  <worldbody>
    <geom type="plane" size="2 2 .1" friction=".01"/>
    <body name="pusher" pos="-.2 0 .05">
      <joint name="slider" type="slide" axis="1 0 0"/>
      <geom name="pad" type="box" size=".02 .04 .02" mass="1" friction=".01"/>
    </body>
    <body name="box" pos="0 0 .03">
      <freejoint name="box"/>
      <geom name="box" type="box" size=".03 .03 .03" mass=".3"/>
    </body>
  </worldbody>
  <actuator><position name="slider" joint="slider" kp="200" kv="20" ctrlrange="-1 1"/></actuator>
</mujoco>
"""
TUNE = """model = "pusher.xml"
control_timestep_s = 0.02
[initial_state]
kind = "distribution"
[initial_state.joints]
box = { position = [[-0.05, 0.05], [-0.01, 0.01], [0.03, 0.03]] }
[[sensors]]
name = "encoders"
joints = ["slider"]
noise = 0.0005
[[parameters]]
name = "kp"
kind = "gain"
objects = "slider"
[[parameters]]
name = "box_friction"
kind = "friction"
objects = "box"
nominal = 0.5
low = 0.05
high = 2.0
"""
TRUTH = {"kp": 260.0, "box_friction": 0.3}
OFFSET = 0.01  # m, of the encoder
STEPS, EPISODES = 100, 4
PX_PER_M = 100.0


def pixels(batch) -> np.ndarray:
    """(n, 4) two points of the box, from the side."""
    x, z = batch.qpos[:, 1:2], batch.qpos[:, 3:4]
    turn = 2 * batch.qpos[:, 6:7]  # about y, while it is small
    return np.hstack([x, z, x + 0.03, z - 0.03 * turn]) * PX_PER_M + 32


@pytest.fixture(scope="module")
def pushes(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    return pushed(tmp_path_factory.mktemp("pusher"), 3)


def pushed(folder: Path, seed: int) -> SimpleNamespace:
    """Episodes in which a pusher knocks a box about, with noisy readings."""
    (folder / "pusher.xml").write_text(MJCF)
    (folder / "tune.toml").write_text(TUNE)
    task = load_task(str(folder / "tune.toml"))
    assert isinstance(task, Task)
    space, rng = task.parameters, np.random.default_rng(seed)
    simulator, seen = task.simulator(image_size=64), ObservationModel.of_simulator(task.sensors)
    times = np.arange(STEPS) * 0.02
    swing = 0.1 + 0.12 * np.sin(times * rng.uniform(4, 7, (EPISODES, 1)) - 1)
    truth = space.from_dict(TRUTH)
    played = simulator.roll_out(
        np.repeat(truth[None], EPISODES, 0), swing[..., None], rng, seen.observe_beside(pixels)
    )
    points, exact = np.split(played.observed, [4], axis=-1)
    readings = seen.readings(exact, rng)["encoders"] + OFFSET
    tracks = tracks_at(points + 0.3 * rng.normal(size=points.shape), noise_px=0.3)
    evidence = AllEvidence((tracks, task.sensors[0].evidence(readings)))
    observed = Observed(evidence, swing[..., None])
    loop = set_up_loop(simulator, seen, space.nominal)
    physics = Physics(simulator, pixels, played.states[0, 0])
    states = physics.states(played.states)
    assert (np.ptp(states[..., 1], axis=1) > 0.02).sum() >= 3  # boxes are moved
    return SimpleNamespace(
        space=space, truth=truth, loop=loop, physics=physics, states=states, observed=observed
    )


def test_readings_give_the_robots_states_and_offsets_also_while_it_pushes(pushes):
    joints = JointMotion(pushes.loop, np.array([True]))
    assert finds_offset(pushes.loop.sensors).tolist() == [True]
    objects = np.full_like(pushes.states, 7.0)
    found, offsets = joints.find(pushes.observed, objects, pushes.truth)
    assert offsets == pytest.approx([OFFSET], abs=3e-4)
    off = found - pushes.states
    assert np.sqrt(np.square(off[..., 0]).mean()) < 5e-4  # m; readings have that noise
    assert np.median(np.abs(off[..., 8])) < 0.02  # m/s; neighbours' differences: .035
    assert (found[..., 1:8] == 7).all()  # the box is as it was guessed
    assert (found[..., 9:] == 7).all()
    assert joints.is_known.tolist() == 2 * ([True] + 6 * [False])


def test_what_a_gripper_holds_is_no_offset_of_its_encoder():
    """Held open by .09 to .3 rad in two thirds of the time; an encoder is off by .02 throughout."""
    rng = np.random.default_rng(0)
    missed = rng.normal([0.0, 0.02], 5e-4, (4, 90, 2))
    missed[:, 30:, 0] += np.linspace(0.09, 0.3, 60)
    missed[:, 80:] = np.nan
    assert told_offsets(missed) == pytest.approx([0.0, 0.02], abs=1e-4)


def test_a_known_offset_is_not_found_anew(pushes):
    _, offsets = JointMotion(pushes.loop, np.array([False])).find(
        pushes.observed, pushes.states, pushes.truth
    )
    assert offsets == [0]


def shooting(pushes, is_known: np.ndarray) -> Shooting:
    prior_std = np.where(is_known, 0.0, np.tile([0.02] * 4 + [0.1] * 3, 2))
    config = ShootingConfig().where_joints_are_known()
    friction = np.array([pushes.space.names.index("box_friction")])
    return Shooting(pushes.physics, prior_std, friction, config)


def fitted_friction(pushes) -> tuple[ShootingFit, np.ndarray, float, float]:
    """A fit from states that are a little off, these, its error and its standard deviation."""
    joints = JointMotion(pushes.loop, np.array([True]))
    rough = pushes.states.copy()
    rough[..., 1] += np.random.default_rng(4).normal(0, 0.003, rough[..., 1].shape)
    states, _ = joints.find(pushes.observed, rough, pushes.truth)
    observed, begin = without_readings(pushes.observed), pushes.truth.copy()
    begin[1] = 0.45
    fit = shooting(pushes, joints.is_known).fit(observed, states, begin)
    error = fit.unit[0] - pushes.space.to_unit(pushes.truth)[1]
    return fit, states, float(error), float(np.sqrt(fit.covariance[0, 0]))


def test_a_boxs_friction_is_found_and_the_robots_states_stay(pushes):
    fit, states, error, std = fitted_friction(pushes)
    assert abs(error) < 0.03
    assert std < 0.05
    kept = pushes.physics.states(fit.full_states[:, 0])
    begun = states[fit.episode, fit.step]
    np.testing.assert_array_equal(kept[:, [0, 8]], begun[:, [0, 8]])
    assert (kept[:, 1] != begun[:, 1]).any()


@pytest.mark.slow
def test_a_friction_that_few_windows_show_is_off_by_as_much_as_is_claimed(tmp_path: Path):
    ratios = []
    for seed in range(3, 15):
        (tmp_path / f"{seed}").mkdir()
        *_, error, std = fitted_friction(pushed(tmp_path / f"{seed}", seed))
        ratios.append(error / std)
    assert 0.5 < np.sqrt(np.mean(np.square(ratios))) < 1.3


def test_who_knows_the_robots_states_can_tell_more_of_the_box(pushes):
    observed = without_readings(pushes.observed)
    least = [
        shooting(pushes, is_known).fisher_covariance(observed, pushes.states, pushes.truth)[0][0, 0]
        for is_known in (np.tile([True] + 6 * [False], 2), np.zeros(14, bool))
    ]
    assert least[0] < 0.97 * least[1]


def test_only_keypoints_of_what_is_unknown_count(pushes):
    def see(batch) -> np.ndarray:
        return np.hstack([pixels(batch), batch.qpos[:, :1] * PX_PER_M, 0 * batch.qpos[:, :1]])

    known = pushes.physics
    physics = Physics(known.simulator, see, known.full_states(known.some_state))
    tracks = tracks_at(np.zeros((EPISODES, STEPS + 1, 6)), noise_px=0.3)
    evidence = AllEvidence((tracks, *pushes.observed.evidence.parts[1:]))
    observed, friction = Observed(evidence, pushes.observed.actions), np.array([1])
    unit = pushes.space.to_unit(pushes.truth)
    joints = JointMotion(pushes.loop, np.array([True]))
    for is_known, counted in ((joints.is_known, [1, 1, 0]), (np.zeros(14, bool), [1, 1, 1])):
        state_std = np.where(is_known, 0.0, 0.01)
        given = physics, pushes.states[:, 0], state_std, unit, friction
        left, readings = keep_moved_keypoints(observed, *given).evidence.parts
        expected = tracks.probability * np.array(counted)
        np.testing.assert_array_equal(left.probability, expected)
        assert readings is evidence.parts[1]


CAMERA = """[camera]
position_m = [0, -1, 0.3]
look_at_m = [0, 0, 0]
"""
POSE = """[[parameters]]
name = "camera"
kind = "camera_pose"
objects = "simtune_camera"
"""


SENSORS = TUNE[TUNE.index("[[sensors]]") : TUNE.index("[[parameters]]")]
ANYWHERE = TUNE.replace("box =", "slider = { position = [-0.1, 0.1] }\nbox =", 1)


@pytest.mark.parametrize(
    ("text", "bodies"),
    [
        (TUNE, {"box"}),
        (TUNE + POSE, {"pusher", "box"}),  # a camera's pose shows in the robot
        (ANYWHERE, {"box"}),
        (ANYWHERE.replace(SENSORS, ""), {"pusher", "box"}),
    ],
)
def test_keypoints_are_of_what_readings_leave_open(tmp_path, text, bodies):
    (tmp_path / "pusher.xml").write_text(MJCF)
    (tmp_path / "tune.toml").write_text(text.replace("[initial_state]", f"{CAMERA}[initial_state]"))
    task = load_task(str(tmp_path / "tune.toml"))
    assert isinstance(task, Task)
    simulator = task.simulator(image_size=32)
    seen, nominal = ObservationModel.of_reality(task.sensors), task.parameters.nominal
    keypoints = every_keypoint(simulator)
    assert isinstance(keypoints, Keypoints)
    kept = left_open(set_up_loop(simulator, seen, nominal), keypoints, nominal)
    model = simulator.model
    of = model.geom_bodyid[keypoints.geoms[kept]]
    assert {model.body(body).name for body in of} == bodies


GLIDING = """<body name="table"><geom name="top" type="box" size=".1 .1 .1" pos="1 0 .1"/>
  <body name="box" pos="0 0 .03">
    <joint name="box" type="slide" axis="1 0 0"/><joint name="box_y" type="slide" axis="0 1 0"/>
    <geom name="box" type="box" size=".03 .03 .03" mass=".3"/></body></body></worldbody>
  <contact><pair geom1="pad" geom2="box"/></contact>"""


def test_a_block_that_glides_on_a_body_that_never_moves(tmp_path):
    """In replays of readings the block touches nothing, and all else does as before."""
    begins = MJCF.index('    <body name="box"')
    scene = MJCF[:begins] + GLIDING + MJCF[MJCF.index("</worldbody>") :][len("</worldbody>") :]
    (tmp_path / "pusher.xml").write_text(scene)
    start = "box = { position = [[-0.05, 0.05], [-0.01, 0.01], [0.03, 0.03]] }"
    text = TUNE.replace(start, "box = { position = [-0.05, 0.05] }")
    (tmp_path / "tune.toml").write_text(text.replace("[initial_state]", f"{CAMERA}[initial_state]"))
    task = load_task(str(tmp_path / "tune.toml"))
    simulator, nominal = task.simulator(image_size=32), task.parameters.nominal
    loop = set_up_loop(simulator, ObservationModel.of_reality(task.sensors), nominal)
    model = loop.physics.simulator.model
    may_touch = {model.geom(geom).name for geom in np.flatnonzero(model.geom_contype)}
    assert {"top", "pad"} <= may_touch
    assert "box" not in may_touch
    data = mujoco.MjData(model)
    data.qpos[:2] = 0.2, 0.01  # of the pusher and the block: one within the other
    mujoco.mj_forward(model, data)
    assert data.nefc == 0
    keypoints = every_keypoint(simulator)
    of = model.geom_bodyid[keypoints.geoms[left_open(loop, keypoints, nominal)]]
    assert {model.body(body).name for body in of} == {"box"}


def test_smoothing_takes_noise_away_but_no_blow():
    rng, noise = np.random.default_rng(5), 0.001
    line = np.linspace(0, 1, 80) + 0.2 * (np.arange(80) >= 40)  # .2 at once
    values = np.stack([line, np.linspace(0, 1, 80)], -1)[None] + rng.normal(0, noise, (1, 80, 2))
    found, rate = smoothed(values)
    calm = np.r_[5:30, 50:75]
    assert found[0, calm, 0].tolist() == pytest.approx(line[calm].tolist(), abs=2 * noise)
    assert rate[0, calm].mean() == pytest.approx(1 / 79, rel=0.03)
    assert found[0, 39:41, 0] == pytest.approx(values[0, 39:41, 0])
    assert (found[0, :, 1] != values[0, :, 1]).all()  # of the other reading no blow


@pytest.mark.parametrize(
    ("lid", "known"), [("", True), ("<joint name='lid' axis='0 1 0'/>", False)]
)
def test_a_lid_that_nobody_reads_is_not_known(lid: str, known: bool, tmp_path: Path):
    body = f'<body name="door" pos="1 0 1">{lid}<geom name="door" size=".1"/></body></worldbody>'
    (tmp_path / "pusher.xml").write_text(MJCF.replace("</worldbody>", body))
    (tmp_path / "tune.toml").write_text(TUNE)
    task = load_task(str(tmp_path / "tune.toml"))
    seen = ObservationModel.of_simulator(task.sensors)
    loop = set_up_loop(task.simulator(image_size=16), seen, task.parameters.nominal)
    assert loop.unseen == ()
    assert loop.measured.is_loose.any()
    assert loop.measured.knows_all_but_objects is known
