"""Physics for fits: states and parameters in, states and predictions out."""

import copy
from collections.abc import Callable
from typing import Any

import numpy as np

from simtune.budget import NO_LIMIT, Budget
from simtune.simulation import Simulator, StateSpace
from simtune.simulation.held_controls import given

# What a diverged world predicts, in any unit; no joint that turns on and on reads just this
_DIVERGED_READING = -1e3 - 1 / 7
_ROUNDING = 1e-9  # relative, of interpolations


def is_lost(predicted: np.ndarray) -> np.ndarray:
    """(...) bool of (..., K, D) predictions: whether the world diverged within the K steps."""
    return np.any(np.isclose(predicted, _DIVERGED_READING, _ROUNDING, 0.0).all(-1), axis=-1)


class Physics:
    """One simulator, with states as positions and velocities and parameters as unit coordinates."""

    def __init__(
        self,
        simulator: Simulator,
        observe: Callable[[Any], np.ndarray],
        full_state: np.ndarray,
    ):
        """`observe(batch)`, (n, D): what the sensors would measure.

        `full_state`: (S,) any state (mjSTATE_INTEGRATION), which supplies everything except
        positions, velocities and what actions leave behind.
        """
        self.simulator, self._observe, self._full_state = simulator, observe, full_state
        self.space, self.parameters = StateSpace(simulator.model), simulator.space
        self._rng = np.random.default_rng(0)  # starts are given, or do not matter
        self._budget = NO_LIMIT
        self._left: tuple[bytes, np.ndarray] | None = None  # see `_left_by_controls`

    def within(self, budget: Budget) -> "Physics":
        """The same, but `play` and `render` raise OutOfTime once `budget` is over."""
        physics = copy.copy(self)
        physics._budget = budget
        return physics

    def observing(self, observe: Callable[[Any], np.ndarray]) -> "Physics":
        """The same with other predictions; see `__init__`."""
        physics = copy.copy(self)
        physics._observe = observe
        return physics

    def finer(self) -> "Physics | None":
        """The same with half the physics timestep; None: see `Simulator.finer`."""
        if (simulator := self.simulator.finer()) is None:
            return None
        physics = copy.copy(self)
        physics.simulator, physics._left = simulator, None
        return physics

    def play(
        self,
        states: np.ndarray,
        units: np.ndarray,
        actions: np.ndarray,
        actuator_states: np.ndarray | None = None,
        predictions_per_step: int = 1,
    ) -> tuple[np.ndarray, np.ndarray]:
        """(n, T + 1, S) full states and (n, M, D) predictions of n worlds, M = T + 1 or more.

        They begin in (n, nq + nv) states, have (n, N) parameters in unit coordinates and play
        (n, T, A) actions. `actuator_states`: (n, S) of `replay_actuators`, if there were earlier
        actions. There are T times `predictions_per_step` predictions after the first one. A world
        that diverges keeps the states where its physics stopped, and from that step on it predicts
        what `is_lost` recognises. Raises OutOfTime; see `within`.
        """
        self._budget.check()
        starts = self._full_state if actuator_states is None else actuator_states
        played = self.simulator.play(
            self.parameters.from_unit(units),
            lambda t, _: actions[:, t],
            actions.shape[1],
            self._rng,
            starts=self.space.with_positions_and_velocities(starts, states),
            observe=self._observe,
            observations_per_step=predictions_per_step,
        )
        predicted = np.nan_to_num(played.observed, nan=_DIVERGED_READING)
        for world in np.flatnonzero(played.lengths < actions.shape[1]):
            # MuJoCo stops at huge numbers more often than at NaN
            first = 1 + played.lengths[world] * predictions_per_step
            predicted[world, first:] = _DIVERGED_READING
        return played.states, predicted

    def predict(self, states: np.ndarray, unit: np.ndarray) -> np.ndarray:
        """(n, D) predictions of (n, nq + nv) states, in a world of (N,) parameters."""
        units = np.repeat(unit[None], len(states), 0)
        at_once = np.zeros((len(states), 0, self.simulator.num_actions))
        return self.play(states, units, at_once)[1][:, 0]

    def render(self, full_states: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """As `Simulator.render`; raises OutOfTime, see `within`."""
        self._budget.check()
        return self.simulator.render(full_states, parameters)

    @property
    def remembers_actions(self) -> bool:
        """Whether earlier actions leave something behind, as in motors that lag."""
        return bool(self.simulator.model.na or self.simulator.model.nhistory)

    def replay_actuators(
        self, actions: np.ndarray, states: np.ndarray, unit: np.ndarray
    ) -> np.ndarray:
        """(E, T + 1, S) full states with all that (E, T, A) actions leave behind except the motion.

        That is delayed controls, and the states of filters and muscles, in worlds of the (N,)
        parameters in unit coordinates. If actions are relative, or integrated from where a joint
        begins, or actuators remember the motion (a <pid>'s error, a <dcmotor>'s current), they also
        depend on the motion, for which (E, T + 1, nq + nv) guesses at the states are used.
        """
        num_episodes, num_steps, _ = actions.shape
        simulator = self.simulator
        if not self.remembers_actions:
            shape = (num_episodes, num_steps + 1, len(self._full_state))
            return np.broadcast_to(self._full_state, shape)
        worlds = np.repeat(self.parameters.from_unit(unit)[None], num_episodes, 0)
        if not simulator.action_mapping.is_relative and not simulator.held.is_of_motion:
            return self._left_by_controls(actions, worlds)
        full_states = [self._begun(states[:, 0], worlds)]
        for t in range(num_steps):
            now = self.space.with_positions_and_velocities(full_states[t], states[:, t])
            step = actions[:, t]
            played = simulator.play(
                worlds,
                lambda *_, step=step: step,
                1,
                self._rng,
                starts=now,
                is_beginning=t == 0,
            )
            full_states[t] = played.states[:, 0].copy()
            full_states.append(played.states[:, -1].copy())
        return np.stack(full_states, 1)

    def _left_by_controls(self, actions: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """`replay_actuators` where the motion does not matter; the last answer is kept.

        Whoever tries other delays or readings asks it of the same actions again.
        """
        asked = actions.tobytes() + worlds.tobytes()
        if self._left is None or self._left[0] != asked:
            played = self.simulator.roll_out(worlds, actions, self._rng, keep_diverged=True)
            played.states.setflags(write=False)
            self._left = asked, played.states
        return self._left[1]

    def _begun(self, states: np.ndarray, worlds: np.ndarray) -> np.ndarray:
        """(E, S) full states before any action, of (E, nq + nv) states in (E, N) worlds.

        What integrates a velocity goes with its joint.
        """
        simulator, begun, held = self.simulator, self.full_states(states), self.simulator.held
        if not held.integrated.size:
            return begun
        integrated = simulator.state_space.remembered.start + held.integrated
        own = simulator.begin(worlds, self._rng, observe=held.holding)
        there = simulator.begin(worlds, self._rng, starts=begun, observe=held.holding)
        activations = own.states[:, 0, integrated]
        moved = activations + there.observed[:, 0] - own.observed[:, 0]
        begun[:, integrated] = np.where(given(activations), moved, 0)  # 0: settles by itself
        return begun

    @property
    def some_state(self) -> np.ndarray:
        """(nq + nv,)"""
        return self.states(self._full_state)

    def full_states(self, states: np.ndarray) -> np.ndarray:
        """(..., S) full states of (..., nq + nv), before any action."""
        return self.space.with_positions_and_velocities(self._full_state, states)

    def states(self, full_states: np.ndarray) -> np.ndarray:
        """(..., nq + nv) positions and velocities of (..., S) full states."""
        return self.space.positions_and_velocities(full_states)
