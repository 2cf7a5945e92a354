"""The robot in states that joints tell, as cameras see it."""

import functools
import time

import numpy as np

from simtune.camera_pose.silhouettes import surface_points
from simtune.observation import ObservationModel
from simtune.simulation import Simulator
from simtune.vision.keypoints import candidate_keypoints

_AT_ONCE = 100  # cameras
_TIMED = 8  # pictures


class Robot:
    """Drawn, and as points, by cameras and in colours of (N,) unit coordinates."""

    def __init__(self, simulator: Simulator, observation: ObservationModel, seed: int):
        self.simulator, self.space, self._observation = simulator, simulator.space, observation
        self._rng = np.random.default_rng(seed)
        every = candidate_keypoints(simulator.model, simulator.views, simulator.image_size)
        self._points = surface_points(simulator.model, every, self._rng)

    @functools.cached_property
    def seconds_a_picture(self) -> float:
        """That drawing takes."""
        worlds = np.tile(self.space.nominal, (_TIMED, 1))
        rest = self.simulator.roll_out(
            worlds, np.zeros((_TIMED, 0, self.simulator.num_actions)), self._rng
        )
        self.simulator.render(rest.states[:, 0], worlds)  # the first time is longer
        began_s = time.monotonic()
        self.simulator.render(rest.states[:, 0], worlds)
        return (time.monotonic() - began_s) / _TIMED

    def project(self, units: np.ndarray, states: np.ndarray) -> np.ndarray:
        """(n, N) to (n, K, L, 2) pixels of its points in (K, S) states."""
        parts = np.array_split(self.space.from_unit(units), -(-len(units) // _AT_ONCE))
        pixels = [self._project(some, states) for some in parts]
        return np.concatenate(pixels).reshape(len(units), len(states), -1, 2)

    def film(self, unit: np.ndarray, states: np.ndarray) -> np.ndarray:
        """(K, H, W, 3) frames of (K, S) states, with a camera's noise."""
        parameters = np.tile(self.space.from_unit(unit), (len(states), 1))
        frames = self.simulator.render(states, parameters)
        self._observation.add_noise(self.simulator, frames[None], self._rng)
        return frames

    def _project(self, parameters: np.ndarray, states: np.ndarray) -> np.ndarray:
        every = np.tile(states, (len(parameters), 1))
        played = self.simulator.roll_out(
            np.repeat(parameters, len(states), 0),
            np.zeros((len(every), 0, self.simulator.num_actions)),
            self._rng,
            self._points.observe,
            every,
            keep_diverged=True,
        )
        return played.observed[:, 0]
