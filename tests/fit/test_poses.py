"""Which errors of poses a picture's fit allows for."""

import mujoco
import numpy as np
import pytest
from keypoint_evidence import tracks_at

from simtune.fit import Observed, Physics
from simtune.fit.motion.shooting import Shooting
from simtune.fit.motion.shooting_config import ShootingConfig, Stage
from simtune.fit.pictures.poses import align_to_images, uncertain_poses
from simtune.observation import AllEvidence
from simtune.randomization import Distribution
from simtune.simulation import StateSpace
from simtune.tasks import load_task
from simtune.vision.keypoints import find_keypoints

CARTPOLE = load_task("cartpole")
LARGEST = np.array([0.1, 0.1, 0.5, 0.5])  # m, rad, m/s, rad/s


@pytest.fixture(scope="module")
def simulator():
    return CARTPOLE.simulator(image_size=48)


@pytest.fixture(scope="module")
def keypoints(simulator):
    return find_keypoints(
        simulator, Distribution.first(simulator.space, simulator.space.nominal), 0
    )


def poses_with(simulator, keypoints, joints: list[int], noise: float) -> np.ndarray:
    """(M, D, 4) where these of cart and pole are read, and keypoints have noise of .3 pixels."""
    nominal, rng = simulator.space.nominal, np.random.default_rng(0)
    rollouts = simulator.roll_out(nominal[None], np.zeros((1, 20, 1)), rng)
    states = rollouts.states[0]

    def see(batch) -> np.ndarray:
        return np.hstack([keypoints.observe(batch), batch.qpos[:, joints]])

    num_shown = 2 * len(keypoints)
    scale = np.repeat([0.3, noise], [num_shown, len(joints)])
    physics = Physics(simulator, see, states[0])
    return uncertain_poses(physics, states, nominal, scale, num_shown, LARGEST)


def test_joints_that_are_read_closely_leave_nothing_open(simulator, keypoints):
    assert poses_with(simulator, keypoints, [0, 1], 1e-4).shape == (21, 0, 4)
    only_cart = poses_with(simulator, keypoints, [1], 1e-4)
    assert only_cart.shape == (21, 1, 4)
    assert (only_cart[..., 0] > 0).all()
    assert not only_cart[..., 1:].any()


def test_rough_readings_leave_open_what_keypoints_do(simulator, keypoints):
    rough, unread = (
        poses_with(simulator, keypoints, [0, 1], 100.0),
        poses_with(simulator, keypoints, [], 1.0),
    )
    assert unread.shape == rough.shape == (21, 2, 4)
    np.testing.assert_allclose(rough, unread, rtol=1e-3)
    # One standard deviation changes what is seen by one of the noise, unless more is known.
    assert (rough.max((0, 1))[:2] <= LARGEST[:2]).all()


@pytest.mark.parametrize("off_m", [0.1, 2.0])
def test_a_floor_tells_where_a_robot_is_that_its_camera_follows(off_m):
    """Chequers repeat, and the floor's colour is still wrong."""
    walker, rng = load_task("walker").simulator(image_size=48), np.random.default_rng(0)
    worlds, space = np.repeat(walker.space.nominal[None], 12, 0), walker.state_space
    states = walker.begin(worlds, rng).states[:, 0]
    x, along = walker.model.joint("rootx"), np.zeros(space.num_tangent)
    true = space.positions_and_velocities(states).copy()
    true[:, x.qposadr[0]] = rng.uniform(-5, 5, 12)
    guess = true.copy()
    guess[:, x.qposadr[0]] += rng.normal(0, off_m, 12)
    states = [space.with_positions_and_velocities(states, some) for some in (true, guess)]
    frames = walker.render(states[0], worlds)
    dark = walker.space.nominal.copy()
    dark[[name.startswith("ground") for name in walker.space.names]] *= 0.6
    along[x.dofadr[0]] = 5 * off_m
    found, left = align_to_images(walker.render, frames, states[1], dark, space, along)

    def off(some: np.ndarray) -> np.ndarray:
        return np.abs(walker.render(some, worlds).astype(float) - frames).mean((1, 2, 3))

    # Some look alike in places so far apart: the floor repeats, and its brightness is open.
    assert np.quantile(off(found), 2 / 3) < 0.1 * np.median(off(states[1]))
    assert 0.01 < left[x.dofadr[0]] < 0.15
    others = np.arange(space.nq + space.nv) != x.qposadr[0]
    changed = space.positions_and_velocities(found)
    np.testing.assert_array_equal(changed[:, others], guess[:, others])


@pytest.mark.parametrize("off_m", [1.2, 1.206, 1.21])
def test_a_floor_that_repeats_where_places_are_tried_is_searched_as_closely(off_m):
    """Squares of a quarter of a metre: a twelfth of the range searched is about one period."""
    body = "<body><joint type='slide'/><geom size='.1'/></body>"
    xml, rng = f"<mujoco><worldbody>{body}</worldbody></mujoco>", np.random.default_rng(0)
    model = mujoco.MjModel.from_xml_string(xml)
    space = StateSpace(model)
    pixels, size = np.linspace(-1, 1, 96), mujoco.mjtState.mjSTATE_INTEGRATION
    full = np.zeros((12, mujoco.mj_stateSize(model, size)))

    def render(full_states: np.ndarray, contrast: np.ndarray) -> np.ndarray:
        x = space.positions_and_velocities(full_states)[:, :1]
        edge = np.sin(2 * np.pi * (pixels + x) / 0.5)
        level = 120 + contrast * np.tanh(8 * edge)
        return np.repeat(level[:, None, :, None], 3, 3).astype(np.uint8)

    true = rng.uniform(-1, 1, (12, 1)) * [1.0, 0.0]
    frames = render(space.with_positions_and_velocities(full, true), np.full((12, 1), 80.0))
    guess = true + rng.normal(0, off_m, (12, 1)) * [1.0, 0.0]
    states = space.with_positions_and_velocities(full, guess)
    tangent = np.array([5 * off_m, 0.0])
    found, left = align_to_images(render, frames, states, np.array([40.0]), space, tangent)
    away = space.positions_and_velocities(found)[:, 0] - true[:, 0]
    assert np.abs(away / 0.5 - np.round(away / 0.5)).max() < 0.1
    assert left[0] < 0.2


def test_a_fit_says_what_neither_motion_nor_sensors_tell(simulator):
    """Only the pole is seen: its swing tells nothing of where the cart is."""
    nominal, rng = simulator.space.nominal, np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (2, 24, 1))
    rollouts = simulator.roll_out(np.repeat(nominal[None], 2, 0), actions, rng)
    physics = Physics(simulator, see_pole, rollouts.states[0, 0])
    states = physics.states(rollouts.states)
    pixels = np.stack([16 * states[..., 1] + 24, np.full(states.shape[:2], 24.0)], -1)
    observed = Observed(AllEvidence((tracks_at(pixels[:, :, None], 0.3, 48),)), actions)
    prior, config = np.full(4, 0.1), ShootingConfig(stages=(Stage(12, 2),))
    fit = Shooting(physics, prior, np.array([0]), config).fit(observed, states, nominal)
    assert fit.state_std[0] > 10 * prior[0]
    assert (fit.state_std[[1, 3]] < prior[[1, 3]]).all()


def see_pole(batch) -> np.ndarray:
    """(n, 2) pixels that move with its angle."""
    return np.stack([16 * batch.qpos[:, 1] + 24, np.full(len(batch.qpos), 24.0)], -1)
