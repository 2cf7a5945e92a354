"""How much of a fit can be afforded: physics that is slow gets fewer particles and windows."""

import time
from dataclasses import replace

import numpy as np

from simtune.fit.particles import ParticleConfig
from simtune.fit.shooting import ShootingConfig
from simtune.simulation import Simulator
from simtune.vision.keypoints import Keypoints

_PARTICLES_SHARE = 0.6  # of the time; the rest is for windows
_SIDES = 2  # from which windows are fitted
_FEWEST_PARTICLES, _FEWEST_WINDOWS = 32, 20
_TRIED_WORLDS = 64


def fit_to_budget(
    particles: ParticleConfig,
    shooting: ShootingConfig,
    simulator: Simulator,
    keypoints: Keypoints,
    parameters: np.ndarray,
    num_steps: int,
    seconds: float,
) -> tuple[ParticleConfig, ShootingConfig]:
    """Both with as many as so many seconds allow, for episodes of `num_steps` in all."""
    step_s, begun_step_s = _seconds_per_step(simulator, keypoints, parameters)
    each_s = begun_step_s * num_steps / particles.steps
    num = int(np.clip(_PARTICLES_SHARE * seconds / each_s, _FEWEST_PARTICLES, particles.num))
    # Each iteration plays every window once for all it is derived by, and a few more.
    played = 3 + 2 * simulator.model.nv + int((~simulator.space.is_appearance).sum())
    window_s = step_s * played * shooting.steps_per_window * _SIDES
    windows = (1 - _PARTICLES_SHARE) * seconds / window_s
    num_windows = int(np.clip(windows, _FEWEST_WINDOWS, shooting.num_windows))
    return replace(particles, num=num), replace(shooting, num_windows=num_windows)


def _seconds_per_step(
    simulator: Simulator, keypoints: Keypoints, parameters: np.ndarray, steps: int = 12
) -> tuple[float, float]:
    """Of one world's policy step, among many at once: of several in a row, and of a single one."""
    rng = np.random.default_rng(0)
    worlds = np.repeat(parameters[None], _TRIED_WORLDS, 0)
    still = np.zeros((_TRIED_WORLDS, steps, simulator.num_actions))
    starts = simulator.roll_out(worlds, still, rng, keep_diverged=True).states[:, -1]
    seconds = []
    for count in (steps, 1):
        began_s = time.monotonic()
        simulator.roll_out(
            worlds, still[:, :count], rng, keypoints.record, starts, keep_diverged=True
        )
        seconds.append((time.monotonic() - began_s) / _TRIED_WORLDS / count)
    return seconds[0], seconds[1]
