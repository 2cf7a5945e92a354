"""A ball that bounces in a box, pushed to the sides: a simulator that is not MuJoCo."""

import gymnasium
import numpy as np

_STEP_S = 0.05
_SUBSTEPS = 5
_RADIUS_M = 0.08  # the box is one metre wide and high
_SIZE = 96  # pixels a side of a picture


class BouncingBall(gymnasium.Env):
    """Pushed by one action in [-1, 1]."""

    def __init__(self):
        self.action_space = gymnasium.spaces.Box(-1, 1, (1,), np.float32)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (4,), np.float32)
        self._x, self._y = (np.arange(_SIZE) + 0.5) / _SIZE, 1 - (np.arange(_SIZE) + 0.5) / _SIZE

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self._world = options["parameters"]
        self._place = self.np_random.uniform([0.2, 0.5], [0.8, 0.9])  # of the ball's middle, m
        self._speed = self.np_random.uniform(-0.5, 0.5, 2)  # m/s
        return self._observation(), self._info()

    def step(self, action):
        world, dt = self._world, _STEP_S / _SUBSTEPS
        force = np.array([world["push"] * float(np.clip(action[0], -1, 1)), -world["gravity"]])
        for _ in range(_SUBSTEPS):
            self._speed += dt * (force - world["drag"] * self._speed)
            self._place += dt * self._speed
            beyond = np.clip(self._place, _RADIUS_M, 1 - _RADIUS_M) - self._place
            hit = beyond * self._speed < 0
            self._speed[hit] *= -world["bounce"]
            self._place += beyond
        return self._observation(), 0.0, False, False, self._info()

    def render(self):
        """(96, 96, 3) uint8, with smooth edges."""
        away = np.hypot(self._x - self._place[0], (self._y - self._place[1])[:, None])
        cover = np.clip((_RADIUS_M - away) * _SIZE + 0.5, 0, 1)[..., None]
        wall = np.array([0.15, 0.2, 0.3]) + 0.1 * (self._y[:, None, None] < 0.5)
        ball = np.array([self._world[f"ball_{channel}"] for channel in "rgb"])
        return np.rint(255 * (cover * ball + (1 - cover) * wall)).astype(np.uint8)

    def _observation(self):
        return np.concatenate([self._place, self._speed]).astype(np.float32)

    def _info(self):
        # Where in the picture the ball is: simtune learns to see it.
        return {"points": [[self._place[0], 1 - self._place[1]]]}
