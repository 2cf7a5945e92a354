"""A slow swing shows its period late: windows grow, but only where that helps and fits."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from keypoint_evidence import observed_keypoints

from simtune.budget import Budget
from simtune.fit import Observed, Physics
from simtune.fit.motion.shooting import Shooting, ShootingFit
from simtune.fit.motion.shooting_config import ShootingConfig
from simtune.fit.motion.windows import even_length, not_longer
from simtune.observation import AllEvidence
from simtune.randomization import Distribution
from simtune.simulation import Simulator
from simtune.tasks import Task, load_task
from simtune.vision.keypoints import find_keypoints

PENDULUM = Path(__file__).parents[2] / "examples" / "phone_pendulum" / "tune.toml"
SPREAD = np.array([0.02, 0.2])  # of first guesses at angle and velocity
POOR_PX, STEPS, LENGTH = 4.0, 96, 0
OPEN = (LENGTH, 3, 8)  # length; how far away the camera is, and how much it sees
LONG = ShootingConfig(longer=(24, 96), longer_iterations=6)


@pytest.fixture(scope="module")
def pendulum() -> tuple[Task, Simulator]:
    task = load_task(str(PENDULUM))
    return task, task.simulator(image_size=64)


class Swings:
    """Four swings as seen with some noise, rough guesses at their states, and the true length."""

    def __init__(self, pendulum, seed: int, noise_px: float = POOR_PX, fitted=OPEN):
        task, simulator = pendulum
        self.space, rng = task.parameters, np.random.default_rng(seed)
        truth = self.space.nominal.copy()
        truth[LENGTH] *= 1.3
        self.length = truth[LENGTH]
        keypoints = find_keypoints(simulator, Distribution.first(self.space, truth), 0)
        rollouts = simulator.roll_out(
            np.repeat(truth[None], 4, 0), np.zeros((4, STEPS, 0)), rng, keypoints.observe
        )
        points = rollouts.observed + noise_px * rng.normal(size=rollouts.observed.shape)
        self.observed = observed_keypoints(points, rollouts.actions, noise_px)
        states = rollouts.states[..., 1:3]
        self.states = states + SPREAD * rng.normal(size=states.shape)
        physics = Physics(simulator, keypoints.observe, rollouts.states[0, 0])
        self.shooting = Shooting(physics, SPREAD, np.array(fitted), LONG)

    def fit(self) -> tuple[ShootingFit, ShootingFit]:
        """From the nominal parameters; with windows as they are, and with longer ones."""
        arguments = (self.observed, self.states, self.space.nominal)
        short = self.shooting.fit(*arguments)
        return short, self.shooting.extend_horizon(*arguments, short)

    def found_length(self, fit: ShootingFit) -> float:
        unit = self.space.to_unit(self.space.nominal)
        unit[self.shooting.fitted] = fit.unit
        return float(self.space.from_unit(unit)[LENGTH])


@pytest.mark.parametrize(
    ("num_steps", "planned", "length"),
    [(96, 24, 24), (60, 24, 20), (60, 48, 60), (200, 24, 25), (25, 24, 25), (40, 24, 20)],
)
def test_longer_windows_share_an_episode_evenly(num_steps, planned, length):
    assert even_length(num_steps, planned) == length
    assert num_steps % length == 0, "all of these are shared without a rest"


@pytest.mark.parametrize(
    ("num_steps", "usual", "length"),
    [(200, 12, 12), (60, 12, 12), (200, 50, 50), (95, 50, 47), (70, 50, 35), (40, 50, 40)],
)
def test_windows_leave_out_a_tenth_of_an_episode_at_most(num_steps, usual, length):
    assert not_longer(num_steps, usual) == length
    assert num_steps % length <= 0.1 * num_steps


@pytest.mark.thorough
def test_horizon_extends_for_a_slow_swing_and_recovers_its_length(pendulum):
    swings = Swings(pendulum, 0)
    short, long = swings.fit()
    assert short.full_states.shape[1] == 1 + 12
    assert long.full_states.shape[1] > 1 + 12
    assert long.covariance[0, 0] < short.covariance[0, 0] / 3
    assert abs(swings.found_length(long) / swings.length - 1) < 0.01


@pytest.mark.thorough
def test_horizon_stays_where_longer_windows_are_not_explained(pendulum):
    swings = Swings(pendulum, 1, noise_px=1.5)
    mixed = np.arange(STEPS + 1) // 12 % 2 == 1  # every other window shows another episode
    (tracks,) = swings.observed.evidence.parts
    candidates, states = tracks.candidates.copy(), swings.states.copy()
    candidates[:, mixed] = np.roll(candidates, 1, 0)[:, mixed]
    states[:, mixed] = np.roll(states, 1, 0)[:, mixed]
    evidence = AllEvidence((replace(tracks, candidates=candidates),))
    swings.observed, swings.states = Observed(evidence, swings.observed.actions), states
    short, long = swings.fit()
    assert np.sqrt(np.diag(short.covariance).max()) > 0.015, "longer windows could tell more"
    assert long is short


@pytest.mark.thorough
def test_horizon_stays_where_short_windows_tell_enough(pendulum):
    short, long = Swings(pendulum, 0, noise_px=0.05, fitted=(LENGTH,)).fit()
    assert np.sqrt(short.covariance[0, 0]) < 0.01
    assert long.full_states.shape[1] <= 1 + ShootingConfig().longer[0]  # which is always tried


def test_no_second_longer_windows_are_begun_that_would_not_end_in_time(pendulum, monkeypatch):
    swings, begun = Swings(pendulum, 0), []
    arguments = (swings.observed, swings.states, swings.space.nominal)
    short = swings.shooting.fit(*arguments)
    cut, now_s = Shooting._cut, [100.0]

    def cut_in_ten_seconds(self, observed, states, unit, steps=None):
        begun.append(steps)
        now_s[0] += 10
        return cut(self, observed, states, unit, steps)

    monkeypatch.setattr(Shooting, "_cut", cut_in_ten_seconds)
    monkeypatch.setattr("time.monotonic", lambda: now_s[0])
    # Nothing is known well enough
    monkeypatch.setattr("simtune.fit.motion.shooting._WELL_KNOWN_STD", 0.0)
    swings.shooting.extend_horizon(*arguments, short, budget=Budget(19))
    assert begun == [24]
    swings.shooting.extend_horizon(*arguments, short, budget=Budget(21))
    assert begun == [24, 24, 96]
