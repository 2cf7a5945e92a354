"""Single pictures to train the detector on, each of looks of its own.

A detector that has seen two hundred worlds knows these. What it needs is variety: so every picture
is another moment of another episode, with other colours, in another light. A loose object must be
found next to the robot in any place, where the same actions in worlds that begin elsewhere hardly
ever push it: so it is put there. With ALOHA's arms, on films by another renderer, a detector that
had learnt from whole episodes found a grey box in 6 % of the pictures; with colours and places
drawn for each picture, in 90 %.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from simtune.randomization import Distribution
from simtune.search_param_model.simulated import PlayedWorlds
from simtune.simulation import Simulator
from simtune.simulation.loose_objects import loose_places, scattered


@dataclass(frozen=True)
class TrainingPictures:
    """n pictures."""

    frames: np.ndarray  # (n, H, W, 3) uint8
    keypoints: np.ndarray  # (n, L, 2) pixels, true
    parameters: np.ndarray  # (n, N)

    @classmethod
    def joined(cls, parts: Sequence["TrainingPictures"]) -> "TrainingPictures":
        """The pictures of several parts."""
        arrays = zip(*(vars(part).values() for part in parts), strict=True)
        return cls(*map(np.concatenate, arrays))

    @classmethod
    def draw(
        cls,
        played: PlayedWorlds,
        looks: Distribution,
        num: int,
        rng: np.random.Generator,
    ) -> "TrainingPictures":
        """`num` pictures of any steps of the worlds, with colours and light drawn from `looks`.

        Loose objects are in places of their own; see `scattered`.
        """
        simulator, observation, rollouts = played.simulator, played.observation, played.rollouts
        episode = rng.choice(played.whole.ravel(), num)
        step = rng.integers(rollouts.states.shape[1], size=num)
        parameters, states = rollouts.parameters[episode].copy(), rollouts.states[episode, step]
        is_look = looks.space.is_appearance
        parameters[:, is_look] = looks.sample(num, rng)[:, is_look]
        points = rollouts.observed[episode, step, : 2 * len(played.keypoints)]
        if isinstance(simulator, Simulator) and (loose := loose_places(simulator.model)):
            states = scattered(simulator.state_space, states, loose, 1.0, rng)
            see = played.keypoints.observe
            points = simulator.begin(parameters, rng, starts=states, observe=see).observed[:, 0]
        shown = replace(rollouts, parameters=parameters, states=states[:, None])
        frames = simulator.film(shown, observation.stray_light(num, rng))
        observation.add_noise(simulator, frames, rng)
        return cls(frames[:, 0], points.reshape(num, -1, 2).astype(np.float32), parameters)
