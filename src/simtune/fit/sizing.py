"""Sizes a fit: slow physics gets fewer particles and windows."""

from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from simtune.budget import timed
from simtune.fit.motion.shooting_config import ShootingConfig
from simtune.fit.physics import Physics

_SIDES = 2  # of the start, from which windows are fitted
_MIN_PARTICLES, _MIN_WINDOWS = 32, 20
_HURRIED_PARTICLES, _HURRIED_WINDOWS, _HURRIED_PICTURES = 16, 12, 20  # if even those take too long
# Of a fit's time, that all particles may take: they cost little, and where they end decides whether
# windows arrive. Six of rope_peg's refits of 10 windows left a rope .20, .15 and .12 off, in unit
# coordinates, after 16, 32 and 64 particles (12.6, 13.0 and 15.5 s).
_PARTICLES_TIME_SHARE = 0.25
# Factor on the time of particles and windows, for latencies, offsets and the held-out episode.
_TOTAL_TIME_FACTOR = 2.0
_LONGER_TIME_SHARE = 0.8  # of a fit's at most: two refits that take as long have time, too
_TIMED_WORLDS, _TIMED_STEPS = 64, 12


class FitWork(NamedTuple):
    """What the time of a fit depends on, besides its configuration."""

    num_steps: int  # of all episodes
    num_unknown: int  # numbers of a state that are not known
    num_fitted: int  # parameters


@dataclass(frozen=True, kw_only=True)
class FitConfig:
    num_particles: int = 64  # per episode, at most
    shooting: ShootingConfig = field(default_factory=ShootingConfig)
    num_pictures: int = 40  # in which colours are fitted, at most
    # Seconds after a fit's beginning, by which longer windows must end, the first ones excepted
    longer_within_s: float = np.inf
    held: tuple[int, ...] = ()  # parameters that keep their start and its std

    def at_most(self, num_particles: int, num_windows: int) -> "FitConfig":
        """With no more particles and windows, but never fewer than tell enough."""
        fewest = max(_MIN_PARTICLES, num_particles), max(_MIN_WINDOWS, num_windows)
        return self._at_most(*fewest)

    def least(self, num_particles: int = 0) -> "FitConfig":
        """With the fewest that tell anything, or as many particles, and no longer windows."""
        config = self._at_most(max(num_particles, _HURRIED_PARTICLES), _HURRIED_WINDOWS)
        num_pictures = min(_HURRIED_PICTURES, self.num_pictures)
        shooting = replace(config.shooting, longer=())
        return replace(config, shooting=shooting, num_pictures=num_pictures)

    def _at_most(self, num_particles: int, num_windows: int) -> "FitConfig":
        num_windows = min(num_windows, self.shooting.num_windows)
        return replace(
            self,
            num_particles=min(num_particles, self.num_particles),
            shooting=replace(self.shooting, num_windows=num_windows),
        )


def count_windows(config: FitConfig, work: FitWork) -> int:
    """The configured number, or all that the episodes have."""
    return min(config.shooting.num_windows, -(-work.num_steps // config.shooting.stages[-1].window))


def count_fit_steps(config: FitConfig, work: FitWork) -> tuple[int, int]:
    """Policy steps that particles and windows play."""
    shooting, windows = config.shooting, count_windows(config, work)
    num_derived = 1 + work.num_unknown + 2 * work.num_fitted
    played = _SIDES * shooting.steps_per_window(num_derived) + shooting.steps_of_longer(num_derived)
    return work.num_steps * config.num_particles, windows * played


def fit_to_budget(
    config: FitConfig,
    physics: Physics,
    parameters: np.ndarray,
    work: FitWork,
    seconds: float,
    at_most_s: float = np.inf,
) -> FitConfig:
    """With as many particles and windows as `seconds` allow, particles first.

    The fewest that tell enough may take longer than that. If they exceed `at_most_s`, the fewest
    windows that tell anything are taken. Longer windows must end within a share of `at_most_s`:
    if the data say little, every length is tried, and no time would be left for refits.
    """
    if not np.isfinite(seconds):
        return config
    step_s, begun_step_s = _seconds_per_step(physics, parameters)

    def needed_s(sized: FitConfig) -> np.ndarray:
        of_particles, of_windows = count_fit_steps(sized, work)
        return np.array([begun_step_s * of_particles, step_s * of_windows])

    config = replace(config, longer_within_s=_LONGER_TIME_SHARE * at_most_s)
    particles_s, windows_s = needed_s(config)
    num_particles, num_windows = config.num_particles, count_windows(config, work)
    share = max(seconds / (particles_s + windows_s), _PARTICLES_TIME_SHARE * seconds / particles_s)
    share = min(1.0, share)
    of_windows = min(1.0, (seconds - share * particles_s) / windows_s)
    planned = config.at_most(int(share * num_particles), int(of_windows * num_windows))
    if _TOTAL_TIME_FACTOR * needed_s(planned).sum() <= at_most_s:
        return planned
    in_time = min(1.0, _PARTICLES_TIME_SHARE * at_most_s / _TOTAL_TIME_FACTOR / particles_s)
    return config.least(int(in_time * num_particles))


def _seconds_per_step(physics: Physics, parameters: np.ndarray) -> tuple[float, float]:
    """Per world and policy step in a batch: for several steps in a row, and for a single one."""
    units = np.repeat(physics.parameters.to_unit(parameters)[None], _TIMED_WORLDS, 0)
    starts = np.repeat(physics.some_state[None], _TIMED_WORLDS, 0)
    still = np.zeros((_TIMED_WORLDS, _TIMED_STEPS, physics.simulator.num_actions))
    full_states, _ = physics.play(starts, units, still)
    starts, seconds = physics.states(full_states[:, -1]), []
    for count in (_TIMED_STEPS, 1):
        took_s, _ = timed(partial(physics.play, starts, units, still[:, :count]))
        seconds.append(took_s / _TIMED_WORLDS / count)
    return seconds[0], seconds[1]
