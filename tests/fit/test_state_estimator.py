"""First guesses at states, by a network."""

import mujoco
import numpy as np
from keypoint_evidence import tracks_at

from simtune.fit import Observed, StateEstimator
from simtune.networks.training import TrainingClock
from simtune.observation import AllEvidence
from simtune.simulation import StateSpace

BALL = """
<mujoco><worldbody><body><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
<geom size=".1" mass="1"/></body></worldbody></mujoco>
"""
EPISODES, STEPS, SIZE = 60, 40, 64


def test_an_object_that_is_flung_away_once_does_not_blur_all_other_states(monkeypatch):
    """Its place differs by centimetres in all episodes but two; there it is kilometres off."""
    for name, small in (("_CHANNELS", 24), ("_CROP", 16), ("_BATCH", 24)):
        monkeypatch.setattr(f"simtune.fit.motion.estimator.{name}", small)
    rng, space = np.random.default_rng(0), StateSpace(mujoco.MjModel.from_xml_string(BALL))
    states = np.zeros((EPISODES, STEPS + 1, 4))
    states[..., 0] = rng.uniform(-0.3, 0.3, (EPISODES, 1))
    states[..., 1] = rng.uniform(-0.03, 0.03, (EPISODES, 1))
    errors = []
    for flung in (0.0, 1e3):
        states[3:5, -4:, 1] = flung
        pixels = np.clip(100 * states[..., :2] + SIZE / 2, 1, SIZE - 2)
        tracks = tracks_at(pixels, 0.2, SIZE)
        observed = Observed(AllEvidence((tracks,)), np.zeros((EPISODES, STEPS, 1)))
        clock = TrainingClock(100)
        estimator = StateEstimator.train(observed, states, space, np.ones(1), 0, clock)
        off = space.difference(estimator(observed), states)
        errors.append(float(np.median(np.abs(off[10:, :, 1]))))
        assert estimator.prior_std[1] < 0.01
    assert errors[1] < 2 * errors[0] < 0.01
