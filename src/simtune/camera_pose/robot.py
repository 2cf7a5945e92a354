"""The robot in states that joints tell, as cameras see it."""

import functools
import time

import numpy as np

from simtune.camera_pose.scene import is_drawn
from simtune.camera_pose.silhouettes import surface_points
from simtune.observation import ObservationModel
from simtune.simulation import Simulator
from simtune.vision.keypoints import candidate_keypoints

_AT_ONCE = 100  # cameras
_TIMED = 8  # pictures


class Robot:
    """Drawn, and as points, by cameras of (P,) unit coordinates."""

    def __init__(
        self, simulator: Simulator, without: Simulator, observation: ObservationModel, seed: int
    ):
        """`without`: draws the same scene without the robot."""
        self.simulator, self.space, self._observation = simulator, simulator.space, observation
        self._without = without
        self._rng = np.random.default_rng(seed)
        model = simulator.model
        every = candidate_keypoints(model, simulator.views, simulator.image_size)
        drawn = every.select(np.flatnonzero(is_drawn(model)[every.geoms]).tolist())
        self._points = surface_points(model, drawn, self._rng)

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
        """(n, P) to (n, K, L, 2) pixels of its points in (K, S) states."""
        parts = np.array_split(self.space.from_unit(units), -(-len(units) // _AT_ONCE))
        pixels = [self._project(some, states) for some in parts]
        return np.concatenate(pixels).reshape(len(units), len(states), -1, 2)

    def draw(self, unit: np.ndarray, states: np.ndarray) -> np.ndarray:
        """(K, H, W, 3) uint8 of (K, S) states."""
        return self.simulator.render(states, self._same(unit, len(states)))

    def draw_without(self, unit: np.ndarray, states: np.ndarray) -> np.ndarray:
        """(K, H, W, 3) uint8 of all that stands still, or once for all."""
        num = len(states) if self._is_mounted else 1
        return self._without.render(states[:num], self._same(unit, num))

    def film(self, unit: np.ndarray, states: np.ndarray) -> np.ndarray:
        """(K, H, W, 3) frames of (K, S) states, with a camera's noise."""
        frames = self.draw(unit, states)
        self._observation.add_noise(self.simulator, frames[None], self._rng)
        return frames

    @functools.cached_property
    def _is_mounted(self) -> bool:
        """Whether the camera moves with the robot."""
        model = self.simulator.model
        (view,) = self.simulator.views
        return bool(model.body_weldid[model.cam_bodyid[model.camera(view.camera).id]] != 0)

    def _same(self, unit: np.ndarray, num: int) -> np.ndarray:
        return np.tile(self.space.from_unit(unit), (num, 1))

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
