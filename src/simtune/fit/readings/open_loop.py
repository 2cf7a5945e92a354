"""Stretches of episodes, played open loop in simulated worlds.

Only readings are used, never pictures. An episode may be cut into stretches with an initial state
each: a short stretch is nearly linear in the unknowns, the whole episode is what counts in the end.
"""

import copy
import math
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from simtune.fit.lateness import STEPS_PER_UNIT, Lateness, steps_late
from simtune.fit.physics import Physics
from simtune.fit.readings.measured_states import MeasuredStates
from simtune.fit.readings.parts import parts_to_play
from simtune.fit.readings.readings import Readings
from simtune.fit.readings.segments import ReadStates, Segments, Stretches
from simtune.fit.readings.unmeasured import carried, play_in_turn
from simtune.observation import (
    JointSensor,
)

_LOOKS_PER_STEP = 4  # for contacts: an impact may be over within a step


@dataclass(frozen=True)
class OpenLoopReplay:
    """Plays stretches of recordings in worlds of one simulator."""

    measured: MeasuredStates
    fitted: np.ndarray  # (P,) indices of the parameters to differentiate by
    # Of the readings; with it, one more coordinate follows the parameters
    lateness: Lateness | None = None
    is_simulated: bool = False  # whether what was read moved with the model's own timestep
    # (nq + nv,) where another episode begins, NaN but for the unseen joints' positions; None: these
    # do not matter
    elsewhere: np.ndarray | None = None

    @property
    def left_out(self) -> tuple[str, ...]:
        """Bodies of objects that begin anywhere, which nothing touches in replays."""
        model, measured = self.physics.simulator.model, self.measured
        places = model.jnt_qposadr
        joints = np.flatnonzero(measured.is_loose_position[places] & ~measured.goes_on[places])
        names = (model.body(model.jnt_bodyid[j]).name or model.joint(j).name for j in joints)
        return tuple(dict.fromkeys(names))

    @property
    def physics(self) -> Physics:
        return self.measured.physics

    @property
    def sensors(self) -> tuple[JointSensor, ...]:
        return self.measured.sensors

    @property
    def unseen(self) -> tuple[str, ...]:
        """Joints that begin anywhere and that no sensor measures, without loose objects'."""
        if self.elsewhere is None:
            return ()
        model = self.physics.simulator.model
        begins, ends = model.jnt_qposadr, [*model.jnt_qposadr[1:], model.nq]
        each = enumerate(zip(begins, ends, strict=True))
        is_unseen = np.isfinite(self.elsewhere)
        return tuple(model.joint(j).name for j, part in each if is_unseen[slice(*part)].any())

    @property
    def unsettled_rows(self) -> int:
        """First rows of an episode in which unknown actions from before it still matter."""
        simulator = self.physics.simulator
        return math.ceil(simulator.held.unsettled_s / simulator.step_s)

    @property
    def may_touch(self) -> bool:
        """Whether contacts are possible."""
        no_contacts = mujoco.mjtDisableBit.mjDSBL_CONTACT.value
        return not self.physics.simulator.model.opt.disableflags & no_contacts

    def touches(self, stretches: Stretches, unit: np.ndarray) -> bool:
        """Whether anything does, or reaches a joint's limit, while stretches are played.

        In a world of (N,) parameters.
        """
        if not self.may_touch:
            return False
        units = np.repeat(self._parameters(unit)[None], len(stretches.states), 0)
        counting = self.physics.observing(lambda batch: batch.ncon[:, None] + batch.nl[:, None])
        states = self.measured.consistent.near(stretches.states, units)
        often = min(_LOOKS_PER_STEP, self.physics.simulator.num_substeps)
        left = stretches.actuator_states
        return bool(counting.play(states, units, stretches.actions, left, often)[1].any())

    def by_starts_alone(self) -> "OpenLoopReplay":
        """The same with derivatives by initial states only."""
        return replace(self, fitted=self.fitted[:0])

    def with_lateness(self) -> "OpenLoopReplay":
        """The same with the lateness of readings as one more unknown, the last."""
        substeps = self.physics.simulator.num_substeps
        lateness = Lateness.of_readings(self.measured.num_readings, substeps)
        fitted = np.append(self.fitted, len(self.physics.parameters))
        return replace(self, fitted=fitted, lateness=lateness)

    def finer(self) -> "OpenLoopReplay | None":
        """The same with half the physics timestep; None: see `Simulator.finer`."""
        if (physics := self.physics.finer()) is None:
            return None
        measured = copy.copy(self.measured)
        measured.physics = physics
        return replace(self, measured=measured)

    def starts_by_shared(self, stretches: Stretches, finds_offset: np.ndarray) -> np.ndarray:
        """(W, P + offsets, S) derivatives of initial states x̄ that readings give.

        By parameters, of which only a lateness matters, and by the offsets of `finds_offset`, (D,)
        bool: x̄ is what was read less the offset.
        """
        num, by_offset = len(self.fitted), self.measured.starts_by_offset()[finds_offset]
        derived = np.zeros((len(stretches.states), num + len(by_offset), by_offset.shape[1]))
        derived[:, num:] = by_offset
        if stretches.drift is not None:  # the lateness is the last of the parameters
            derived[:, num - 1] = stretches.drift @ self.measured.start_tangents.T
        return derived

    def cut(
        self,
        readings: Readings,
        unit: np.ndarray,
        offsets: np.ndarray | float = 0.0,
        segments: Segments | None = None,
        goes_on: bool = False,
    ) -> Stretches:
        """Stretches of these segments, by default whole episodes; `unit`: (N,).

        `offsets`: see `states_of`; `goes_on`: see `Stretches`.
        """
        segments = Segments.evenly(readings) if segments is None else segments
        return self.cut_read(self.states_of(readings, unit, offsets), unit, segments, goes_on)

    def cut_read(
        self, read: ReadStates, unit: np.ndarray, segments: Segments, goes_on: bool = False
    ) -> Stretches:
        """As `cut`, of `states_of` readings in that world."""
        # Else the replay of the part before leads to what was pushed
        if segments.begin.any() and (not goes_on or self.measured.bases):
            read = self.carried(read, unit, segments.begin.max())
        return read.cut(segments, goes_on)

    def states_of(
        self, readings: Readings, unit: np.ndarray, offsets: np.ndarray | float = 0.0
    ) -> ReadStates:
        """States that readings give, in a world of (N,) parameters.

        `offsets`: (D,) measured − simulated, or one of all.
        """
        parameters, drift = self._parameters(unit), None
        states = self.measured.as_read(readings.values, parameters, offsets)
        if self.lateness is not None:
            by_step = self.measured.change_per_late_step(states)
            states = self.physics.space.move(states, steps_late(unit[-1]) * by_step)
            drift = STEPS_PER_UNIT * by_step
        left = self.physics.replay_actuators(readings.actions, states, parameters)
        return ReadStates(readings, states, left, drift, self.measured.of_actions)

    def carried(self, read: ReadStates, unit: np.ndarray, last_row: int) -> ReadStates:
        """With what no sensor measures as it was carried along, to a row; see `unmeasured`."""
        goes_on, parameters = self.measured.goes_on, self._parameters(unit)
        if not goes_on.any():
            return read
        _, states, left, *_ = read
        actions = read.readings.actions[:, :last_row]
        states = carried(self.physics, states, actions, left, parameters, goes_on)
        return read._replace(states=states)

    def play(
        self, stretches: Stretches, states: np.ndarray, units: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(G, W, K + 1, D) predictions and (G, W, S) first full states.

        From (G, W, nq + nv) initial states, in worlds of (G, N) parameters in unit coordinates.
        Predictions stay where they are long after a stretch's last reading. If stretches go on,
        what was pushed begins where the stretch before leads to.
        """
        if stretches.goes_on and self.measured.pushed.any():
            return play_in_turn(self.play_apart, stretches, states, units, self.measured.pushed)
        return self.play_apart(stretches, states, units)[:2]

    def play_apart(
        self,
        stretches: Stretches,
        states: np.ndarray,
        units: np.ndarray,
        until: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As `play` for stretches that begin on their own.

        Also (G, W, nq + nv) states after `until` steps, (W,), by default none.
        """
        until = np.zeros(states.shape[1], int) if until is None else until
        (groups, num, size), lateness = states.shape, self.lateness
        states, units = states.reshape(-1, size), np.repeat(units, num, 0)
        states = self.measured.consistent.near(states, self._parameters(units))
        left = stretches.actuator_states
        predicted = np.empty((len(states), *stretches.values.shape[1:]))
        first, then = np.empty((len(states), left.shape[-1])), np.empty_like(states)
        played = stretches.values.copy()
        played[np.arange(num), until] = 0.0  # at least so far
        for part in parts_to_play(played, groups, left.itemsize * left.shape[-1]):
            worlds, its = part.worlds, part.worlds % num
            full_states, seen = self.physics.play(
                states[worlds],
                self._parameters(units[worlds]),
                stretches.actions[its, : part.steps],
                left[its],
                1 if lateness is None else lateness.predictions_per_step,
            )
            if lateness is not None:
                seen = lateness.seen(seen, units[worlds, -1:])
            first[worlds], predicted[worlds, : part.steps + 1] = full_states[:, 0], seen
            then[worlds] = self.physics.states(full_states[np.arange(len(its)), until[its]])
            predicted[worlds, part.steps + 1 :] = seen[:, -1:]
        by_group = predicted.reshape(groups, num, *predicted.shape[1:])
        return by_group, first.reshape(groups, num, -1), then.reshape(groups, num, -1)

    def _parameters(self, units: np.ndarray) -> np.ndarray:
        """(..., N) parameters from coordinates that may end with a lateness."""
        return units[..., : len(self.physics.parameters)]
