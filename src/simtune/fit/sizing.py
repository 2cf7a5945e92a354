"""How large a fit can be: physics that is slow gets fewer particles and windows."""

import time
from dataclasses import dataclass, field, replace

import numpy as np

from simtune.fit.particles import ParticleConfig
from simtune.fit.physics import Physics
from simtune.fit.shooting import ShootingConfig

_PARTICLES_SHARE = 0.6  # of the time; the rest is for windows
_SIDES = 2  # from which windows are fitted
_FEWEST_PARTICLES, _FEWEST_WINDOWS = 32, 20
_TRIED_WORLDS, _TRIED_STEPS = 64, 12


@dataclass(frozen=True, kw_only=True)
class FitConfig:
    particles: ParticleConfig = field(default_factory=ParticleConfig)
    shooting: ShootingConfig = field(default_factory=ShootingConfig)


def fit_to_budget(
    config: FitConfig, physics: Physics, parameters: np.ndarray, num_steps: int, seconds: float
) -> FitConfig:
    """With as many particles and windows as `seconds` allow, for episodes of `num_steps` in all."""
    step_s, begun_step_s = _seconds_per_step(physics, parameters)
    each_s = begun_step_s * num_steps / config.particles.steps
    num = int(np.clip(_PARTICLES_SHARE * seconds / each_s, _FEWEST_PARTICLES, config.particles.num))
    # Each iteration plays every window once for all it is derived by, and a few more.
    num_fitted = int((~physics.parameters.is_appearance).sum())
    played = 3 + physics.space.num_tangent + num_fitted
    window_s = step_s * played * config.shooting.steps_per_window * _SIDES
    windows = (1 - _PARTICLES_SHARE) * seconds / window_s
    num_windows = int(np.clip(windows, _FEWEST_WINDOWS, config.shooting.num_windows))
    return FitConfig(
        particles=replace(config.particles, num=num),
        shooting=replace(config.shooting, num_windows=num_windows),
    )


def _seconds_per_step(physics: Physics, parameters: np.ndarray) -> tuple[float, float]:
    """Of one world's policy step, among many at once: of several in a row, and of a single one."""
    units = np.repeat(physics.parameters.to_unit(parameters)[None], _TRIED_WORLDS, 0)
    starts = np.repeat(physics.some_state[None], _TRIED_WORLDS, 0)
    still = np.zeros((_TRIED_WORLDS, _TRIED_STEPS, physics.simulator.num_actions))
    full_states, _ = physics.play(starts, units, still)
    starts, seconds = physics.states(full_states[:, -1]), []
    for count in (_TRIED_STEPS, 1):
        began_s = time.monotonic()
        physics.play(starts, units, still[:, :count])
        seconds.append((time.monotonic() - began_s) / _TRIED_WORLDS / count)
    return seconds[0], seconds[1]
