"""Sizes a fit: slow physics gets fewer particles and windows."""

import time
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from simtune.fit.particles import ParticleConfig
from simtune.fit.physics import Physics
from simtune.fit.shooting_config import ShootingConfig

_SIDES = 2  # of the start, from which windows are fitted
_FEWEST_PARTICLES, _FEWEST_WINDOWS = 32, 20
_LEAST_PARTICLES, _LEAST_WINDOWS, _LEAST_PICTURES = 16, 12, 20  # if even those take too long
# Factor on the time of particles and windows, for latencies, offsets and the held-out episode.
_IN_ALL = 2.0
_WITH_LONGER = 0.8  # of the most that a fit may take: two refits that take as long have time, too
_TRIED_WORLDS, _TRIED_STEPS = 64, 12


class FitWork(NamedTuple):
    """What the time of a fit depends on, besides its configuration."""

    num_steps: int  # of all episodes
    num_unknown: int  # numbers of a state that are not known
    num_fitted: int  # parameters


@dataclass(frozen=True, kw_only=True)
class FitConfig:
    particles: ParticleConfig = field(default_factory=ParticleConfig)
    shooting: ShootingConfig = field(default_factory=ShootingConfig)
    num_pictures: int = 40  # in which colours are fitted, at most
    # Seconds after a fit's beginning, by which longer windows must end, the first ones excepted
    longer_within_s: float = np.inf
    held: tuple[int, ...] = ()  # parameters that keep their start and its std

    def scaled(self, share: float) -> "FitConfig":
        """With this share of the particles and windows, but never fewer than tell enough."""
        num = max(_FEWEST_PARTICLES, int(share * self.particles.num))
        return self._at_most(num, max(_FEWEST_WINDOWS, int(share * self.shooting.num_windows)))

    def least(self) -> "FitConfig":
        """With the fewest that tell anything, and no longer windows."""
        config = self._at_most(_LEAST_PARTICLES, _LEAST_WINDOWS)
        num_pictures = min(_LEAST_PICTURES, self.num_pictures)
        shooting = replace(config.shooting, longer=())
        return replace(config, shooting=shooting, num_pictures=num_pictures)

    def _at_most(self, num_particles: int, num_windows: int) -> "FitConfig":
        particles, shooting = self.particles, self.shooting
        return replace(
            self,
            particles=replace(particles, num=min(num_particles, particles.num)),
            shooting=replace(shooting, num_windows=min(num_windows, shooting.num_windows)),
        )


def count_fit_steps(config: FitConfig, work: FitWork) -> tuple[int, int]:
    """Policy steps that particles and windows play."""
    shooting = config.shooting
    windows = min(shooting.num_windows, -(-work.num_steps // shooting.stages[-1].window))
    num_derived = 1 + work.num_unknown + 2 * work.num_fitted
    played = _SIDES * shooting.steps_per_window(num_derived) + shooting.steps_of_longer(num_derived)
    return work.num_steps * config.particles.num, windows * played


def fit_to_budget(
    config: FitConfig,
    physics: Physics,
    parameters: np.ndarray,
    work: FitWork,
    seconds: float,
    at_most_s: float = np.inf,
) -> FitConfig:
    """With as many particles and windows as `seconds` allow.

    With the fewest that tell enough it may take longer. If that exceeds `at_most_s`, the least
    configuration is taken. Longer windows must end within a share of `at_most_s`: where little is
    told, all lengths are tried, and no time would be left for refits.
    """
    if not np.isfinite(seconds):
        return config
    step_s, begun_step_s = _seconds_per_step(physics, parameters)

    def needed_s(sized: FitConfig) -> float:
        of_particles, of_windows = count_fit_steps(sized, work)
        return begun_step_s / sized.particles.steps * of_particles + step_s * of_windows

    config = replace(config, longer_within_s=_WITH_LONGER * at_most_s)
    scaled = config.scaled(min(1.0, seconds / needed_s(config)))
    return scaled if _IN_ALL * needed_s(scaled) <= at_most_s else config.least()


def _seconds_per_step(physics: Physics, parameters: np.ndarray) -> tuple[float, float]:
    """Per world and policy step in a batch: for several steps in a row, and for a single one."""
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
