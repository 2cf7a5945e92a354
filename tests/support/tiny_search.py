"""A posterior search that takes seconds and finds nothing."""

from simtune.fit import FitConfig
from simtune.fit.motion.shooting_config import ShootingConfig, Stage
from simtune.search_param_model.posterior import PosteriorConfig
from simtune.search_param_model.posterior_net import PosteriorNetConfig
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.vision.detector import DetectorConfig

TINY_SEARCH = PosteriorSearchConfig(
    model=PosteriorConfig(
        detector=DetectorConfig(channels=4, free_maps=2, hidden=16, batch_size=8),
        posterior_net=PosteriorNetConfig(channels=8, hidden=16, batch_size=8, candidates=8),
    ),
    num_worlds=16,
    episodes_per_world=2,
    pictures_per_world=4,
    held_out_worlds=6,
    held_out_steps=8,
    near_worlds=6,
    near_steps=8,
    num_rounds=2,
    detector_updates=(6, 4),
    posterior_updates=5,
    state_updates=4,
    least_updates=2,
    planned_refits=1,
    most_refits=1,
    fit=FitConfig(
        num_particles=8,
        shooting=ShootingConfig(
            stages=(Stage(4, 1, 2.0), Stage(8, 1)),
            longer=(16,),
            longer_iterations=1,
            num_windows=6,
        ),
        num_pictures=6,
    ),
)
