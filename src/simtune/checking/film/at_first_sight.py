"""What `check` would say of films, of episodes that are read already: before minutes of tuning."""

from collections.abc import Sequence

import numpy as np

from simtune.checking.film.as_read import AsRead
from simtune.checking.film.camera_film import (
    MOST_EPISODES,
    MOST_STEPS,
    camera_films,
    pictures_of_each,
)
from simtune.checking.film.look import look_at, warnings_of
from simtune.observation import ObservationModel, joints_of
from simtune.simulation import Simulator
from simtune.trajectory import Trajectory, moments


def film_warnings(
    simulator: Simulator,
    seen: ObservationModel,
    real: Sequence[Trajectory],
    names: Sequence[str],
    seed: int,
) -> list[str]:
    """Where recorded films cannot show the simulator's scene as its cameras see it.

    `real`: episodes with pictures of the simulator's size, and these names.
    """
    few = real[:MOST_EPISODES]
    num = pictures_of_each(len(few))
    frames = np.stack([_some_frames(episode, num) for episode in few])
    shortest = min(len(episode) for episode in few)
    actions = np.stack([episode.actions[:shortest] for episode in few])
    films = camera_films(seen, frames)
    if joints_of(seen.sensors):  # which tell turned films sooner than actions, and their own signs
        looks = look_at(films, simulator, actions, seed, AsRead(simulator, seen, few))
    else:
        recorded = {name: episode.actions for name, episode in zip(names, real, strict=True)}
        looks = look_at(films, simulator, actions, seed, recorded=recorded)
    return warnings_of(looks)


def _some_frames(episode: Trajectory, num: int) -> np.ndarray:
    """(num, H, W, 3), at the moments that `Dataset.skim` keeps."""
    return episode.frames[moments(min(len(episode), MOST_STEPS), num)]
