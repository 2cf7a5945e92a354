"""Film with readings: where some are missing or late, a fit and its known worlds know as little."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import mujoco
import numpy as np
import pytest
from search_context import SPACE, STEPS
from test_bootstrap import a_fit

from simtune.fit import READINGS, Observed, StateEstimator, states_in_late_pictures
from simtune.networks.training import TrainingClock
from simtune.observation import AllEvidence, JointReadings, JointSensor, ObservationModel
from simtune.search_param_model.simulated import FilmedWorlds
from simtune.simulation import StateSpace, random_actions
from simtune.tasks import load_task
from simtune.trajectory import Trajectory
from simtune.tuning.known_worlds import KnownWorlds
from simtune.tuning.observing import _with_gaps

SLIDE = """<mujoco><worldbody><body><joint type="slide"/><geom size=".1" mass="1"/></body>
</worldbody></mujoco>"""
SENSOR = JointSensor(
    name="encoders",
    columns=("slider",),
    joints=("slider",),
    places=np.array([0]),
    factor=np.ones(1),
    shift=np.zeros(1),
    noise=1e-9,
    offset=np.zeros(1),
)


def read(values: np.ndarray) -> AllEvidence:
    return AllEvidence((JointReadings("encoders", "m", values, 0.001, np.zeros(1), np.ones(1)),))


@pytest.mark.thorough
def test_a_state_is_guessed_where_every_fourth_row_is_read(monkeypatch):
    """As the mean, a missing reading would be off by about 1; without one, by what it learnt."""
    for name, small in (("_CHANNELS", 16), ("_CROP", 24), ("_BATCH", 16)):
        monkeypatch.setattr(f"simtune.fit.motion.estimator.{name}", small)
    rng, frames = np.random.default_rng(0), np.arange(41)
    swing = np.sin(0.15 * frames + rng.uniform(0, 6, (40, 1)))[..., None]
    states = np.concatenate([swing, np.gradient(swing, axis=1)], -1)
    gappy = np.where(frames[:, None] % 4 == 0, swing, np.nan)
    gappy[:, -4:] = np.nan  # what a latency leaves
    space, idle = StateSpace(mujoco.MjModel.from_xml_string(SLIDE)), np.zeros((40, 40, 1))
    observed = Observed(read(gappy), idle)
    estimator = StateEstimator.train(observed, states, space, np.ones(1), 0, TrainingClock(100))
    off = estimator(observed)[32:, :, 0] - states[32:, :, 0]
    assert np.sqrt(np.square(off[:, :-4]).mean()) < 0.15
    assert np.sqrt(np.square(off[:, -4:]).mean()) < 0.3
    assert np.median(np.abs(off)) < 2 * estimator.prior_std[0] < 0.2
    # Never read at all is no reason to fail
    assert np.isfinite(estimator(Observed(read(np.full_like(gappy, np.nan)), idle))).all()


def test_held_out_worlds_lack_the_readings_that_real_episodes_lack():
    real = [
        Trajectory(
            np.zeros((7, 1, 1, 3), np.uint8), np.zeros((6, 1), np.float32), 0.1, {"encoders": its}
        )
        for its in (np.arange(7.0)[:, None], np.where(np.arange(7) > 4, np.nan, 1.0)[:, None])
    ]
    begins, none = np.array([0, 1, 3, 3]), np.zeros(0)
    worlds = FilmedWorlds(
        none, none, none, np.zeros((4, 4, 1, 1, 3)), begins, none, {"encoders": np.ones((4, 4, 1))}
    )
    found = _with_gaps(worlds, real)["encoders"][..., 0]
    expected = [[1, 1, 1, 1], [1, 1, 1, 1], [1, 1, 1, 1], [1, 1, np.nan, np.nan]]
    np.testing.assert_array_equal(found, expected)


class Blind:
    """A detector that sees nothing."""

    def detect(self, frames: np.ndarray) -> None:
        return None


class AsRecorded:
    """Lets a fit see the readings alone."""

    def __init__(self, context):
        self.context = context

    def observed(self, trajectories, detections) -> Observed:
        values = np.stack([t.readings["encoders"] for t in trajectories])
        return Observed(read(values), np.zeros((len(values), STEPS, 1)))


@pytest.mark.parametrize("late_steps", [0.0, 0.5, -0.3])
def test_readings_of_known_worlds_are_late_and_missing_as_the_real_ones_are(late_steps):
    simulator, rng = load_task("cartpole").simulator(image_size=16), np.random.default_rng(0)
    observation = ObservationModel.of_simulator((SENSOR,), films=())
    context = SimpleNamespace(simulator=simulator, observation=observation)
    actions = 0.1 * random_actions(2, STEPS, simulator.action_mapping, rng)  # not up to the rail
    values = np.zeros((2, STEPS + 1, 1))
    values[0, 3:6] = values[1, -1] = np.nan
    like, worlds = Observed(read(values), actions), np.repeat(SPACE.nominal[None], 2, 0)
    begun = simulator.begin(worlds, rng)
    fit = replace(
        a_fit(),
        starts=begun.states[:, 0],
        late_s={READINGS: (late_steps * simulator.step_s, 0.001)},
    )
    known = KnownWorlds(cast(Any, AsRecorded(context)), cast(Any, Blind()), like, fit, rng)
    made = known.synthesize(SPACE.nominal, 0)
    assert made is not None
    (part,) = made.evidence.parts
    assert isinstance(part, JointReadings)
    np.testing.assert_array_equal(np.isnan(part.values), np.isnan(values))
    played = simulator.roll_out(worlds, actions, rng, starts=fit.starts).states
    late, places = states_in_late_pictures(simulator, played, late_steps), simulator.state_space
    wrong, right = (
        np.nanmax(np.abs(part.values - places.positions_and_velocities(states)[..., :1]))
        for states in (played, late)
    )
    assert right < 1e-6 or right < 0.05 * wrong
