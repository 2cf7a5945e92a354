"""What is asked of any simulator: to play worlds, to draw their states; and what comes of it."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from simtune.parameters import ParameterSpace
from simtune.simulation.actions import ActionSpace, DirectActions

# Of what a simulator knows of a state, (n, D): a Batch of worlds, or an environment's points
Record = Callable[[Any], np.ndarray]
Act = Callable[[int, np.ndarray], np.ndarray]  # step t and (n, S) states to (n, A) actions


@dataclass(frozen=True)
class Played:
    """What came of acting in n worlds for T steps."""

    states: np.ndarray  # (n, T + 1, S) rows that a renderer draws
    actions: np.ndarray  # (n, T, A)
    lengths: np.ndarray  # (n,) steps after which the physics was still finite
    watched: np.ndarray | None  # (n, 1 + T·watches_per_step, D)

    def episodes(self, parameters: np.ndarray, keep_diverged: bool = False) -> "Rollouts":
        """As episodes of worlds of (n, N) parameters; those that diverged only where asked for."""
        kept = self.lengths == self.actions.shape[1]
        if keep_diverged:
            kept[:] = True
        watched = None if self.watched is None else self.watched[kept]
        index = np.flatnonzero(kept)
        return Rollouts(parameters[kept], self.states[kept], self.actions[kept], watched, index)


@dataclass(frozen=True)
class Rollouts:
    """n simulated episodes, of worlds whose physics stayed finite."""

    parameters: np.ndarray  # (n, N) of each episode's world
    states: np.ndarray  # (n, T + 1, S) rows that a renderer draws
    actions: np.ndarray  # (n, T, A)
    recorded: np.ndarray | None = None  # (n, T + 1, D) of `record`, where asked for
    index: np.ndarray = field(default_factory=lambda: np.empty(0, int))  # (n,) of those asked for

    def __len__(self) -> int:
        return len(self.states)


class AnySimulator(ABC):
    """Worlds of any kind: a model's (`Simulator`), or an environment's."""

    space: ParameterSpace
    step_s: float  # for which an action is held
    image_size: int  # pixels a side
    supersampling: int  # k × k points of each pixel are averaged
    num_steps: int  # policy steps simulated so far
    num_diverged: int  # worlds that ended before their time

    @property
    @abstractmethod
    def action_mapping(self) -> ActionSpace:
        """What actions there are, and for a model what they do."""

    @abstractmethod
    def play(
        self,
        parameters: np.ndarray,
        act: Act,
        num_steps: int,
        rng: np.random.Generator,
        *,
        starts: np.ndarray | None = None,
        watch: Record | None = None,
    ) -> Played:
        """Act in n worlds of (n, N) parameters, each from its own start.

        `starts`, (n, S), are states to start from instead. `watch` is asked of every state.
        """

    @abstractmethod
    def render(self, states: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """Draw (n, S) states of worlds of (n, N) parameters: (n, H, W, 3) uint8 RGB."""

    def explore(self, num_worlds: int, num_steps: int, rng: np.random.Generator) -> Act:
        """What excites so many worlds: random actions."""
        drawn = random_actions(num_worlds, num_steps, self.action_mapping, rng)
        return lambda t, _: drawn[:, t]

    @property
    def num_actions(self) -> int:
        return len(self.action_mapping.names)

    @property
    def action_scale(self) -> np.ndarray:
        """(A,) the largest magnitude of each action: 1 where there is no limit."""
        return np.abs(self.action_mapping.range).max(-1)

    def roll_out(
        self,
        parameters: np.ndarray,
        actions: np.ndarray,
        rng: np.random.Generator,
        record: Record | None = None,
        starts: np.ndarray | None = None,
        keep_diverged: bool = False,
    ) -> Rollouts:
        """Play (n, T, A) actions in n worlds of (n, N) parameters, each from its own start.

        What `record` says, (n, D), is kept of every state, as only a simulator knows it.
        Worlds that diverge are left out of the result; with `keep_diverged` they stay in it,
        where their physics stopped. See `play`.
        """
        num_steps = actions.shape[1]
        played = self.play(
            parameters, lambda t, _: actions[:, t], num_steps, rng, starts=starts, watch=record
        )
        return played.episodes(parameters, keep_diverged)

    def film(self, rollouts: Rollouts) -> np.ndarray:
        """Draw every state of n episodes: (n, T + 1, H, W, 3) uint8 RGB."""
        n, num_frames, size = rollouts.states.shape
        parameters = np.repeat(rollouts.parameters, num_frames, axis=0)
        frames = self.render(rollouts.states.reshape(n * num_frames, size), parameters)
        return frames.reshape(n, num_frames, *frames.shape[1:])


def random_actions(
    num_episodes: int,
    num_steps: int,
    of: ActionSpace | mujoco.MjModel,
    rng: np.random.Generator,
    hold: int = 4,
) -> np.ndarray:
    """(num_episodes, num_steps, A) uniform in the actions' ranges, each held for `hold` steps.

    `of`: what actions there are, or a model whose controls they are. Held, they move the robot;
    drawn anew every step, their effects would average out.
    """
    low, high = (DirectActions(of) if isinstance(of, mujoco.MjModel) else of).range.T
    drawn = rng.uniform(low, high, (num_episodes, -(-num_steps // hold), len(low)))
    return np.repeat(drawn, hold, axis=1)[:, :num_steps]
