"""A slow swing shows its period late: windows grow, but only where that helps and fits."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from simtune.fit.tracks import Tracks

from simtune.fit.physics import Physics
from simtune.fit.shooting import Shooting, ShootingConfig, ShootingFit
from simtune.randomization import Distribution
from simtune.simulation import Simulator
from simtune.tasks import Task, load_task
from simtune.vision.keypoints import find_keypoints

PENDULUM = Path(__file__).parents[1] / "examples" / "phone_pendulum" / "tune.toml"
SPREAD = np.array([0.02, 0.2])  # of first guesses at angle and velocity
POOR_PX, STEPS = 4.0, 96
OPEN = np.array([0, 3, 8])  # length; how far away the camera is, and how much it sees
SHORT = ShootingConfig(longer=())
LONG = ShootingConfig(longer=(24, 96), longer_iterations=6)


@pytest.fixture(scope="module")
def pendulum() -> tuple[Task, Simulator]:
    task = load_task(str(PENDULUM))
    return task, task.simulator(image_size=64)


def swings(
    pendulum, seed: int, noise_px: float = POOR_PX
) -> tuple[Shooting, Tracks, np.ndarray, float]:
    """How it was seen to swing four times, rough guesses at the states, and the true length."""
    task, simulator = pendulum
    space, rng = task.parameters, np.random.default_rng(seed)
    truth = space.nominal.copy()
    truth[0] *= 1.3
    keypoints = find_keypoints(simulator, task.camera, Distribution.first(space, truth), 0)
    rollouts = simulator.roll_out(
        np.repeat(truth[None], 4, 0), np.zeros((4, STEPS, 0)), rng, keypoints.observe
    )
    true = rollouts.observed.reshape(4, STEPS + 1, 1, -1, 2)
    places = np.repeat(true + noise_px * rng.normal(size=true.shape), 2, 2)
    probability = np.zeros(places.shape[:-1])
    probability[:, :, 0] = 0.98
    states = rollouts.states[..., 1:3]
    rough = states + SPREAD * rng.normal(size=states.shape)
    physics = Physics(simulator, keypoints, rollouts.states[0, 0])
    noise = np.full(len(keypoints), noise_px)
    shooting = Shooting(physics, noise, SPREAD, OPEN, LONG)
    return shooting, Tracks(places, probability, rollouts.actions.astype(float)), rough, truth[0]


def fit(pendulum, shooting: Shooting, tracks, rough, config=None) -> tuple[ShootingFit, float]:
    """The fit from the nominal parameters, and the length it found, m."""
    space = pendulum[0].parameters
    shooting.config = config or shooting.config
    found = shooting.fit(tracks, rough, space.nominal)
    found = shooting.grow(tracks, rough, space.nominal, found)
    unit = space.to_unit(space.nominal)
    unit[OPEN] = found.unit
    return found, float(space.from_unit(unit)[0])


def test_a_slow_swing_is_followed_for_longer(pendulum):
    shooting, tracks, rough, truth = swings(pendulum, 0)
    short, _ = fit(pendulum, shooting, tracks, rough, SHORT)
    long, length = fit(pendulum, shooting, tracks, rough, LONG)
    assert short.rows.shape[1] == 1 + 12
    assert long.rows.shape[1] > 1 + 12
    assert long.covariance[0, 0] < short.covariance[0, 0] / 4
    assert abs(length / truth - 1) < 0.01


def test_what_does_not_hang_together_is_not_followed_for_longer(pendulum, monkeypatch):
    monkeypatch.setattr("simtune.fit.shooting._ENOUGH", 0.0)
    shooting, tracks, rough, _ = swings(pendulum, 1, noise_px=1.0)
    cut = np.arange(STEPS + 1) // 12 % 2 == 1  # every other window shows another episode
    places, states = tracks.places.copy(), rough.copy()
    places[:, cut], states[:, cut] = np.roll(places, 1, 0)[:, cut], np.roll(states, 1, 0)[:, cut]
    found, _ = fit(pendulum, shooting, replace(tracks, places=places), states)
    assert found.rows.shape[1] == 1 + 12


def test_where_short_windows_tell_enough_they_stay_short(pendulum, monkeypatch):
    shooting, tracks, rough, _ = swings(pendulum, 0)
    monkeypatch.setattr("simtune.fit.shooting._ENOUGH", np.inf)
    found, _ = fit(pendulum, shooting, tracks, rough)
    assert found.rows.shape[1] == 1 + 12
