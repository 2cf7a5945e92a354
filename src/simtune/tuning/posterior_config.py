"""The settings of search="posterior"."""

from dataclasses import dataclass, field

from simtune.fit import FitConfig
from simtune.search_param_model.posterior import PosteriorConfig
from simtune.tuning.range_update import RangeUpdateConfig

# Frames of worlds that only the posterior network learns from, where nothing can be fitted: what
# they look like is known from others.
FILMED_WITHOUT_FIT = 2


@dataclass(frozen=True, kw_only=True)
class PosteriorSearchConfig:
    model: PosteriorConfig = field(default_factory=PosteriorConfig)
    range_update: RangeUpdateConfig = field(default_factory=RangeUpdateConfig)
    fit: FitConfig = field(default_factory=FitConfig)
    num_worlds: int = 192  # simulated in a round
    episodes_per_world: int = 4  # at most, of the real ones, whose actions they replay
    filmed_steps: int = 32  # successive frames drawn of each world
    held_out_worlds: int = 128  # of a round, that the detector is not trained on but tested on
    held_out_steps: int = 56  # of each, filmed
    num_rounds: int = 4  # at most
    # Half of a 90 % interval, relative to the estimate, that is narrow enough to stop; 0: go on
    precision: float = 0.0
    detector_updates: tuple[int, ...] = (1000, 2000, 4000)  # at most: first round, later ones
    posterior_updates: int = 500
    no_fit_scale: int = 6  # times the worlds, updates and time, where nothing can be fitted later
    state_updates: int = 500
    least_updates: int = 200  # of each, however late it is
    # Of a round's time, at most; what is left is for a fit and its refits
    collect_share: float = 0.12
    detector_share: float = 0.27
    posterior_share: float = 0.04
    state_share: float = 0.05
    num_refits: tuple[int, int] = (5, 8)  # of the bootstrap: planned, at most
