"""The settings of search="posterior"."""

from dataclasses import dataclass, field

from simtune.fit import FitConfig
from simtune.search_param_model.posterior import PosteriorConfig


@dataclass(frozen=True, kw_only=True)
class PosteriorSearchConfig:
    model: PosteriorConfig = field(default_factory=PosteriorConfig)
    fit: FitConfig = field(default_factory=FitConfig)
    num_worlds: int = 192  # simulated per round
    episodes_per_world: int = 4  # at most; each replays a real one's actions
    pictures_per_world: int = 32  # to train the detector on
    held_out_worlds: int = 128  # per round, to test the detector on
    held_out_steps: int = 56  # filmed of each
    near_worlds: int = 24  # that resemble the real one, for the same
    near_steps: int = 32
    num_rounds: int = 4  # at most
    # Half-width of a 90 % interval, relative to the estimate, at which to stop; 0: never
    precision: float = 0.0
    for_policy: bool = False  # whether all must be identified, too
    # Whether the policy works at any brightness. A real camera's is unknown, so colours then need
    # not be precise
    tolerates_brightness: bool = False
    detector_updates: tuple[int, ...] = (1000, 2000, 4000)  # at most: first round, later ones
    posterior_updates: int = 500
    no_fit_scale: int = 6  # factor on worlds, updates and time if nothing can be fitted
    state_updates: int = 500
    least_updates: int = 200  # of each network, however late it is
    # Shares of a round's time, at most; the rest is for a fit and its refits
    collect_share: float = 0.12
    detector_share: float = 0.27
    posterior_share: float = 0.04
    state_share: float = 0.05
    planned_refits: int = 5  # of known worlds, by the parametric bootstrap
    most_refits: int = 8  # if there is time
