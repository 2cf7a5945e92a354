"""Single pictures to train the detector on, each of looks of its own.

A detector that has seen two hundred worlds knows these. What it needs is variety: so every picture
is another moment of another episode, with other colours, in another light. A loose object must be
found next to the robot in any place, where the same actions in worlds that begin elsewhere hardly
ever push it: so it is put there. With ALOHA's arms, on films by
another renderer, a detector that had learnt from whole episodes found a grey box in 6 % of the
pictures, and with colours and places drawn for each picture in 90 %.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from simtune.randomization import Distribution
from simtune.search_param_model.simulated import PlayedWorlds
from simtune.simulation import Points, Simulator
from simtune.simulation.loose_objects import loose_places
from simtune.simulation.states import StateSpace
from simtune.vision.keypoints import Keypoints

_SPREAD = 2.0  # of places, relative to where objects were in the episodes
_USUAL = 0.02, 0.98  # quantiles: an object that was flung away tells nothing


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
            states = scattered(simulator.state_space, states, loose, rng)
            points = _look(simulator, played.keypoints, states, parameters)
        shown = replace(rollouts, parameters=parameters, states=states[:, None])
        frames = simulator.film(shown, observation.stray_light(num, rng))
        observation.add_noise(simulator, frames, rng)
        return cls(frames[:, 0], points.reshape(num, -1, 2).astype(np.float32), parameters)


def scattered(
    space: StateSpace, full_states: np.ndarray, places: Sequence[int], rng: np.random.Generator
) -> np.ndarray:
    """(n, S) states with free bodies moved sideways and turned about the vertical.

    `places`: index of each body's three coordinates and its quaternion among positions. Bodies are
    spread twice as wide as they are, and keep their heights.
    """
    states = space.positions_and_velocities(full_states).copy()
    for place in places:
        sideways, turn = slice(place, place + 2), slice(place + 3, place + 7)
        low, high = np.quantile(states[:, sideways], _USUAL, axis=0)
        half = _SPREAD * (high - low) / 2
        states[:, sideways] = (low + high) / 2 + rng.uniform(-half, half, (len(states), 2))
        upright = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi, (len(states), 1)))
        turned = upright * Rotation.from_quat(states[:, turn], scalar_first=True)
        states[:, turn] = turned.as_quat(scalar_first=True)
    return space.with_positions_and_velocities(full_states, states)


def _look(
    simulator: Simulator, keypoints: Keypoints | Points, states: np.ndarray, parameters: np.ndarray
) -> np.ndarray:
    """(n, 2 L) pixels in (n, S) states of worlds of (n, N) parameters."""
    at_once = simulator.play(
        parameters,
        lambda *_: np.zeros(0),
        0,
        np.random.default_rng(0),
        starts=states,
        observe=keypoints.observe,
    )
    return at_once.observed[:, 0]
