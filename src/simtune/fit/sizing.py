"""How large a fit can be: physics that is slow gets fewer particles and windows."""

import time
from dataclasses import dataclass, field, replace

import numpy as np

from simtune.fit.particles import ParticleConfig
from simtune.fit.physics import Physics
from simtune.fit.shooting_config import ShootingConfig

_SIDES = 2  # from which windows are fitted
_FEWEST_PARTICLES, _FEWEST_WINDOWS = 32, 20
_LEAST_PARTICLES, _LEAST_WINDOWS = 16, 12  # where even those take too long
# Times what particles and windows take: latencies and offsets that are looked for, and the episode
# that was kept back.
_IN_ALL = 2.0
_TRIED_WORLDS, _TRIED_STEPS = 64, 12


@dataclass(frozen=True, kw_only=True)
class FitConfig:
    particles: ParticleConfig = field(default_factory=ParticleConfig)
    shooting: ShootingConfig = field(default_factory=ShootingConfig)
    held: tuple[int, ...] = ()  # parameters that are left where a fit starts, as sure as that says

    def scaled(self, share: float) -> "FitConfig":
        """With that share of the particles and windows, but never fewer than tell enough."""
        num = max(_FEWEST_PARTICLES, int(share * self.particles.num))
        return self._at_most(num, max(_FEWEST_WINDOWS, int(share * self.shooting.num_windows)))

    def least(self) -> "FitConfig":
        """With as few as tell anything, and no longer windows."""
        config = self._at_most(_LEAST_PARTICLES, _LEAST_WINDOWS)
        return replace(config, shooting=replace(config.shooting, longer=()))

    def _at_most(self, num_particles: int, num_windows: int) -> "FitConfig":
        particles, shooting = self.particles, self.shooting
        return replace(
            self,
            particles=replace(particles, num=min(num_particles, particles.num)),
            shooting=replace(shooting, num_windows=min(num_windows, shooting.num_windows)),
        )


def count_fit_steps(
    config: FitConfig, num_steps: int, num_tangent: int, num_fitted: int
) -> tuple[int, int]:
    """Policy steps that particles and windows play, for episodes of `num_steps` in all."""
    shooting = config.shooting
    windows = min(shooting.num_windows, -(-num_steps // shooting.stages[-1].window))
    num_derived = 1 + num_tangent + 2 * num_fitted
    each = _SIDES * shooting.steps_per_window(num_derived) + shooting.steps_of_longer(num_derived)
    return num_steps * config.particles.num, windows * each


def fit_to_budget(
    config: FitConfig,
    physics: Physics,
    parameters: np.ndarray,
    num_steps: int,
    seconds: float,
    at_most_s: float = np.inf,
) -> FitConfig:
    """With as many particles and windows as `seconds` allow, for episodes of `num_steps` in all.

    With as few as tell enough it may take longer; but not longer than `at_most_s`, if the least
    one does not.
    """
    if not np.isfinite(seconds):
        return config
    step_s, begun_step_s = _seconds_per_step(physics, parameters)
    num_fitted = int((~physics.parameters.is_appearance).sum())
    unknown = physics.space.num_tangent, num_fitted

    def needed_s(its: FitConfig) -> float:
        of_particles, of_windows = count_fit_steps(its, num_steps, *unknown)
        return begun_step_s / its.particles.steps * of_particles + step_s * of_windows

    scaled = config.scaled(min(1.0, seconds / needed_s(config)))
    return scaled if _IN_ALL * needed_s(scaled) <= at_most_s else config.least()


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
