"""Simulated worlds one can act in and film: what is asked of a simulator, in two methods."""

import copy
from collections.abc import Callable
from dataclasses import dataclass, field

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.parameters import ParameterSpace
from simtune.simulation.delays import count_substeps
from simtune.simulation.quality import OPENGL_FAST, OpenGLQuality
from simtune.simulation.renderer import RendererName, make_renderer
from simtune.simulation.worlds import Worlds

_CHUNK = 256  # supersampled pictures drawn at a time


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


class Simulator:
    """Rolls worlds of one model out, and draws their states.

    An action is held for `step_s` seconds; `initialize(batch, rng)` starts the worlds.
    With `supersampling` k, k × k points of each pixel are averaged, as a camera's sensor does:
    thin things blend with what is behind them instead of vanishing between the points.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        space: ParameterSpace,
        *,
        camera: str,
        initialize: Callable[[Batch, np.random.Generator], None],
        step_s: float,
        image_size: int,
        renderer: RendererName = "raycaster",
        quality: OpenGLQuality = OPENGL_FAST,
        supersampling: int = 1,
    ):
        self.num_substeps = count_substeps(step_s, model.opt.timestep)
        self.model = _with_timestep(model, step_s / self.num_substeps)
        self.space = space
        self.step_s = step_s
        self.image_size = image_size
        self.num_diverged = 0
        self.num_steps = 0  # policy steps simulated so far
        self.supersampling = supersampling
        drawn_size = image_size * supersampling
        self.renderer = make_renderer(renderer, self.model, space, camera, drawn_size, quality)
        self._initialize = initialize
        self._worlds: dict[int, Worlds] = {}

    @property
    def num_actions(self) -> int:
        return self.model.nu

    @property
    def action_scale(self) -> np.ndarray:
        """(A,) the largest magnitude of each action: 1 where the model sets no limit."""
        limited = np.asarray(self.model.actuator_ctrllimited, bool)
        return np.where(limited, np.abs(self.model.actuator_ctrlrange).max(-1), 1.0)

    def roll_out(
        self,
        parameters: np.ndarray,
        actions: np.ndarray,
        rng: np.random.Generator,
        record: Callable[[Batch], np.ndarray] | None = None,
        starts: np.ndarray | None = None,
        keep_diverged: bool = False,
    ) -> Rollouts:
        """Play (n, T, A) actions in n worlds of (n, N) parameters, each from its own start.

        `record(batch)`, (n, D), is kept of every state, as only a simulator knows it.
        `starts`, (n, S), are states to start from instead of the task's own.
        Worlds that diverge are left out of the result and counted in `num_diverged`; with
        `keep_diverged` they stay in it, where their physics stopped.
        """
        n, num_steps, _ = actions.shape
        worlds = self._worlds_for(n)
        if record:
            record(worlds.batch)  # binds the fields it reads, so that they are computed
        worlds.reset(parameters, self._initialize, rng)
        if starts is not None:
            worlds.start_from(starts)
        states = np.empty((n, num_steps + 1, worlds.state.shape[1]))
        states[:, 0] = worlds.state
        recorded = [record(worlds.batch)] if record else []
        for t in range(num_steps):
            worlds.step(actions[:, t], self.num_substeps)
            states[:, t + 1] = worlds.state
            if record:
                recorded.append(record(worlds.batch))
        alive = worlds.alive
        self.num_diverged += int((~alive).sum())
        self.num_steps += n * num_steps
        if keep_diverged:
            alive = np.ones(n, bool)
        kept = np.stack(recorded, axis=1)[alive] if record else None
        index = np.flatnonzero(alive)
        return Rollouts(parameters[alive], states[alive], actions[alive], kept, index)

    def render(self, states: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """Draw (n, S) states of worlds of (n, N) parameters: (n, H, W, 3) uint8 RGB."""
        if self.supersampling == 1:
            return self.renderer.render(states, parameters)
        size, k = self.image_size, self.supersampling
        frames = np.empty((len(states), size, size, 3), np.uint8)
        for start in range(0, len(states), _CHUNK):  # the large pictures never all at once
            part = slice(start, start + _CHUNK)
            large = self.renderer.render(states[part], parameters[part])
            blocks = large.reshape(-1, size, k, size, k, 3)
            frames[part] = (blocks.sum((2, 4), dtype=np.uint16) + k * k // 2) // (k * k)
        return frames

    def film(self, rollouts: Rollouts) -> np.ndarray:
        """Draw every state of n episodes: (n, T + 1, H, W, 3) uint8 RGB."""
        n, num_frames, _ = rollouts.states.shape
        parameters = np.repeat(rollouts.parameters, num_frames, axis=0)
        frames = self.render(rollouts.states.reshape(n * num_frames, -1), parameters)
        return frames.reshape(n, num_frames, *frames.shape[1:])

    def _worlds_for(self, num_worlds: int) -> Worlds:
        if num_worlds not in self._worlds:
            self._worlds = {num_worlds: Worlds(self.model, self.space, num_worlds)}  # keep one
        return self._worlds[num_worlds]


def _with_timestep(model: mujoco.MjModel, timestep_s: float) -> mujoco.MjModel:
    """The model, or a copy with another timestep where substeps would not add up to a step."""
    if abs(model.opt.timestep / timestep_s - 1) < 1e-6:
        return model
    model = copy.copy(model)
    model.opt.timestep = timestep_s
    return model


def random_actions(
    num_episodes: int,
    num_steps: int,
    model: mujoco.MjModel,
    rng: np.random.Generator,
    hold: int = 4,
) -> np.ndarray:
    """(num_episodes, num_steps, A) uniform in the controls' ranges, each held for `hold` steps.

    Held, they move the robot; drawn anew every step, their effects would average out.
    """
    low, high = np.where(model.actuator_ctrllimited[:, None], model.actuator_ctrlrange, [-1, 1]).T
    drawn = rng.uniform(low, high, (num_episodes, -(-num_steps // hold), model.nu))
    return np.repeat(drawn, hold, axis=1)[:, :num_steps]
