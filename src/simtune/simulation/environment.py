"""Worlds of a gymnasium environment: any simulator that takes parameters and draws pictures.

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
from dataclasses import dataclass
from typing import Any

import numpy as np

from simtune.cameras.pictures import BORDER_PX, middle_square, resize
from simtune.cameras.views import View
from simtune.errors import InputError, blame
from simtune.parameters import ParameterSpace
from simtune.simulation.actions import ActionSpace
from simtune.simulation.any_simulator import Act, AnySimulator, Observe, Rollouts
from simtune.simulation.rendering.stray_light import StrayLight

_MOST_ACTIONS_KEPT = 1 << 25  # numbers (256 MB) of episodes that can still be drawn
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


@dataclass(frozen=True)
class Points:
    """L of an environment's points, in a square picture of `image_size` pixels."""

    chosen: np.ndarray  # (L,) indices into info["points"]
    image_size: int

    def __len__(self) -> int:
        return len(self.chosen)

    def observe(self, points: np.ndarray) -> np.ndarray:
        """(n, all, 2) shares of the picture to (n, L · 2) float32 pixels; cf. `Keypoints`."""
        pixels = points[:, self.chosen] * self.image_size - 0.5
        seen = np.clip(pixels, BORDER_PX, self.image_size - 1 - BORDER_PX)
        return seen.astype(np.float32).reshape(len(points), -1)

    def select(self, indices: list[int]) -> "Points":
        """The chosen points at these indices."""
        return Points(self.chosen[indices], self.image_size)

    def state(self) -> list:
        """JSON, to restore the same choice."""
        return self.chosen.tolist()

    def with_state(self, state: list) -> "Points":
        """The choice that `state` describes."""
        return Points(np.array(state, int), self.image_size)


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


class EnvironmentSimulator(AnySimulator):
    """Plays worlds of one environment, one after the other; see `Simulator`.

    A state is an episode's number and a step: to draw it, the episode is played again. Old episodes
    are forgotten where all their actions would fill the memory.
    """

    supersampling = 1  # drawing is up to the environment

    def __init__(self, env: Any, space: ParameterSpace, *, step_s: float, image_size: int):
        """`env`: a gymnasium.Env, or a look-alike. Raises InputError for other actions."""
        self.space, self.step_s, self.image_size = space, step_s, image_size
        self.views = (View("render"),)
        self._actions = BoxActions(env.action_space)
        self._env = env
        self._shape: tuple[int, ...] | None = None  # (H, W) of its pictures
        self._num_played = 0  # the next episode's number
        self._episodes: dict[int, tuple[int, np.ndarray]] = {}  # {number: seed and actions}

    @property
    def action_mapping(self) -> BoxActions:
        """The available actions."""
        return self._actions

    def points(self) -> Points:
        """All points of the environment; there may be none."""
        num = len(_checked_points(self._begin(0, self.space.nominal)))
        return Points(np.arange(num), self.image_size)

    def play(
        self,
        parameters: np.ndarray,
        act: Act,
        num_steps: int,
        rng: np.random.Generator,
        *,
        starts: np.ndarray | None = None,
        observe: Observe | None = None,
        is_beginning: bool | None = None,
    ) -> Rollouts:
        """Act in n worlds of (n, N) parameters, each from its own start; see `Simulator.play`.

        `act` is called for all actions first, so it sees no states. `starts`: states of episodes
        that begin alike. `observe` gets the points, (1, all, 2), of every state. Worlds that end
        early stay where they ended, as diverged ones do.
        """
        n = len(parameters)
        actions = np.stack([act(t, np.empty((n, 2))) for t in range(num_steps)], 1)
        states, lengths = np.empty((n, num_steps + 1, 2)), np.empty(n, int)
        observed = []
        for i, world in enumerate(parameters):
            if starts is None:
                seed = int(rng.integers(2**31))
            else:
                seed, _ = self._episode(starts[i, 0])
            infos = list(self._play(seed, world, actions[i]))
            lengths[i] = len(infos) - 1
            states[i, :, 0] = self._num_played
            states[i, :, 1] = np.minimum(np.arange(num_steps + 1), lengths[i])
            self._episodes[self._num_played] = seed, actions[i].copy()
            self._num_played += 1
            infos += infos[-1:] * (num_steps - lengths[i])
            if observe:
                points = [self._points_of(info)[None] for info in infos]
                observed.append(np.concatenate([observe(p) for p in points]))
        self._forget(n)
        self.num_diverged += int((lengths < num_steps).sum())
        self.num_steps += n * num_steps
        all_observed = np.stack(observed) if observe else np.empty((n, num_steps + 1, 0))
        return Rollouts(parameters, states, actions, lengths, all_observed, np.arange(n))

    def render(
        self, states: np.ndarray, parameters: np.ndarray, stray: StrayLight | None = None
    ) -> np.ndarray:
        """Draw (n, 2) states of worlds of (n, N) parameters: (n, H, W, 3) uint8 RGB."""
        frames = np.empty((len(states), *self.shape, 3), np.uint8)
        for episode in np.unique(states[:, 0]):
            (mine,) = np.nonzero(states[:, 0] == episode)
            seed, actions = self._episode(episode)
            steps = states[mine, 1].astype(int)
            played = self._play(seed, parameters[mine[0]], actions[: steps.max()])
            drawn = {
                t: resize(middle_square(self._picture()), self.shape)
                for t, _ in enumerate(played)
                if t in steps
            }
            frames[mine] = [drawn[t] for t in steps]
        return frames

    def _episode(self, number: float) -> tuple[int, np.ndarray]:
        """Seed and actions. Raises ValueError for an episode that is forgotten."""
        if int(number) not in self._episodes:
            raise ValueError(
                f"episode {number:g} can no longer be drawn or begun again: expected one of the "
                f"latest {len(self._episodes)} of {self._num_played}"
            )
        return self._episodes[int(number)]

    def _forget(self, num_latest: int) -> None:
        """Old episodes, but none of the `num_latest`, which a caller has yet to see."""
        num_kept = sum(actions.size for _, actions in self._episodes.values())
        for number in list(self._episodes)[:-num_latest]:
            if num_kept <= _MOST_ACTIONS_KEPT:
                return
            num_kept -= self._episodes.pop(number)[1].size

    def _play(self, seed: int, world: np.ndarray, actions: np.ndarray) -> Iterator[dict[str, Any]]:
        """The environment's info on each state in turn, until the actions or the task end.

        A time limit of the environment's own (`truncated`) ends nothing: recordings may be longer.
        """
        yield self._begin(seed, world)
        for action in actions.astype(np.float32):
            with blame_environment("the environment's step() failed"):
                _, _, terminated, _, info = self._env.step(action)
            if terminated:
                return
            yield info

    def _begin(self, seed: int, world: np.ndarray) -> dict[str, Any]:
        options = {"parameters": dict(zip(self.space.names, world.tolist(), strict=True))}
        with blame_environment("the environment's reset() failed"):
            _, info = self._env.reset(seed=seed, options=options)
        return info

    def _picture(self) -> np.ndarray:
        """The present picture as the environment draws it."""
        with blame_environment("the environment's render() failed"):
            picture = self._env.render()
        if not isinstance(picture, np.ndarray) or picture.ndim != 3 or picture.dtype != np.uint8:
            raise InputError(
                "render() must give an (H, W, 3) uint8 array: is render_mode='rgb_array' set?"
            )
        return picture

    def _points_of(self, info: dict[str, Any]) -> np.ndarray:
        """(L, 2) shares of the central square, which may lie outside of it."""
        if self._shape is None:
            self._shape = self._picture().shape[:2]
        width_height = np.array(self._shape[::-1])
        return (_checked_points(info) - 0.5) * width_height / width_height.min() + 0.5


def _checked_points(info: dict[str, Any]) -> np.ndarray:
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
