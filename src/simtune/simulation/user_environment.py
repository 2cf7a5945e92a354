"""A gymnasium environment as users write it, and what simtune asks of it.

Beyond gymnasium's usual interface, an environment must provide:

* `reset(seed=..., options={"parameters": {name: value, ...}})` starts a world with these
  parameters; the same seed, parameters and actions give the same episode;
* `render()` gives the present picture, (H, W, 3) uint8 RGB;
* `info["points"]` of `reset` and `step`, (L, 2), are positions in the picture of points that move
  with its parts: 0 to 1 from the left and from the top. Only a simulator knows them, and the
  detector is trained on them.

Pictures that are not square are cut to their central square.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from simtune.errors import InputError, blame
from simtune.parameters import ParameterSpace
from simtune.simulation.actions import ActionSpace

_NO_CONTEXT = ("OpenGL", "gladLoadGL")  # in what MuJoCo raises without a display


@contextmanager
def blame_environment(what: str) -> Iterator[None]:
    """`blame` its code for what fails; says what to do where MuJoCo cannot draw."""
    try:
        with blame(what):
            yield
    except InputError as error:
        is_set = "MUJOCO_GL" in os.environ or isinstance(error.__cause__, ImportError)
        if is_set or not any(word in str(error) for word in _NO_CONTEXT):
            raise
        raise InputError(
            f"{error}; without a display, MuJoCo's OpenGL needs MUJOCO_GL=egl (or osmesa) in the "
            "shell that starts simtune: the environment's file is read too late to set it"
        ) from error


class BoxActions(ActionSpace):
    """Actions as the environment's action space, a one-dimensional Box, takes them."""

    def __init__(self, space: Any):
        """Raises InputError for any other space."""
        low, high = (np.asarray(getattr(space, end, np.empty(()))) for end in ("low", "high"))
        if low.ndim != 1:
            raise InputError(f"the action space must be a Box of one dimension, got {space}")
        finite = np.isfinite(low) & np.isfinite(high)
        self.names = tuple(f"action_{i}" for i in range(len(low)))
        self.range = np.stack([np.where(finite, low, -1.0), np.where(finite, high, 1.0)], -1)
        self.is_limited = finite


class UserEnvironment:
    """A gymnasium.Env, or a look-alike; what fails in it is an InputError."""

    def __init__(self, env: Any, space: ParameterSpace):
        self._env, self._names = env, space.names
        self._shape: tuple[int, ...] | None = None  # (H, W) of its pictures

    def reset(self, seed: int, world: np.ndarray) -> dict[str, Any]:
        """Info on the first state of a world of (N,) parameters."""
        options = {"parameters": dict(zip(self._names, world.tolist(), strict=True))}
        with blame_environment("the environment's reset() failed"):
            _, info = self._env.reset(seed=seed, options=options)
        return info

    def step(self, action: np.ndarray) -> tuple[dict[str, Any], bool]:
        """Info on the next state, and whether the task is over.

        A time limit of the environment's own (`truncated`) ends nothing: recordings may be longer.
        """
        with blame_environment("the environment's step() failed"):
            _, _, terminated, _, info = self._env.step(action)
        return info, terminated

    def picture(self) -> np.ndarray:
        """The present picture as the environment draws it."""
        with blame_environment("the environment's render() failed"):
            picture = self._env.render()
        if not isinstance(picture, np.ndarray) or picture.ndim != 3 or picture.dtype != np.uint8:
            raise InputError(
                "render() must give an (H, W, 3) uint8 array: is render_mode='rgb_array' set?"
            )
        return picture

    def points(self, info: dict[str, Any]) -> np.ndarray:
        """(L, 2) shares of the central square, which may lie outside of it."""
        if self._shape is None:
            self._shape = self.picture().shape[:2]
        width_height = np.array(self._shape[::-1])
        return (checked_points(info) - 0.5) * width_height / width_height.min() + 0.5


def checked_points(info: dict[str, Any]) -> np.ndarray:
    """(L, 2) shares of the whole picture. Raises InputError for anything else."""
    with blame('the environment\'s info["points"] failed'):
        points = np.asarray(info.get("points", ()), float)
    if not points.size:
        return points.reshape(0, 2)
    if points.ndim != 2 or points.shape[1] != 2 or not np.isfinite(points).all():
        raise InputError(
            'info["points"] must be (L, 2) finite numbers, shares of the picture from the left and '
            f"from the top, got {points.shape}{'' if np.isfinite(points).all() else ' with NaN'}"
        )
    return points
