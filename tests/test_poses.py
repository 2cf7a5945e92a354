"""Which errors of poses a picture's fit allows for."""

import numpy as np
import pytest

from simtune.fit import Physics
from simtune.fit.poses import align_to_images, uncertain_poses
from simtune.randomization import Distribution
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
    found, left = align_to_images(walker, frames, states[1], dark, space, along)

    def off(some: np.ndarray) -> np.ndarray:
        return np.abs(walker.render(some, worlds).astype(float) - frames).mean((1, 2, 3))

    # Some look alike in places so far apart: the floor repeats, and its brightness is open.
    assert np.quantile(off(found), 2 / 3) < 0.1 * np.median(off(states[1]))
    assert 0.01 < left[x.dofadr[0]] < 0.15
    others = np.arange(space.nq + space.nv) != x.qposadr[0]
    changed = space.positions_and_velocities(found)
    np.testing.assert_array_equal(changed[:, others], guess[:, others])
