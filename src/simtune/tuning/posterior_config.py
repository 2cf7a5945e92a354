"""The settings of search="posterior"."""

from dataclasses import dataclass, field

from simtune.fit import ParticleConfig, ShootingConfig
from simtune.search_param_model.posterior import PosteriorConfig
from simtune.tuning.range_update import RangeUpdateConfig


@dataclass(frozen=True, kw_only=True)
class PosteriorSearchConfig:
    model: PosteriorConfig = field(default_factory=PosteriorConfig)
    move: RangeUpdateConfig = field(default_factory=RangeUpdateConfig)
    particles: ParticleConfig = field(default_factory=ParticleConfig)
    shooting: ShootingConfig = field(default_factory=ShootingConfig)
    num_worlds: int = 256  # simulated in an iteration
    episodes_per_world: int = 4  # at most, of the real ones, whose actions they replay
    filmed_steps: int = 32  # successive frames drawn of each world
    unseen_worlds: int = 256  # of an iteration, that the detector is not taught on but tested on
    unseen_steps: int = 64  # of each, filmed
    iterations: int = 2
    detector_updates: tuple[int, ...] = (2500, 6000)  # at most: first iteration, later ones
    posterior_updates: int = 800
    no_fit_scale: int = 6  # times the worlds, updates and time, where nothing can be fitted later
    state_updates: int = 600
    least_updates: int = 200  # of each, however late it is
    time_shares: tuple[float, ...] = (0.4, 0.6)  # of the time, for each iteration
    collect_share: float = 0.2  # of an iteration's time, at most, goes into simulating
    detector_share: float = 0.38  # of an iteration's time
    posterior_share: float = 0.06
    state_share: float = 0.08
    fit_share: float = 0.15  # of one fit, about; particles and windows are fewer for slow physics
    replicas: tuple[int, int] = (2, 8)  # worlds fitted as the real one is: at least, at most
