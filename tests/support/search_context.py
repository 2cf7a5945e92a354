"""What tests of searches are made of: a cartpole in small pictures."""

import numpy as np

from simtune.observation import ObservationModel
from simtune.randomization import Distribution
from simtune.real.truth import Truth
from simtune.simulation import Simulator
from simtune.tasks import load_task
from simtune.trajectory import Trajectory
from simtune.tuning.search import SearchContext
from simtune.vision.keypoints import find_keypoints

SIZE = 32  # pixels
STEPS = 24
CARTPOLE = load_task("cartpole")
SPACE = CARTPOLE.parameters
START = SPACE.clip(SPACE.nominal * np.where(np.arange(len(SPACE)) % 2, 2, 0.5))


def context_of(simulator: Simulator, start: np.ndarray = START, seed: int = 0) -> SearchContext:
    """A search that begins at `start`, of what a simulator films."""
    first = Distribution.first(simulator.space, start)
    return SearchContext(
        simulator=simulator,
        keypoints=find_keypoints(simulator, first, 0),
        start=start,
        observation=ObservationModel.of_simulator(),
        seed=seed,
    )


def record_episodes(simulator: Simulator, num: int) -> list[Trajectory]:
    """Of a world with nominal parameters."""
    world = Truth(SPACE, SPACE.nominal).make_real(simulator, episode_steps=STEPS, seed=1)
    return world.collect(num)
