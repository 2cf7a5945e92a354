"""Worlds of a MuJoCo model, in batches."""

import copy
from collections.abc import Callable

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.parameters import ParameterSpace
from simtune.simulation.actions import ActionMapping, DirectActions, MapActions
from simtune.simulation.delays import count_substeps
from simtune.simulation.played import Act, AnySimulator, Played, Record
from simtune.simulation.quality import OPENGL_FAST, OpenGLQuality
from simtune.simulation.renderer import RendererName, make_renderer
from simtune.simulation.worlds import Worlds

_CHUNK = 256  # supersampled pictures drawn at a time
_EXPLORING_SHARE = 0.5  # of random actions, added to a script's


Script = Callable[[Batch], np.ndarray]  # worlds in their present state to (n, A) actions


class Simulator(AnySimulator):
    """Rolls worlds of one model out, and draws their states.

    An action is held for `step_s` seconds; `initialize(batch, rng)` starts the worlds; what actions
    do, `action_mapping` says, which `map_actions` makes for the model. A `script` acts by what only
    a simulator knows.
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
        map_actions: MapActions = DirectActions,
        script: Script | None = None,
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
        self._mapping = map_actions(self.model)
        self.script = script
        self._initialize = initialize
        self._worlds: dict[int, Worlds] = {}

    @property
    def action_mapping(self) -> ActionMapping:
        return self._mapping

    def play(
        self,
        parameters: np.ndarray,
        act: Act,
        num_steps: int,
        rng: np.random.Generator,
        *,
        starts: np.ndarray | None = None,
        watch: Record | None = None,
        watches_per_step: int = 1,
    ) -> Played:
        """Act in n worlds of (n, N) parameters, each from its own start. Nothing else steps any.

        `starts`, (n, S), are states to start from instead of the task's own. `watch(batch)`,
        (n, D), is asked of the first state, and so many times within each step.
        Worlds that diverge are counted in `num_diverged`, and stay where their physics stopped.
        """
        n = len(parameters)
        worlds = self._worlds_for(n)
        if watch:
            watch(worlds.batch)  # binds the fields it reads, so that they are computed
        if starts is None:
            worlds.reset(parameters, self._initialize, rng)
        else:
            worlds.start_from(parameters, starts)
        self.action_mapping.settle(worlds.batch)
        states = np.empty((n, num_steps + 1, worlds.state.shape[1]))
        states[:, 0] = worlds.state
        actions = np.empty((n, num_steps, self.num_actions))
        watched, lengths = [watch(worlds.batch)] if watch else [], np.zeros(n, int)
        # As equal as they can be: at another rate than the task's own they do not divide evenly.
        ends = np.linspace(0, self.num_substeps, watches_per_step + 1).round().astype(int)
        parts = np.diff(ends).tolist()
        for t in range(num_steps):
            actions[:, t] = act(t, worlds.state)
            controls = self.action_mapping.apply(worlds.batch, actions[:, t])
            for substeps in parts:
                if substeps:
                    worlds.step(controls, substeps)
                if watch:
                    watched.append(watch(worlds.batch))
            states[:, t + 1] = worlds.state
            lengths += worlds.alive
        self.num_diverged += int((lengths < num_steps).sum())
        self.num_steps += n * num_steps
        return Played(states, actions, lengths, np.stack(watched, 1) if watch else None)

    def explore(self, num_worlds: int, num_steps: int, rng: np.random.Generator) -> Act:
        """What excites so many worlds: random actions, or the script and half of them on top."""
        at_random = super().explore(num_worlds, num_steps, rng)
        if self.script is None:
            return at_random
        scripted, (low, high) = self.follow_script(num_worlds), self.action_mapping.range.T

        def act(t: int, states: np.ndarray) -> np.ndarray:
            noise = _EXPLORING_SHARE * (at_random(t, states) - (low + high) / 2)
            return np.clip(scripted(t, states) + noise, low, high)

        return act

    def follow_script(self, num_worlds: int) -> Act:
        """What the script does in the worlds that are played at the time."""
        script = self.script
        if script is None:
            raise ValueError("this simulator has no script to follow")
        return lambda t, states: script(self._worlds_for(num_worlds).batch)

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
