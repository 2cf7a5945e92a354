"""The settings of search="posterior"."""

from dataclasses import dataclass, field

from simtune.fit import FitConfig
from simtune.search_param_model.posterior import PosteriorConfig
from simtune.tuning.range_update import RangeUpdateConfig


@dataclass(frozen=True, kw_only=True)
class PosteriorSearchConfig:
    model: PosteriorConfig = field(default_factory=PosteriorConfig)
    range_update: RangeUpdateConfig = field(default_factory=RangeUpdateConfig)
    fit: FitConfig = field(default_factory=FitConfig)
    num_worlds: int = 256  # simulated in a round
    episodes_per_world: int = 4  # at most, of the real ones, whose actions they replay
    filmed_steps: int = 32  # successive frames drawn of each world
    held_out_worlds: int = 256  # of a round, that the detector is not trained on but tested on
    held_out_steps: int = 64  # of each, filmed
    num_rounds: int = 2
    detector_updates: tuple[int, ...] = (2500, 6000)  # at most: first round, later ones
    posterior_updates: int = 800
    no_fit_scale: int = 6  # times the worlds, updates and time, where nothing can be fitted later
    state_updates: int = 600
    least_updates: int = 200  # of each, however late it is
    time_shares: tuple[float, ...] = (0.4, 0.6)  # of the time, for each round
    collect_share: float = 0.2  # of a round's time, at most, goes into simulating
    detector_share: float = 0.38  # of a round's time
    posterior_share: float = 0.06
    state_share: float = 0.08
    fit_share: float = 0.15  # of one fit, about; particles and windows are fewer for slow physics
    num_refits: tuple[int, int] = (2, 8)  # of the bootstrap: at least, at most
