"""Worlds of a MuJoCo model, in batches."""

import copy

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.simulation.actions import ActionMapping
from simtune.simulation.any_simulator import Act, AnySimulator, Observe, Rollouts
from simtune.simulation.delays import count_substeps
from simtune.simulation.held_controls import HeldControls
from simtune.simulation.rendering.picture_settings import PictureSettings
from simtune.simulation.rendering.renderers import Renderers
from simtune.simulation.rendering.stray_light import StrayLight
from simtune.simulation.scene import Scene
from simtune.simulation.states import StateSpace
from simtune.simulation.worlds import Worlds

_BATCHES_KEPT = 2  # a fit alternates between many worlds for derivatives and a few for trials
_NO_CONTACT_GAP_M = 1e10  # pushes nothing, at any depth
_EXPLORING_SHARE = 0.5  # of random actions, added to a script's


class Simulator(AnySimulator):
    """Plays worlds of one model, and draws their states."""

    def __init__(self, scene: Scene, pictures: PictureSettings):
        """Raises InputError for what `Renderers` or the scene's action mapping refuses."""
        self.num_substeps = count_substeps(scene.step_s, scene.model.opt.timestep)
        self.model = _with_timestep(scene.model, scene.step_s / self.num_substeps)
        self.space = scene.space
        self.step_s = scene.step_s
        self.script = scene.script
        self.image_size = pictures.image_size
        self.supersampling = pictures.supersampling
        self.views = pictures.views
        self.held = HeldControls(self.model)
        self._renderers = Renderers(self.model, scene.space, pictures)
        self._mapping = scene.map_actions(self.model)
        self._state_space = StateSpace(self.model)
        self._initialize = scene.initialize
        self._worlds: dict[int, Worlds] = {}
        self._refined = 1  # physics steps in place of one
        self._counting: AnySimulator = self  # where steps are counted

    @property
    def action_mapping(self) -> ActionMapping:
        """The available actions, and their effects."""
        return self._mapping

    @property
    def state_space(self) -> StateSpace:
        """Layout of states."""
        return self._state_space

    def play(
        self,
        parameters: np.ndarray,
        act: Act,
        num_steps: int,
        rng: np.random.Generator,
        *,
        starts: np.ndarray | None = None,
        observe: Observe | None = None,
        observations_per_step: int = 1,
        is_beginning: bool | None = None,
        counts: bool = True,
    ) -> Rollouts:
        """Act in n worlds of (n, N) parameters, each from its own start; not reentrant.

        `starts`, (n, S), are states to start from instead of the task's own. `observe(batch)`,
        (n, D), is called in the first state, and `observations_per_step` times within each step.
        `is_beginning`: an episode begins, before which servos held their first control; by default
        true for the task's own starts, while given ones include what actuators remember. Worlds
        that diverge are counted in `num_diverged`, and stay where their physics stopped. Steps are
        counted in `num_steps` if it `counts`.
        """
        n, observe = len(parameters), observe or _nothing
        worlds = self._start(parameters, rng, starts, observe)
        begins = starts is None if is_beginning is None else is_beginning
        states = np.empty((n, num_steps + 1, worlds.state.shape[1]))
        states[:, 0] = worlds.state
        actions = np.empty((n, num_steps, self.num_actions))
        observed, lengths = [observe(worlds.batch)], np.zeros(n, int)
        parts = self._parts_of_step(observations_per_step)
        for t in range(num_steps):
            actions[:, t] = act(t, worlds.state)
            controls = self.action_mapping.apply(worlds.batch, actions[:, t])
            if t == 0 and begins:
                self.held.settle(worlds.batch, controls)
                remembered = self.state_space.remembered
                states[:, 0, remembered] = worlds.state[:, remembered]
            for substeps in parts:
                if substeps:
                    worlds.step(controls, substeps)
                observed.append(observe(worlds.batch))
            states[:, t + 1] = worlds.state
            lengths += worlds.alive
        self._counting.num_diverged += int((lengths < num_steps).sum())
        self._counting.num_steps += n * num_steps * counts
        return Rollouts(parameters, states, actions, lengths, np.stack(observed, 1), np.arange(n))

    def without_contacts(self, bodies: np.ndarray) -> "Simulator":
        """The same, in which (nbody,) bool bodies touch nothing; its steps are counted here."""
        other = copy.copy(self)
        other.model, other._worlds = copy.copy(self.model), {}
        model, geoms = other.model, bodies[other.model.geom_bodyid]
        model.geom_contype[geoms] = model.geom_conaffinity[geoms] = 0
        pairs = geoms[model.pair_geom1] | geoms[model.pair_geom2]  # which these do not filter
        model.pair_margin[pairs], model.pair_gap[pairs] = -_NO_CONTACT_GAP_M, _NO_CONTACT_GAP_M
        return other

    def with_running_motors(self) -> "Simulator":
        """The same, but motors had long been at their first control when an episode begins."""
        other = copy.copy(self)
        other.held = HeldControls(self.model, motors_ran=True)
        return other

    def finer(self) -> "Simulator | None":
        """The same with half the physics timestep, observed at the same times.

        None if actuators remember controls, which they do by physics steps.
        """
        if self.model.nhistory:
            return None
        other = copy.copy(self)
        other.model, other._worlds = copy.copy(self.model), {}
        other.model.opt.timestep /= 2
        other.num_substeps, other._refined = 2 * self.num_substeps, 2 * self._refined
        return other

    def begin(
        self,
        parameters: np.ndarray,
        rng: np.random.Generator,
        *,
        starts: np.ndarray | None = None,
        observe: Observe | None = None,
    ) -> Rollouts:
        """The first states of n worlds of (n, N) parameters, before any action; see `play`."""
        return self.play(parameters, _never, 0, rng, starts=starts, observe=observe)

    def _start(
        self,
        parameters: np.ndarray,
        rng: np.random.Generator,
        starts: np.ndarray | None,
        observe: Observe,
    ) -> Worlds:
        """Worlds of (n, N) parameters in their first states."""
        worlds = self._worlds_for(len(parameters))
        for reads in (observe, self.held.holding):
            reads(worlds.batch)  # binds the fields it reads, so that they are computed

        def put(batch: Batch, _: np.random.Generator) -> None:
            batch.state[...] = starts

        worlds.reset(parameters, self._initialize if starts is None else put, rng)
        self.action_mapping.settle(worlds.batch)
        return worlds

    def _parts_of_step(self, num: int) -> list[int]:
        """Substeps of `num` parts of a policy step, as equal as whole numbers can be.

        At another rate than the task's own they do not divide evenly.
        """
        ends = np.linspace(0, self.num_substeps // self._refined, num + 1).round().astype(int)
        return (np.diff(ends) * self._refined).tolist()

    def explore(self, num_worlds: int, num_steps: int, rng: np.random.Generator) -> Act:
        """Random actions that excite `num_worlds` worlds; half as large on top of a script."""
        at_random = super().explore(num_worlds, num_steps, rng)
        if self.script is None:
            return at_random
        scripted, (low, high) = self.follow_script(num_worlds), self.action_mapping.range.T

        def act(t: int, states: np.ndarray) -> np.ndarray:
            noise = _EXPLORING_SHARE * (at_random(t, states) - (low + high) / 2)
            return np.clip(scripted(t, states) + noise, low, high)

        return act

    def follow_script(self, num_worlds: int) -> Act:
        """The script's actions in the `num_worlds` worlds that are being played.

        Raises ValueError if there is no script.
        """
        script = self.script
        if script is None:
            raise ValueError("this simulator has no script to follow")
        return lambda t, states: script(self._worlds_for(num_worlds).batch)

    def render(
        self, states: np.ndarray, parameters: np.ndarray, stray: StrayLight | None = None
    ) -> np.ndarray:
        """Draw (n, S) states of worlds of (n, N) parameters: (n, H, W, 3) uint8 RGB.

        Raises ValueError if there is no camera.
        """
        return self._renderers.render(states, parameters, stray)

    def covers(self, states: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """(n, H, W) bool for (n, S) states of worlds of (n, N) parameters; see `AnySimulator`."""
        return self._renderers.covers(states, parameters)

    def _worlds_for(self, num_worlds: int) -> Worlds:
        if num_worlds not in self._worlds:
            if len(self._worlds) == _BATCHES_KEPT:
                self._worlds.pop(next(iter(self._worlds)))
            self._worlds[num_worlds] = Worlds(self.model, self.space, num_worlds)
        return self._worlds[num_worlds]


def _never(t: int, states: np.ndarray) -> np.ndarray:
    """What acts in worlds that are not stepped."""
    raise AssertionError("there are no steps")


def _nothing(batch: Batch) -> np.ndarray:
    """(n, 0): observes nothing of n worlds."""
    return np.empty((batch.nsim, 0))


def _with_timestep(model: mujoco.MjModel, timestep_s: float) -> mujoco.MjModel:
    """The model, or a copy with another timestep if substeps would not add up to a step."""
    if abs(model.opt.timestep / timestep_s - 1) < 1e-6:
        return model
    model = copy.copy(model)
    model.opt.timestep = timestep_s
    return model
