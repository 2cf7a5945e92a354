"""What `check` would say of films, of episodes that are read already: before minutes of tuning."""

from collections.abc import Sequence

import numpy as np

from simtune.checking.film.as_read import AsRead
from simtune.checking.film.camera_film import (
    MOST_FILMED,
    MOST_FILMED_STEPS,
    camera_films,
    pictures_of_each,
)
from simtune.checking.film.look import look_at, named_warnings
from simtune.observation import ObservationModel
from simtune.simulation import Simulator
from simtune.trajectory import Trajectory, moments


def film_warnings(
    simulator: Simulator,
    observation: ObservationModel,
    real: Sequence[Trajectory],
    names: Sequence[str],
    seed: int,
) -> list[str]:
    """Where recorded films cannot show the simulator's scene as its cameras see it.

    `real`: episodes with pictures of the simulator's size, and these names.
    """
    few = real[:MOST_FILMED]
    num = pictures_of_each(len(few))
    each = ((e.frames, moments(min(len(e), MOST_FILMED_STEPS), num)) for e in few)
    frames = np.stack([film[at] for film, at in each])  # at moments that `Dataset.skim` keeps
    shortest = min(map(len, few))
    actions = np.stack([episode.actions[:shortest] for episode in few])
    films = camera_films(observation, frames, names[: len(few)])
    if observation.sensors:  # which tell turned films sooner than actions, and their own signs
        looks = look_at(films, simulator, actions, seed, AsRead(simulator, observation, few))
    else:
        recorded = {name: episode.actions for name, episode in zip(names, real, strict=True)}
        looks = look_at(films, simulator, actions, seed, recorded=recorded)
    return named_warnings(looks)
