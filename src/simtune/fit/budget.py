"""How much of a fit can be afforded: physics that is slow gets fewer windows."""

import time
from dataclasses import replace

import numpy as np

from simtune.fit.shooting import ShootingConfig
from simtune.search_param_model.landmarks import Landmarks
from simtune.simulation import Simulator

_FEWEST_WINDOWS = 20
_TRIED_WORLDS = 64


def affordable(
    config: ShootingConfig,
    simulator: Simulator,
    landmarks: Landmarks,
    parameters: np.ndarray,
    seconds: float,
) -> ShootingConfig:
    """`config` with as many windows as can be fitted in about so many seconds."""
    step_s = _seconds_per_step(simulator, landmarks, parameters)
    # Each iteration plays every window once a state and parameter to derive by, and a few more.
    played = 3 + 2 * simulator.model.nv + len(simulator.space)
    window_s = step_s * played * sum(s.window * s.iterations for s in config.stages)
    num_windows = int(np.clip(seconds / window_s, _FEWEST_WINDOWS, config.num_windows))
    return replace(config, num_windows=num_windows)


def _seconds_per_step(
    simulator: Simulator, landmarks: Landmarks, parameters: np.ndarray, steps: int = 12
) -> float:
    """Of one world's policy step, among many at once."""
    rng = np.random.default_rng(0)
    worlds = np.repeat(parameters[None], _TRIED_WORLDS, 0)
    actions = np.zeros((_TRIED_WORLDS, steps, simulator.num_actions))
    simulator.roll_out(worlds, actions, rng)  # makes the worlds, which takes time once
    began_s = time.monotonic()
    simulator.roll_out(worlds, actions, rng, landmarks.record)
    return (time.monotonic() - began_s) / _TRIED_WORLDS / steps
