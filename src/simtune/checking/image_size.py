"""The height of pictures: as asked for, or by how many pixels what moves has."""

import logging
import math
from pathlib import Path

import numpy as np

from simtune.checking.extents import FEW_PX, enough_size, extents_px
from simtune.config import NO_RECORDINGS, CheckConfig, TuneConfig
from simtune.errors import InputError
from simtune.names import SEARCHES, SearchName
from simtune.observation import ObservationModel
from simtune.real.observed import observed, open_recordings
from simtune.tasks import AnyTask, Task

_LARGEST_PX = 128  # chosen by itself, since time grows with the square
_EPISODES, _STEPS = 4, 60  # looked at, at most

log = logging.getLogger(__name__)


def choose_image_size(config: TuneConfig | CheckConfig, task: AnyTask, search: SearchName) -> int:
    """Height of pictures in pixels.

    By default the search's usual one. A search whose pictures need not be square takes more, at
    most 128 and not more than recordings have, if even the largest moving part would be small
    otherwise. Raises InputError for recordings that cannot be read, and for a size where no camera
    is observed.
    """
    traits, observation = SEARCHES[search], observed(task, config.observed, is_simulated=False)
    usual = traits.usual_px
    if config.image_size and not observation.cameras:
        who = f"--observe {config.observe}" if config.observe else task.name
        raise InputError(f"--image-size goes with pictures, and {who} looks at none")
    if config.image_size or traits.needs_square_pictures or not isinstance(task, Task):
        return config.image_size or usual
    # Before the worlds, which take seconds of a large model: recordings may be unreadable
    recorded_px = _recorded_px(config, task, observation, usual) or _LARGEST_PX
    largest_px = _largest_px(task, observation, usual)
    if largest_px >= FEW_PX:
        return usual
    size = min(enough_size(largest_px, usual), _LARGEST_PX, recorded_px)
    if size <= usual:
        return usual
    log.info(
        "pictures are %d pixels high, not %d, since what moves has %.1f pixels there",
        size,
        usual,
        largest_px,
    )
    return size


def _largest_px(task: Task, observation: ObservationModel, height: int) -> float:
    """Across the largest of what moves under random actions; infinite if nothing is in sight."""
    simulator = task.simulator(image_size=height, views=())  # renderers take a second to make
    rng, num_steps = np.random.default_rng(0), min(_STEPS, task.episode_steps)
    worlds = np.tile(task.parameters.nominal, (_EPISODES, 1))
    act = simulator.explore(_EPISODES, num_steps, rng)
    states = simulator.play(worlds, act, num_steps, rng).states
    extents = extents_px(simulator, states, observation.views())
    return max((px for px in extents.values() if px > 0), default=math.inf)


def _recorded_px(
    config: TuneConfig | CheckConfig, task: Task, observation: ObservationModel, usual: int
) -> int | None:
    """Height of the recordings' pictures; None if the real world is filmed in any size."""
    if config.real is None or str(config.real) in NO_RECORDINGS:
        return None
    return open_recordings(Path(config.real), task, config, usual, observation).recorded_px
