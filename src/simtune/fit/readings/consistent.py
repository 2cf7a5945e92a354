"""Initial states that agree with what a model ties together."""

from collections.abc import Iterator

import mujoco
import numpy as np

from simtune.fit.readings.closed_loops import ClosedLoops
from simtune.fit.readings.tied_joints import follow_measured
from simtune.parameters import ModelWriter
from simtune.simulation import Simulator
from simtune.simulation.ties import joint_ties

# What places joints and bodies; all else leaves ties as they are
_OF_JOINTS = ("qpos0", "jnt_pos", "jnt_axis")
_PLACING = (*_OF_JOINTS, "body_pos", "body_quat", "site_pos", "site_quat", "eq_data")


class ConsistentStates:
    """States with unmeasured joints where equalities tie them to measured ones.

    Else MuJoCo would pull both together within a few steps, to a place between. Parameters may
    change a tie, such as the pose that it is relative to or a link's length: so worlds have states
    of their own.
    """

    def __init__(self, simulator: Simulator, places: np.ndarray, dofs: np.ndarray):
        """`places`, `dofs`: indices of measured positions and of their velocities."""
        self._space, self._places = simulator.space, places
        self._loops = ClosedLoops(simulator.model, places, dofs)
        self._model = self._loops.model
        self._is_any = bool(self._loops or joint_ties(self._model))
        self._placing = np.flatnonzero([p.field in _PLACING for p in simulator.space])
        self._writer = ModelWriter(simulator.space, self._model) if self._placing.size else None

    @property
    def placed_joints(self) -> list[int]:
        """Unmeasured joints that closed loops place."""
        return self._loops.placed_joints

    def following(self, states: np.ndarray, unit: np.ndarray, begun: np.ndarray) -> np.ndarray:
        """(E, T, nq + nv) states of episodes, each following the last one; the first, `begun`.

        In a world of (N,) parameters in unit coordinates.
        """
        if not self._is_any:
            return states
        states, model = states.copy(), self._written(unit)
        follow_measured(model, states, self._places)
        if self._loops:
            self._loops.follow(states, begun)
        return states

    def near(self, states: np.ndarray, units: np.ndarray) -> np.ndarray:
        """(n, nq + nv) states that are near consistent ones, in worlds of (n, N) parameters."""
        if not self._is_any:
            return states
        states = states.copy()
        for its, model in self._worlds(units):
            some = states[its]
            follow_measured(model, some, self._places)
            if self._loops:
                self._loops.close(some)
            states[its] = some
        return states

    def _worlds(self, units: np.ndarray) -> Iterator[tuple[np.ndarray, mujoco.MjModel]]:
        """Indices of worlds whose ties are alike, and a model of these."""
        if not self._placing.size:
            yield np.arange(len(units)), self._model
            return
        _, first, number = np.unique(
            units[:, self._placing], axis=0, return_index=True, return_inverse=True
        )
        for i, at in enumerate(first):
            yield np.flatnonzero(number.ravel() == i), self._written(units[at])

    def _written(self, unit: np.ndarray) -> mujoco.MjModel:
        """The model of (N,) parameters in unit coordinates."""
        if self._writer is not None:
            self._writer.write(self._model, self._space.from_unit(unit))
        return self._model
