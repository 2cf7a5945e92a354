"""Physics as a fit asks for it: states and parameters in, states and keypoints out."""

import numpy as np

from simtune.simulation import Simulator
from simtune.simulation.states import StateSpace
from simtune.vision.keypoints import Keypoints

_NOWHERE_PX = -1e3  # keypoints of a world that diverged


class Physics:
    """Of one simulator, its states as positions and velocities, its parameters as coordinates."""

    def __init__(self, simulator: Simulator, keypoints: Keypoints, row: np.ndarray):
        """`row`: (S,) any state; of it is what is neither position nor velocity, nor acted upon."""
        self.space, self.parameters = StateSpace(simulator.model), simulator.space
        self._simulator, self._keypoints, self._row = simulator, keypoints, row
        self._rng = np.random.default_rng(0)  # starts are given, or make no difference

    def play(
        self,
        states: np.ndarray,
        units: np.ndarray,
        actions: np.ndarray,
        actuator_state: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """(n, T + 1, S) rows and (n, T + 1, L, 2) keypoints of n worlds.

        They begin in (n, nq + nv) states, have (n, N) parameters in unit coordinates and play
        (n, T, A) actions. `acted`: (n, S) of `after`, where actions came before. A world that
        diverges stays where it does.
        """
        rows = (
            np.repeat(self._row[None], len(states), 0)
            if actuator_state is None
            else actuator_state.copy()
        )
        rows[:, 1 : 1 + states.shape[1]] = states
        played = self._simulator.roll_out(
            self.parameters.from_unit(units),
            actions,
            self._rng,
            self._keypoints.record,
            rows,
            keep_diverged=True,
        )
        assert played.recorded is not None, "asked for above"
        seen = played.recorded.reshape(*played.recorded.shape[:2], -1, 2)
        return played.states, np.nan_to_num(seen, nan=_NOWHERE_PX)

    def after(self, actions: np.ndarray, states: np.ndarray, unit: np.ndarray) -> np.ndarray:
        """(E, T + 1, S) rows with all that (E, T, A) actions leave behind but the motion.

        Controls that are still to come, of an actuator with a delay, and how far filters and
        muscles have followed, in worlds of the (N,) parameters in unit coordinates. Where actions
        are relative, that depends on the motion, too: on a guess at the (E, T + 1, nq + nv) states.
        """
        num_episodes, num_steps, _ = actions.shape
        model, simulator = self._simulator.model, self._simulator
        if not model.na and not model.nhistory:
            return np.broadcast_to(self._row, (num_episodes, num_steps + 1, len(self._row)))
        worlds = np.repeat(self.parameters.from_unit(unit)[None], num_episodes, 0)
        if not simulator.action_mapping.is_relative:
            return simulator.roll_out(worlds, actions, self._rng, keep_diverged=True).states
        rows = [np.repeat(self._row[None], num_episodes, 0)]
        for t in range(num_steps):
            rows[t][:, 1 : 1 + states.shape[-1]] = states[:, t]
            step = actions[:, t : t + 1]
            played = simulator.roll_out(worlds, step, self._rng, starts=rows[t], keep_diverged=True)
            rows.append(played.states[:, -1].copy())
        return np.stack(rows, 1)

    @property
    def some_state(self) -> np.ndarray:
        """(nq + nv,)"""
        return self.states(self._row)

    def states(self, rows: np.ndarray) -> np.ndarray:
        """(..., nq + nv) positions and velocities of (..., S) rows."""
        return rows[..., 1 : 1 + self.space.nq + self.space.nv]
