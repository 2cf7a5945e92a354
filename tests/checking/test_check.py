"""`simtune check`: what shows and what does not, against worlds whose answer is known."""

import json
import re
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import h5py
import mujoco
import numpy as np
import pytest
from late_actuators import delay

from simtune import cli
from simtune.budget import Budget
from simtune.cameras.footage import Footage
from simtune.cameras.views import View
from simtune.checking import check, table
from simtune.checking.conclusions import conclude_on_parameters
from simtune.checking.expected_precision import expected_precision
from simtune.checking.recording_warnings import recording_warnings
from simtune.checking.sensitivity.parameters import Sensitivity, analyze, one_by_one
from simtune.checking.sensitivity.pictures import (
    WINDOW_STEPS,
    CameraChanges,
    motion_changes,
    motion_covariance,
    picture_changes,
    short_plays,
)
from simtune.columns import two_digits
from simtune.config import CheckConfig
from simtune.errors import InputError
from simtune.fit.motion import shooting
from simtune.observation import ObservationModel
from simtune.parameters import Parameter, ParameterSpace, camera_pose, colour, dynamics
from simtune.recordings import write_dataset
from simtune.simulation import Rollouts, Simulator, random_actions
from simtune.simulation.actions import DirectActions
from simtune.tasks import TASKS, Task
from simtune.trajectory import Trajectory
from simtune.vision.keypoints import candidate_keypoints

STATE = mujoco.mjtState.mjSTATE_INTEGRATION
SIZE, DEPTH_M, FOVY = 64, 6.0, 50.0
FOCAL_PX = SIZE / 2 / np.tan(np.radians(FOVY) / 2)
CAMERA = f'<camera name="front" pos="0 -{DEPTH_M} 0" xyaxes="1 0 0 0 0 1" fovy="{FOVY}"/>'

PENDULUM = f"""
<mujoco>
  <worldbody>
    {CAMERA}
    <geom name="hidden" type="sphere" size=".1" pos="0 -9 0" rgba=".5 .5 .5 1"/>
    <body name="box" pos="-1 0 0"><geom type="box" size=".2 .2 .2" mass="1"/></body>
    <body name="arm">
      <joint name="hinge" axis="0 1 0" damping=".2"/>
      <geom name="arm" type="capsule" fromto="0 0 0 0 0 -.8" size=".1" mass="1"/>
    </body>
  </worldbody>
  <actuator>
    <motor name="turn" joint="hinge" gear="2" ctrllimited="true" ctrlrange="-1 1"/>
    <motor name="idle" joint="hinge" gear="0" ctrllimited="true" ctrlrange="-1 1"/>
  </actuator>
</mujoco>
"""
SLIDER = f"""
<mujoco>
  <option gravity="0 0 0"/>
  <worldbody>
    {CAMERA}
    <body name="cart">
      <joint name="slide" type="slide" axis="1 0 0"/>
      <geom name="cart" type="box" size=".2 .1 .1" mass="2"/>
    </body>
  </worldbody>
  <actuator><motor name="push" joint="slide" ctrllimited="true" ctrlrange="-1 1"/></actuator>
</mujoco>
"""
MASS_KG = 2.0
CHANGING = [
    "choosing keypoints",
    "changing one parameter after the other",
    "asking how well the best fit could tell: 0 of {} short windows",
]
NUM_EPISODES = 12


def anywhere(batch, rng) -> None:
    batch.qpos[:] = rng.uniform(-0.5, 0.5, batch.qpos.shape)


def make_task(name: str, xml: str, parameters: list) -> Task:
    return Task(
        name=name,
        description="of a test",
        load_spec=lambda: mujoco.MjSpec.from_string(xml),
        parameters=ParameterSpace(parameters, where=name),
        cameras=(Footage(camera="front"),),
        control_timestep_s=0.02,
        action_repeat=4,
        episode_steps=48,
        initialize=anywhere,
    )


def pendulum() -> Task:
    parameters = [
        dynamics("box_mass", "body_mass", ("box",), nominal=1.0, unit="kg"),
        dynamics("damping", "dof_damping", ("hinge",), nominal=0.2, unit="N·m·s/rad"),
        *colour("arm", ("arm",), (0.7, 0.4, 1.0)),
        *colour("hidden", ("hidden",), (0.5, 0.5, 0.5)),
    ]
    return make_task("pendulum", PENDULUM, parameters)


def slider() -> Task:
    parameters = [
        dynamics("mass", "body_mass", ("cart",), nominal=MASS_KG, unit="kg"),
        dynamics("gain", "actuator_gainprm", ("push",), component=0, nominal=2.0, unit="N"),
    ]
    return make_task("slider", SLIDER, parameters)


class Scene:
    """A task's simulator and what it plays."""

    def __init__(self, task: Task):
        self.task = task
        self.simulator: Simulator = task.simulator(image_size=SIZE)
        rng = np.random.default_rng(0)
        self.actions = random_actions(
            NUM_EPISODES, task.episode_steps, self.simulator.action_mapping, rng
        )
        self.keypoints = candidate_keypoints(
            self.simulator.model, [View(task.cameras[0].camera)], SIZE
        )
        nominal = np.tile(task.parameters.nominal, (NUM_EPISODES, 1))
        self.episodes: Rollouts = self.simulator.roll_out(
            nominal, self.actions, rng, self.keypoints.observe
        )

    def conclude(self) -> dict:
        sensitivity = analyze(self.simulator, self.actions, 0, ObservationModel.of_simulator())
        return conclude_on_parameters(self.task.parameters, sensitivity)


@pytest.fixture(scope="module")
def swinging() -> Scene:
    return Scene(pendulum())


@pytest.fixture(scope="module")
def sliding() -> Scene:
    return Scene(slider())


# --- what shows ---------------------------------------------------------------------------


@pytest.mark.thorough
def test_check_tells_what_shows_from_what_does_not(swinging):
    said = swinging.conclude()["parameters"]
    assert said["damping"]["verdict"] == "shows clearly"
    assert 0 < said["damping"]["std_percent"] < 10
    assert said["damping"]["note"] == ""
    for name in ("box_mass", "hidden_r"):
        assert said[name]["verdict"] == "does not show"
        assert "changes neither picture nor motion" in said[name]["note"]
        assert said[name]["motion_largest_px"] == said[name]["picture_share"] == 0
    for name in ("arm_r", "arm_g", "arm_b"):
        assert said[name]["verdict"] == "shows clearly"
        assert said[name]["picture_levels"] > 10
        assert "std" not in said[name]
    assert said["arm_r"]["changed_to"] == pytest.approx(0.8)
    assert said["arm_b"]["changed_to"] == pytest.approx(0.9)  # away from its bound
    assert said["damping"]["changed_to"] == pytest.approx(0.24)


def test_mass_and_gain_of_a_slider_show_only_in_their_ratio(sliding):
    said = sliding.conclude()
    (pair,) = said["pairs"]
    assert pair["parameters"] == ["mass", "gain"]
    assert pair["correlation"] > 0.95
    assert "told together only: their ratio, mass / gain" in pair["says"]
    for name, other in (("mass", "gain"), ("gain", "mass")):
        assert said["parameters"][name]["verdict"] == "does not show"
        assert other in said["parameters"][name]["note"]
        assert said["parameters"][name]["motion_rms_px"] > 0.2
    json.dumps(said)


def seen_alike(space: ParameterSpace, size: np.ndarray, **others: np.ndarray) -> Sensitivity:
    """Of parameters at their nominal values, which show by (N,) `size` in each way."""
    return Sensitivity(
        parameters=space.nominal,
        pictures=CameraChanges.nothing(len(space))._replace(
            levels=size, pixel_share=size, rms_px=size, largest_px=size
        ),
        **others,
    )


def test_a_sum_is_of_one_unit():
    """Metres and radians of a camera add to nothing; what looks like what is said instead."""
    space = ParameterSpace(camera_pose("cam", "front", (0.0, -1.5, 1.0)))
    few, correlation = np.full(len(space), 0.01), np.eye(len(space))
    for a, b, value in ((0, 1, 0.9), (2, 3, -0.9)):  # x and y; z and pitch
        correlation[a, b] = correlation[b, a] = value
    sensitivity = seen_alike(
        space,
        few,
        changed=space.nominal + few,
        motion_std=few,
        picture_std=few,
        first_width=np.full(len(space), 0.2),
        correlation=correlation,
    )
    said = [pair["combination"] for pair in conclude_on_parameters(space, sensitivity)["pairs"]]
    assert said == [
        "their difference, cam_x − cam_y",
        "a larger cam_z looks like a larger cam_pitch",
    ]


@pytest.mark.parametrize(
    ("b_std", "said"),
    [
        (0.01, "their ratio, a / b"),
        (0.05, "their ratio, a / b^0.2"),
        (0.25, "a larger a looks like a smaller b"),
        (0.0004, "a larger a looks like a smaller b"),
    ],
)
def test_a_power_that_says_little_but_of_one_parameter_is_not_told(b_std, said):
    """As by `tune`, which gives no interval of such a combination."""
    space = ParameterSpace(
        [dynamics(name, "body_mass", (name,), nominal=1.0, unit="kg") for name in ("a", "b")]
    )
    sensitivity = seen_alike(
        space,
        np.ones(2),
        changed=1.2 * space.nominal,
        motion_std=np.array([0.01, b_std]),
        picture_std=np.full(2, np.inf),
        first_width=np.full(2, 2.2),
        correlation=np.array([[1.0, 0.95], [0.95, 1.0]]),
    )
    (pair,) = conclude_on_parameters(space, sensitivity)["pairs"]
    assert pair["combination"] == said


@pytest.mark.parametrize(
    ("scale", "nominal", "low", "high", "to"),
    [
        ("log", 1.0, 1.0, 1.15, 1.15),  # narrower than a factor of 1.2: to the farther bound
        ("log", 1.15, 1.0, 1.15, 1.0),
        ("log", 1.0, 0.95, 1.15, 1.15),
        ("log", 1.0, 0.9, 1.05, 0.9),
        ("log", 1.0, 0.5, 1.1, 1 / 1.2),
        ("log", 1.0, 0.5, 1.5, 1.2),
        ("linear", 1.0, 0.0, 1.0, 0.9),
    ],
)
def test_a_parameter_is_changed_within_its_range(scale, nominal, low, high, to):
    some, other = (
        Parameter(name=name, field="body_mass", objects=(name,), unit="kg", **bounds)
        for name, bounds in (
            ("a", {"scale": scale, "nominal": nominal, "low": low, "high": high}),
            ("b", {"nominal": 1.0, "low": 0.1, "high": 10.0}),
        )
    )
    space = ParameterSpace([some, other])
    expected = [[to, 1.0], [nominal, 1.2]]
    np.testing.assert_allclose(one_by_one(space, space.nominal), expected, rtol=1e-12)


def test_a_reason_why_nothing_shows_is_given_only_where_nothing_does():
    """A ball that bounces between the states looked at touches nothing in any of them."""
    space = ParameterSpace(
        [
            dynamics(name, "body_mass", (name,), nominal=1.0, unit="kg")
            for name in ("felt", "unfelt")
        ]
    )
    size, few = np.array([0.5, 0.0]), np.full(2, 0.1)
    sensitivity = seen_alike(
        space,
        size,
        changed=space.nominal + few,
        motion_std=np.array([0.5, np.inf]),
        picture_std=np.full(2, np.inf),
        first_width=np.full(2, 2.2),
        correlation=np.eye(2),
    )
    found = conclude_on_parameters(
        space, sensitivity, dict.fromkeys(space.names, "touches nothing")
    )
    notes = {name: facts["note"] for name, facts in found["parameters"].items()}
    assert notes == {"felt": "", "unfelt": "touches nothing"}


@pytest.mark.parametrize(
    ("told", "at_best", "verdict"),
    [
        (0.02, 0.002, "shows clearly"),
        (0.5, 0.002, "shows weakly"),  # a model without errors would tell it
        (0.5, 0.45, "does not show"),
    ],
)
def test_what_shows_by_readings_depends_on_what_a_fit_leaves(told, at_best, verdict):
    space = ParameterSpace([dynamics("kp", "actuator_gainprm", ("a",), nominal=1.0, unit="1")])
    one = np.ones(1)
    sensitivity = seen_alike(
        space,
        one,
        changed=1.2 * one,
        motion_std=told * one,
        motion_std_at_best=at_best * one,
        picture_std=np.inf * one,
        first_width=2.2 * one,
        correlation=np.zeros((1, 1)),
    )
    said = conclude_on_parameters(space, sensitivity)["parameters"]["kp"]
    assert said["verdict"] == verdict
    assert said["std_percent"] == pytest.approx(100 * told)
    assert said["std_percent_at_best"] == pytest.approx(100 * at_best)
    assert said["interval_share_at_best"] == pytest.approx(2 * 1.645 * at_best / 2.2)


def test_mass_of_a_slider_shows_where_its_gain_is_known(sliding):
    covariance, _ = motion_covariance(
        sliding.simulator, sliding.keypoints, sliding.episodes, np.array([0])
    )
    assert np.sqrt(covariance[0, 0]) < 0.02


def test_windows_that_there_is_no_time_for_are_assumed_to_tell_as_much(sliding, monkeypatch):
    given = sliding.simulator, sliding.keypoints, sliding.episodes, np.array([0])
    whole, all_of_it = motion_covariance(*given)
    monkeypatch.setattr(shooting, "_MOST_WORLDS_AT_ONCE", 1)
    one_by_one, share = motion_covariance(*given)
    np.testing.assert_allclose(one_by_one, whole, rtol=1e-6)
    few, its_share = motion_covariance(*given, Budget(1e-9))
    assert all_of_it == share == 1
    assert 0 < its_share < 1
    assert 0.2 < few[0, 0] / whole[0, 0] < 5


def test_delay_of_zero_is_analyzed_at_a_tenth_of_its_bound():
    space = ParameterSpace([slider().parameters["gain"], delay("lag", ("push",), 0.2)])
    scene = Scene(replace(slider(), parameters=space))
    lag = scene.conclude()["parameters"]["lag"]
    assert lag["value"] == pytest.approx(0.02)
    assert lag["changed_to"] == pytest.approx(0.04)
    assert lag["verdict"] == "shows weakly"
    assert lag["std"] < 0.04


@pytest.mark.thorough
def test_colours_are_less_sure_through_a_real_camera(swinging):
    arguments = (swinging.simulator, swinging.actions, 0)
    models = ObservationModel.of_simulator(), ObservationModel.of_reality()
    at_best, filmed = (analyze(*arguments, observation) for observation in models)
    arm = swinging.task.parameters.index("arm_g")
    assert filmed.picture_std[arm] > 3 * at_best.picture_std[arm]
    np.testing.assert_array_equal(filmed.motion_std, at_best.motion_std)


# --- numbers ------------------------------------------------------------------------------


def test_motion_changes_equal_a_plain_loop(swinging):
    space, model = swinging.task.parameters, swinging.task.load_model()
    changed = one_by_one(space, space.nominal)[[1]]
    rms, largest = motion_changes(
        swinging.simulator, swinging.keypoints, swinging.episodes, changed
    )
    data, arm = mujoco.MjData(model), model.geom("arm").id
    distances = []
    for start, actions in zip(*short_plays(swinging.episodes), strict=True):
        ends = []
        for damping in (0.2, 0.24):
            model.dof_damping[0] = damping
            mujoco.mj_setState(model, data, start, STATE)
            for action in actions:
                data.ctrl[:] = action
                mujoco.mj_step(model, data, swinging.simulator.num_substeps)
            mujoco.mj_forward(model, data)
            along = data.geom_xmat[arm].reshape(3, 3)[:, 2] * model.geom_size[arm, 1]
            points = data.geom_xpos[arm] + np.array([[0], [-1], [1]]) * along
            ends.append(FOCAL_PX / DEPTH_M * points[:, [0, 2]])
        distances.append(np.linalg.norm(ends[1] - ends[0], axis=-1))
    assert len(distances) == NUM_EPISODES * 48 // WINDOW_STEPS
    np.testing.assert_allclose(rms, np.sqrt(np.mean(np.square(distances))), rtol=1e-3)
    np.testing.assert_allclose(largest, np.max(distances), rtol=1e-3)


def test_picture_changes_equal_a_plain_loop(swinging):
    space, episodes = swinging.task.parameters, swinging.episodes
    changed = one_by_one(space, space.nominal)[[space.index("arm_g")]]
    levels, share = picture_changes(swinging.simulator, episodes, changed)
    rows = episodes.states.reshape(-1, episodes.states.shape[-1])
    rows = rows[np.linspace(0, len(rows) - 1, 24).astype(int)]
    changes, num_pixels = [], 0
    for row in rows:
        before, after = (
            swinging.simulator.render(row[None], p[None])[0].astype(int)
            for p in (space.nominal, changed[0])
        )
        most = np.abs(after - before).max(-1).ravel()
        changes += [change for change in most if change > 2]
        num_pixels += len(most)
    np.testing.assert_allclose(levels, np.mean(changes))
    np.testing.assert_allclose(share, len(changes) / num_pixels)


def test_motion_covariance_is_the_inverse_fisher_information(sliding):
    """x(t) = x0 + v0 t + s(t) / mass: all derivatives are known."""
    covariance, _ = motion_covariance(
        sliding.simulator, sliding.keypoints, sliding.episodes, np.array([0])
    )
    assert 0 < sliding.episodes.observed.min() < sliding.episodes.observed.max() < SIZE - 1
    times_s = np.arange(WINDOW_STEPS + 1) * sliding.simulator.step_s
    px_per_m = FOCAL_PX / DEPTH_M / 0.5  # in units of the detector's noise
    sure = 0.98
    all_of_it = 1.05 * sure + 0.003 * (1 - sure)  # with wide tails, and anywhere
    weight = (1 + 0.05 / 16) * sure / all_of_it
    states = sliding.episodes.states
    spread = 3 * (states[..., 1:3] - states[0, 0, 1:3]).reshape(-1, 2).std(0) / 3
    total = 0.0
    for episode in states:
        for start in range(0, 48, WINDOW_STEPS):
            x = episode[start : start + WINDOW_STEPS + 1, 1]
            pushed = x - x[0] - episode[start, 2] * times_s
            by_mass = -pushed * np.log(100)  # unit coordinate: a tenth to ten times nominal
            by_state = np.stack([np.ones_like(times_s), times_s], 1)
            count = weight * px_per_m**2 * 3  # the cart's centre and its two ends, all alike
            hessian = count * by_state.T @ by_state + np.diag(spread**-2.0)
            cross = count * by_state.T @ by_mass
            information = count * by_mass @ by_mass - cross @ np.linalg.solve(hessian, cross)
            total += information / (1 + 0.02**2 * information)
    np.testing.assert_allclose(covariance, [[1 / total]], rtol=0.03)


# --- recordings ---------------------------------------------------------------------------


def trajectories(step_s: float, lengths: tuple[int, ...], largest: float) -> list[Trajectory]:
    rng = np.random.default_rng(0)
    return [
        Trajectory(
            np.zeros((length + 1, 16, 16, 3), np.uint8),
            np.stack([rng.uniform(-largest, largest, length), np.full(length, 0.5)], 1).astype("f"),
            step_s,
        )
        for length in lengths
    ]


def warned(step_s: float, lengths: tuple[int, ...], largest: float, late_ms: float = 0) -> list:
    late = {"time_error_ms": {"largest": late_ms, "mean": late_ms / 2}}
    facts = {"control_hz": 1 / step_s, "cameras": [late], "names": ["one", "two", "three"]}
    actions = [t.actions for t in trajectories(step_s, lengths, largest)]
    return recording_warnings(pendulum(), facts, actions, 2)


def test_warnings():
    assert warned(0.08, (30, 30, 40), 1.0) == [
        "actions of idle are always 0.5: they excite nothing"
    ]
    facts = {"control_hz": 12.5, "cameras": [], "names": ["one"]}
    (still,) = recording_warnings(pendulum(), facts, [np.full((30, 2), 0.5)], 1)
    assert still.startswith("2 of 2 actions never change (")
    assert "idle" in still
    assert "cannot be told" in still
    rate, cut, beyond, constant = warned(0.1, (30, 40), 4.0)
    assert "replayed at 10 steps/s, the task has 12.5" in rate
    assert "--control-hz 12.5" in rate
    assert "30 to 40 steps" in cut
    assert "10 of 70 steps are not used" in cut
    assert "the shortest, one, and" in cut
    two = warned(0.08, (90, 30), 1.0)[0]
    assert "(--leave-out two), 30 more would be used" in two
    assert re.search(r"actions of turn go from -3\.\d+ to 3\.\d+, beyond .* -1 to 1", beyond)
    assert "idle" in constant
    assert warned(0.08, (30, 5), 1.0)[1].startswith("two has 5 steps: `simtune tune` needs at l")
    assert "up to 40 ms away from their steps of 80 ms" in warned(0.08, (30, 30), 1.0, 40)[0]


def test_actions_of_a_controller_within_the_robot_are_warned_of(tmp_path):
    path = tmp_path / "demos.hdf5"
    with h5py.File(path, "w") as file:
        kinds = {"env_kwargs": {"controller_configs": {"type": "OSC_POSITION"}}}
        file.create_group("data").attrs["env_args"] = json.dumps(kinds)
    facts = {"control_hz": 12.5, "cameras": [], "names": ["demo_0"], "folder": str(path)}
    deltas = np.random.default_rng(0).uniform(-1, 1, (30, 2))
    (said,) = recording_warnings(pendulum(), facts, [deltas], 1)
    assert said.startswith("actions may not be what actuators are sent: its env_args names the ")
    displacing = type("Displacing", (DirectActions,), {"is_relative": True})
    assert recording_warnings(replace(pendulum(), map_actions=displacing), facts, [deltas], 1) == []
    torques = recording_warnings(pendulum(), facts, [3 * deltas], 1)
    assert not any("env_args" in told for told in torques)


def test_no_rate_is_advised_against_one_that_was_chosen_or_that_frames_need():
    facts = {"control_hz": 10.0, "cameras": [{"time_error_ms": {"largest": 40}}]}
    actions = [np.eye(30, 2)]
    rate, late = recording_warnings(pendulum(), facts, actions, 1)
    assert rate == (
        "recordings are replayed at 10 steps/s, the task has 12.5; the simulator follows them"
    )
    assert "--control-hz" not in late  # frames are as dense as steps: a smaller one is no nearer
    assert "more frames a second" in late
    assert recording_warnings(pendulum(), facts | {"fps": 100.0}, actions, 1) == [late]
    film = {"time_error_ms": {"largest": 28, "mean": 10}, "frame_ms": 40.0}
    dense = {"control_hz": 50.0, "fps": 50.0, "cameras": [film]}
    *_, late = recording_warnings(pendulum(), dense, actions, 1)
    assert "Frames come every 40 ms (median), steps every 20 ms" in late
    assert late.endswith("take --control-hz 25 or less")
    fast = recording_warnings(
        pendulum(), facts | {"control_hz": 1 / (1 / 49), "fps": 49}, actions, 1
    )
    assert fast[0].endswith(
        "--control-hz 12.5 brings them to it. Was 49 Hz the real rate? A wrong one in the file "
        "makes all motion too fast or too slow"
    )


@pytest.mark.parametrize(
    ("changed", "is_said"),
    [
        ({}, True),
        ({"readings_hz": 20.0}, False),  # hardly more than steps
        ({"fps": 50.0}, False),  # the steps' rate was chosen
        ({"cameras": [{"time_error_ms": {"largest": 0}}]}, False),  # frames have a rate, too
    ],
)
def test_readings_between_steps_are_told_of(changed, is_said):
    facts = {"control_hz": 12.5, "fps": 12.5, "readings_hz": 31.25, "cameras": []} | changed
    said = recording_warnings(pendulum(), facts, [np.eye(30, 2)], 1)
    expected = [
        "readings come at 31.25 Hz, steps are 12.5 Hz: --control-hz 31.25 uses all of them "
        "(each step takes as long)"
    ]
    assert said == expected * is_said


def test_rows_that_a_log_lacks_are_warned_of_in_one_line():
    facts = {"control_hz": 12.5, "cameras": [], "gaps": {"swing1": [[2.9, 6.0]]}}
    (said,) = recording_warnings(pendulum(), facts, [np.eye(8, 2)], 1)
    assert said == (
        "swing1: no row between 2.9 and 6 s: the action before is held; was the log cut?"
    )
    facts["gaps"] |= {"swing2": [[1.0, 1.5], [3.0, 9.0]]}
    (said,) = recording_warnings(pendulum(), facts, [np.eye(8, 2)], 1)
    assert said.startswith("swing2: no row between 3 and 9 s, the longest of 3 gaps: the action")


def test_rows_without_a_frame_are_warned_of():
    facts = {"control_hz": 12.5, "cameras": [], "unfilmed": {"episode 3": 1}}
    (said,) = recording_warnings(pendulum(), facts, [np.eye(8, 2)], 1)
    assert said == "episode 3: its video has no frame for the last row: left out"


@pytest.mark.parametrize(("ends_s", "is_warned_of"), [(0.9, False), (1.5, False), (4.0, True)])
def test_a_video_that_goes_on_long_after_its_actions_may_have_another_clock(ends_s, is_warned_of):
    facts = {"control_hz": 12.5, "cameras": [], "unused_s": {"swing1": [ends_s, 8.0]}}
    said = recording_warnings(pendulum(), facts, [np.eye(8, 2)], 1)
    assert len(said) == is_warned_of
    if is_warned_of:
        assert said[0].startswith("swing1: the video goes on for 4 s after 8 s of actions")


# --- the command --------------------------------------------------------------------------


@pytest.fixture
def simtune(monkeypatch, capsys):
    """Runs `simtune ...` in this process: exit status, stdout, stderr."""
    monkeypatch.setitem(TASKS, "pendulum", pendulum)

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["simtune", *map(str, arguments)])
        status = 0
        try:
            cli.main()
        except SystemExit as exit_:
            status = int(exit_.code or 0)
        captured = capsys.readouterr()
        return status, captured.out, captured.err

    return run


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("recorded") / "dataset"
    write_dataset(
        folder,
        trajectories(0.1, (30, 36), 1.0),
        action_names=["turn", "idle"],
        robot_type="arm",
        task="swing",
    )
    return folder


def test_the_table(simtune):
    status, out, err = simtune("check", "pendulum", "--episodes", 2)
    assert status == 0
    said, *doing = err.splitlines()
    assert said == "pictures are 128 pixels high, not 64, since what moves has 2.3 pixels there"
    assert [line.split("%  ")[1] for line in doing] == [*CHANGING[:2], CHANGING[2].format(8)]
    lines = out.splitlines()
    assert lines[0].startswith("pendulum: 2 episodes of 48 steps of 0.08 s with random actions")
    assert (
        len(
            {
                line.index(name)
                for line in lines
                for name in ("  shows", "  does not")
                if name in line
            }
        )
        == 1
    )  # aligned
    (box,) = (line for line in lines if line.startswith("box_mass"))
    assert box.endswith("changes neither picture nor motion: it cannot be found from video")
    assert "visible" in next(line for line in lines if line.startswith("arm_r"))


def test_the_table_says_how_late_the_worst_camera_is():
    times = [{"largest": 31.5, "mean": 9.0}, {"largest": 0.0, "mean": 0.0}]
    cameras = [
        {"source_size": (48, 64), "codec": "h264", "key": f"c{i}", "time_error_ms": late}
        for i, late in enumerate(times)
    ]
    facts = dict.fromkeys(("folder", "kind", "episodes", "steps"), "") | {"dataset_hash": "b73f"}
    facts |= {"fps": 10.0, "control_hz": 10.0, "action_ranges": {}, "cameras": cameras}
    result = {"task": "t", "episodes": 1, "steps": 30, "step_s": 0.1, "recordings": facts}
    said = "\n".join(table(result | {"parameters": {}, "pairs": []}))
    assert "away from their steps by 31.5 ms at most, 9 ms on average" in said
    assert "b73f" not in said  # of interest to --json alone
    times[0]["largest"] = 0.0
    assert "away from" not in "\n".join(table(result | {"parameters": {}, "pairs": []}))


@pytest.mark.parametrize(
    ("value", "said"),
    [(0.0463, "0.046"), (9.9, "9.9"), (9.96, "10"), (99.8, "100"), (-140.2, "-140"), (0.0, "0")],
)
def test_numbers_have_two_digits_and_no_power_of_ten(value, said):
    assert two_digits(value) == said


def test_the_table_has_whole_numbers_from_ten_on():
    p = {"value": 1.0, "unit": "N", "changed_to": 1.2, "verdict": "shows clearly", "note": ""}
    p |= {"picture_levels": 4.0, "picture_share": 0.998}
    p |= {"motion_rms_px": 101.0, "motion_largest_px": 140.3}
    p |= {"reading": "lift", "reading_unit": "mm", "reading_rms": 120.0, "reading_largest": 250.0}
    result = {"task": "t", "episodes": 1, "steps": 1, "step_s": 0.1, "pairs": []}
    a, b = p | {"std_percent": 150.0}, p | {"std": 123.0}
    lines = table(result | {"parameters": {"a": a, "b": b}})
    assert lines[0] == "t: 1 episode of 1 step of 0.1 s with the recordings' actions"
    for name, std in (("a", "150 %"), ("b", "123 N")):
        (row,) = [line for line in lines if line.startswith(f"{name}  ")]
        numbers = ["100 %", "101 px", "140 px", "120 mm", "250 mm", "lift", std]
        assert re.split("  +", row)[4:-1] == numbers


def test_a_model_that_diverges_is_invalid_input(tmp_path):
    """Whose stiff spring no timestep of 20 ms endures."""
    stiff = PENDULUM.replace('name="hinge"', 'name="hinge" stiffness="5e8" springref="60"')
    (tmp_path / "scene.xml").write_text(stiff)
    (tmp_path / "tune.toml").write_text(
        'model = "scene.xml"\ncamera = "front"\ncontrol_timestep_s = 0.08\nepisode_steps = 15\n'
        "[[parameters]]\nname = 'mass'\nkind = 'mass'\nobjects = 'arm'\n"
    )
    config = CheckConfig(task=str(tmp_path / "tune.toml"), episodes=1)
    with pytest.raises(InputError, match=r"at least 21; .*diverged.*check the timestep"):
        check(config)


@pytest.mark.thorough
def test_recordings_in_json(simtune, recorded, tmp_path, monkeypatch, small_library):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    status, out, err = simtune("check", "pendulum", "--real", recorded, "--json")
    assert status == 0
    doing = [line.split("%  ")[1] for line in err.splitlines()]
    drawing = "comparing pictures: drawing worlds of the simulator"
    assert doing[:2] == ["reading the recordings", drawing]
    assert doing[-3:] == [*CHANGING[:2], CHANGING[2].format(6)]
    assert re.match(r" *\d+ s +0 %  reading", err)
    result = json.loads(out)
    assert (result["episodes"], result["steps"], result["step_s"]) == (2, 30, pytest.approx(0.1))
    assert result["recordings"]["episodes"] == 2
    assert len(result["recordings"]["dataset_hash"]) == 64
    *_, black, small = result["warnings"]
    assert len(result["warnings"]) == 5
    assert black.startswith("nothing moves in the film")
    assert small.startswith("what moves is small: the largest, arm, is")
    (picture,) = tmp_path.glob("simtune-check-*.png")
    assert [film["pictures"] for film in result["films"].values()] == [str(picture)]
    assert picture.stat().st_size > 10_000
    assert result["parameters"]["damping"]["verdict"].startswith("shows")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["check"], "TASK"),
        (["check", "pendulun"], "no task 'pendulun'"),
        (["check", "pendulum", "--episodes", 0], "--episodes must be at least 1, got 0"),
        (["check", "pendulum", "--seed", -1], "must not be negative"),
        (["check", "pendulum", "--camera", "front"], "--camera goes with recordings only"),
        (["check", "pendulum", "--real", "NOWHERE"], "no such folder"),
        (["check", "cartpole", "--real", "RECORDED"], "takes 1 actions, the recording has 2"),
        (["check", "pendulum", "--real", "RECORDED", "--camera", "front"], "no camera 'front'"),
        (["check", "pendulum", "--real", "RECORDED", "--episodes", 9], "it holds 2"),
    ],
)
def test_what_cannot_be_used(simtune, tmp_path, recorded, arguments, message):
    places = {"NOWHERE": tmp_path / "nowhere", "RECORDED": recorded}
    status, out, err = simtune(*(places.get(a, a) for a in arguments))
    assert (status, out) == (2, "")
    assert err.startswith("simtune: ")
    assert err.count("\n") == 1
    assert message in err


def test_a_run_expects_what_check_says_and_twice_the_episodes_tell_twice_as_much(swinging):
    actions = swinging.actions[0]
    still = np.zeros((len(actions) + 1, 1, 1, 3), np.uint8)
    four = [Trajectory(still, actions, 0.05)] * 4
    expected, seen = {}, ObservationModel.of_simulator()
    for real in (four, four * 2):
        expected[len(real)] = expected_precision(swinging.simulator, seen, real, 0).parameters
    said = swinging.conclude()["parameters"]
    assert set(expected[4]) == set(said)
    assert expected[4]["damping"]["verdict"] != "does not show"
    assert "std_percent" not in expected[4]["arm_r"]
    stds = [expected[num]["damping"]["std_percent"] for num in (4, 8)]
    assert stds[0] / stds[1] == pytest.approx(np.sqrt(2), rel=0.03)
    sensitivity = analyze(swinging.simulator, np.stack([actions] * 4), 0, seen)
    checked = conclude_on_parameters(swinging.task.parameters, sensitivity)
    assert expected[4]["damping"]["std_percent"] == pytest.approx(
        checked["parameters"]["damping"]["std_percent"]
    )


def test_episodes_that_are_too_short_to_tune_to_are_warned_of(tmp_path):
    (tmp_path / "scene.xml").write_text(PENDULUM)
    parameter = "[[parameters]]\nname = 'damping'\nkind = 'damping'\nobjects = 'hinge'\n"
    said = {}
    for steps in (20, 21):
        head = f"model = 'scene.xml'\ncontrol_timestep_s = 0.05\nepisode_steps = {steps}\n"
        (tmp_path / "tune.toml").write_text(head + parameter)
        config = CheckConfig(task=str(tmp_path / "tune.toml"), episodes=1)
        said[steps] = [line for line in check(config)["warnings"] if "at least" in line]
    assert said == {20: ["episodes have 20 steps, `simtune tune` needs at least 21"], 21: []}
