"""Interface of all simulators: play worlds and draw their states; and the result of playing."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from simtune.cameras.views import View
from simtune.parameters import ParameterSpace
from simtune.simulation.actions import ActionSpace
from simtune.simulation.rendering.stray_light import StrayLight
from simtune.simulation.states import StateSpace

# A Batch of n worlds, or an environment's (n, L, 2) points, to (n, D) numbers
Observe = Callable[[Any], np.ndarray]
Act = Callable[[int, np.ndarray], np.ndarray]  # step t and (n, S) states to (n, A) actions


@dataclass(frozen=True)
class Rollouts:
    """Result of playing n worlds for T steps."""

    parameters: np.ndarray  # (n, N) of each world
    states: np.ndarray  # (n, T + 1, S) full states, for a renderer
    actions: np.ndarray  # (n, T, A)
    lengths: np.ndarray  # (n,) steps after which the physics was still finite
    observed: np.ndarray  # (n, 1 + T · observations per step, D); without `observe` D is 0
    index: np.ndarray  # (n,) of each world among those requested

    def __len__(self) -> int:
        return len(self.states)

    def finished(self) -> "Rollouts":
        """The worlds whose physics stayed finite to the end."""
        return self.only(self.lengths == self.actions.shape[1])

    def only(self, kept: np.ndarray) -> "Rollouts":
        """The worlds `kept`, (n,) bool."""
        return Rollouts(*(array[kept] for array in vars(self).values()))


class AnySimulator(ABC):
    """Worlds of any kind: a MuJoCo model's (`Simulator`) or a gymnasium environment's."""

    space: ParameterSpace
    step_s: float  # duration of an action
    image_size: int  # height of pictures in pixels
    views: tuple[View, ...]  # shown side by side in pictures
    supersampling: int  # k × k points are averaged per pixel
    num_steps: int = 0  # policy steps simulated so far
    num_diverged: int = 0  # worlds that ended early

    @property
    @abstractmethod
    def action_mapping(self) -> ActionSpace:
        """The available actions, and for a model their effects."""

    @property
    def state_space(self) -> StateSpace | None:
        """Layout of states; None if they are no physical quantities."""
        return None

    @property
    def can_start_anywhere(self) -> bool:
        """Whether worlds can start in any state, not only as an earlier episode did."""
        return self.state_space is not None

    @abstractmethod
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
        """Act in n worlds of (n, N) parameters, each from its own start; returns all of them.

        `starts`, (n, S), are states to start from instead; `is_beginning`: whether episodes begin
        there, by default not. `observe` is called in every state.
        """

    @abstractmethod
    def render(
        self, states: np.ndarray, parameters: np.ndarray, stray: StrayLight | None = None
    ) -> np.ndarray:
        """Draw (n, S) states of worlds of (n, N) parameters: (n, H, W, 3) uint8 RGB.

        `stray`: of each; of meshes the ray caster draws shadows only. Others ignore it.
        """

    def explore(self, num_worlds: int, num_steps: int, rng: np.random.Generator) -> Act:
        """Random actions that excite `num_worlds` worlds."""
        drawn = random_actions(num_worlds, num_steps, self.action_mapping, rng)
        return lambda t, _: drawn[:, t]

    @property
    def widths(self) -> list[int]:
        """Width of each view in pixels."""
        return [view.width(self.image_size) for view in self.views]

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W) of pictures."""
        return self.image_size, sum(self.widths)

    @property
    def num_actions(self) -> int:
        """A, the length of an action."""
        return len(self.action_mapping.names)

    @property
    def action_scale(self) -> np.ndarray:
        """(A,) largest magnitude of each action: 1 without limits."""
        return np.abs(self.action_mapping.range).max(-1)

    def roll_out(
        self,
        parameters: np.ndarray,
        actions: np.ndarray,
        rng: np.random.Generator,
        observe: Observe | None = None,
        starts: np.ndarray | None = None,
        keep_diverged: bool = False,
        is_beginning: bool | None = None,
    ) -> Rollouts:
        """Play (n, T, A) actions in n worlds of (n, N) parameters; see `play`.

        Worlds that diverge are left out of the result; with `keep_diverged` they stay in it, where
        their physics stopped.
        """
        rollouts = self.play(
            parameters,
            lambda t, _: actions[:, t],
            actions.shape[1],
            rng,
            starts=starts,
            observe=observe,
            is_beginning=is_beginning,
        )
        return rollouts if keep_diverged else rollouts.finished()

    def covers(self, states: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """(n, H, W) bool for (n, S) states: pixels that show no unknown background; here all."""
        return np.ones((len(states), *self.shape), bool)

    def film(self, rollouts: Rollouts, stray: StrayLight | None = None) -> np.ndarray:
        """Draw every state of n episodes: (n, T + 1, H, W, 3) uint8 RGB. `stray`: of n worlds."""
        n, num_frames, size = rollouts.states.shape
        parameters = np.repeat(rollouts.parameters, num_frames, axis=0)
        by_frame = stray and stray.in_frames(num_frames)
        frames = self.render(rollouts.states.reshape(n * num_frames, size), parameters, by_frame)
        return frames.reshape(n, num_frames, *frames.shape[1:])


def random_actions(
    num_episodes: int,
    num_steps: int,
    space: ActionSpace,
    rng: np.random.Generator,
    hold: int = 4,
) -> np.ndarray:
    """(num_episodes, num_steps, A) uniform in the actions' ranges, each held for `hold` steps.

    Held actions move the robot; drawn anew every step, their effects would average out.
    """
    low, high = space.range.T
    drawn = rng.uniform(low, high, (num_episodes, -(-num_steps // hold), len(low)))
    return np.repeat(drawn, hold, axis=1)[:, :num_steps]
