"""Worlds of a gymnasium environment: any simulator that takes parameters and draws pictures."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from simtune.cameras.pictures import BORDER_PX, middle_square, resize
from simtune.cameras.views import View
from simtune.parameters import ParameterSpace
from simtune.simulation.any_simulator import Act, AnySimulator, Observe, Rollouts
from simtune.simulation.rendering.stray_light import StrayLight
from simtune.simulation.user_environment import BoxActions, UserEnvironment, checked_points

_MOST_ACTIONS_KEPT = 1 << 25  # numbers (256 MB) of episodes that can still be drawn


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
        self._env = UserEnvironment(env, space)
        self._num_played = 0  # the next episode's number
        self._episodes: dict[int, tuple[int, np.ndarray]] = {}  # {number: seed and actions}

    @property
    def action_mapping(self) -> BoxActions:
        """The available actions."""
        return self._actions

    def points(self) -> Points:
        """All points of the environment; there may be none."""
        info = self._env.reset(0, self.space.nominal)
        return Points(np.arange(len(checked_points(info))), self.image_size)

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
                points = [self._env.points(info)[None] for info in infos]
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
                t: resize(middle_square(self._env.picture()), self.shape)
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
        """The environment's info on each state in turn, until the actions or the task end."""
        yield self._env.reset(seed, world)
        for action in actions.astype(np.float32):
            info, is_over = self._env.step(action)
            if is_over:
                return
            yield info
