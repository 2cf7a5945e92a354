"""Stretches of episodes, played open loop in simulated worlds.

Only readings are used, never pictures. An episode may be cut into stretches with an initial state
each: a short stretch is nearly linear in the unknowns, the whole episode is what counts in the end.
"""

from collections.abc import Sequence

import mujoco
import numpy as np

from simtune.fit.lateness import Lateness
from simtune.fit.motion.windows import evenly
from simtune.fit.physics import Physics
from simtune.fit.readings.parts import parts_to_play
from simtune.fit.readings.stretches import Readings, Stretches, filled, is_within, velocities
from simtune.fit.readings.tied_joints import follow_measured
from simtune.observation import JointSensor, ObservationModel, joints_of, measured_places
from simtune.parameters.backlash import play_of
from simtune.simulation import AnySimulator, Simulator
from simtune.simulation.loose_objects import loose_joints, loose_places, passive_joints

_VELOCITY_ERROR = 3.0  # std of an initial velocity, in position noise per step
_FAR_AWAY = 1e3  # in units of the model's extent


class OpenLoop:
    """Plays stretches in worlds of one simulator."""

    def __init__(
        self,
        physics: Physics,
        sensors: Sequence[JointSensor],
        fitted: np.ndarray,
        unseen: tuple[str, ...] = (),
        lateness: Lateness | None = None,
    ):
        """`fitted`: (P,) indices of the parameters to differentiate by; `unseen`: see `of`.

        With `lateness` of the readings one more coordinate follows the parameters.
        """
        self.physics, self.sensors, self.fitted = physics, tuple(sensors), fitted
        self.unseen, self.lateness = unseen, lateness
        ends = np.cumsum([0, *(sensor.size for sensor in sensors)]).tolist()
        self.num_readings = ends[-1]  # D
        # Each sensor with its columns of the readings
        self._columns = list(zip(self.sensors, map(slice, ends, ends[1:]), strict=True))
        # (S, nq + nv) directions of an initial state: each measured position, then its velocity
        places, space = measured_places(sensors), physics.space
        tangents = np.zeros((2 * len(places), space.num_tangent))
        model, self._places = physics.simulator.model, np.array(places, int)
        no_contacts = mujoco.mjtDisableBit.mjDSBL_CONTACT.value
        self.may_touch = not model.opt.disableflags & no_contacts  # whether contacts are possible
        self._dofs = np.array(
            [model.jnt_dofadr[list(model.jnt_qposadr).index(p)] for p in places], int
        )
        for i, dof in enumerate(self._dofs):
            tangents[i, dof] = tangents[len(places) + i, space.nv + dof] = 1.0
        self.start_tangents = tangents
        # (nq,) and (nv,) bool: positions and velocities of loose objects, which no sensor reads
        self.is_loose_position, self.is_loose = np.zeros(model.nq, bool), np.zeros(model.nv, bool)
        for joint in loose_joints(model):
            place, dof = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
            self.is_loose_position[place : place + 7] = self.is_loose[dof : dof + 6] = True

    @property
    def knows_all_but_objects(self) -> bool:
        """Whether readings, and what is driven, determine all states but loose objects'.

        Not those of a door or a lid: whatever touches it moves it, and only pictures show that.
        """
        model = self.physics.simulator.model
        measured = model.dof_jntid[self._dofs].tolist()
        known = [*measured, *(play_of(model, joint) for joint in measured)]
        return bool(self.is_loose.any() and np.isin(passive_joints(model), known).all())

    @classmethod
    def of(
        cls, simulator: AnySimulator, observation: ObservationModel, start: np.ndarray
    ) -> "OpenLoop":
        """Replays readings in a simulator; `start`: (N,) parameters of an initial world.

        Positions that no sensor measures begin as in a simulated episode of that world; but objects
        that begin anywhere are put where nothing touches them. Derivatives are by parameters that
        affect motion. `unseen`: joints that begin anywhere and that no sensor measures.
        """
        assert isinstance(simulator, Simulator), "sensors measure a model's joints"
        still, rng = np.zeros((2, 1, simulator.num_actions)), np.random.default_rng(0)
        begun = simulator.roll_out(np.repeat(start[None], 2, 0), still, rng, keep_diverged=True)
        sensors, space = joints_of(observation.sensors), simulator.state_space
        state, another = space.positions_and_velocities(begun.states[:, 0])
        differs = (state != another)[: simulator.model.nq]
        for number, place in enumerate(loose_places(simulator.model)):
            if not np.array_equal(state[place : place + 3], another[place : place + 3]):
                state[place] += (1 + number) * _FAR_AWAY * simulator.model.stat.extent
        full_state = space.with_positions_and_velocities(begun.states[0, 0], state)
        physics = Physics(simulator, observation.observe_beside(), full_state)
        unseen = _unseen(simulator.model, differs, measured_places(sensors))
        return cls(physics, sensors, np.flatnonzero(~simulator.space.is_appearance), unseen)

    def by_starts_alone(self) -> "OpenLoop":
        """The same with derivatives by initial states only."""
        return OpenLoop(self.physics, self.sensors, self.fitted[:0], self.unseen, self.lateness)

    def with_lateness(self) -> "OpenLoop":
        """The same with the lateness of readings as one more unknown, the last."""
        lateness = Lateness.of_readings(self.num_readings, self.physics.simulator.num_substeps)
        fitted = np.append(self.fitted, len(self.physics.parameters))
        return OpenLoop(self.physics, self.sensors, fitted, self.unseen, lateness)

    def moved(self, states: np.ndarray, shift: np.ndarray, start_std: np.ndarray) -> np.ndarray:
        """(W, nq + nv) initial states, moved by `shift` (W, S) times `start_std` (S,)."""
        return self.physics.space.move(states, (shift * start_std) @ self.start_tangents)

    def start_std(self, noise: np.ndarray, values: np.ndarray) -> np.ndarray:
        """(S,) prior std of an initial state, for (W, K + 1, D) readings with noise (D,).

        A jerking servo turns faster within a step than the parabola through its readings says.
        """
        std, bends = np.zeros((2, len(self._places)))
        # Before the first reading and after the last, such as in a padded episode, nothing moves
        known = is_within(values)[:, 2:] & is_within(values)[:, :-2]
        bent = np.square(np.diff(filled(values), 2, axis=1)) * known
        bend = np.sqrt(bent.sum((0, 1)) / np.maximum(known.sum((0, 1)), 1))
        for sensor, columns in self._columns:
            if not sensor.is_velocity:
                places = np.searchsorted(self._places, sensor.places)
                std[places], bends[places] = noise[columns], bend[columns]
        step_s = self.physics.simulator.step_s
        return np.concatenate([std, np.hypot(_VELOCITY_ERROR * std, bends) / step_s])

    def _as_read(self, values: np.ndarray, offsets: np.ndarray) -> np.ndarray:
        """(E, T + 1, nq + nv) states from (E, T + 1, D) readings with offsets (D,).

        Unmeasured positions are those that the model ties to measured ones, or else those at the
        start of a simulated episode.
        """
        states = np.tile(self.physics.some_state, (*values.shape[:2], 1))
        read, nq = filled(values) - offsets, self.physics.space.nq
        step_s = self.physics.simulator.step_s
        # Measured velocities last: they take precedence over differentiated positions
        for sensor, columns in sorted(self._columns, key=lambda part: part[0].is_velocity):
            joint_values = read[..., columns]
            if sensor.is_velocity:
                states[..., nq + sensor.places] = joint_values
                continue
            states[..., sensor.places] = joint_values
            states[..., self._velocities_of(sensor)] = velocities(joint_values) / step_s
        follow_measured(self.physics.simulator.model, states, self._places)
        return states

    def _velocities_of(self, sensor: JointSensor) -> np.ndarray:
        """(J,) indices, in a state, of the velocities of the positions that a sensor reads."""
        dofs = self._dofs[np.searchsorted(self._places, sensor.places)]
        return self.physics.space.nq + dofs

    def corrected(self, states: np.ndarray, change: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """(E, T + 1, nq + nv) states with measured positions changed by `change`, (E, T + 1, D).

        `rate`: (E, T + 1, D), by how much that changes per step, which corrects velocities.
        """
        states, step_s = states.copy(), self.physics.simulator.step_s
        for sensor, columns in self._columns:
            if not sensor.is_velocity:
                states[..., sensor.places] += change[..., columns]
                states[..., self._velocities_of(sensor)] += rate[..., columns] / step_s
        return states

    def _per_step(self, states: np.ndarray) -> np.ndarray:
        """(E, T + 1, 2 nv) change of states per step of lateness of the readings.

        Extrapolated from (E, T + 1, nq + nv) states as read.
        """
        velocities = states[..., self.physics.space.nq :]
        moved = self.physics.simulator.step_s * velocities
        return np.concatenate([moved, np.gradient(velocities, axis=1)], -1)

    def starts_by_shared(self, stretches: Stretches, finds_offset: np.ndarray) -> np.ndarray:
        """(W, P + offsets, S) derivatives of initial states x̄ that readings give.

        By parameters, of which only a lateness matters, and by the offsets of `finds_offset`, (D,)
        bool: x̄ is what was read less the offset.
        """
        num, num_places = len(self.fitted), len(self._places)
        by_offset = np.zeros((self.num_readings, 2 * num_places))
        for sensor, columns in self._columns:
            if not sensor.is_velocity:
                places = np.searchsorted(self._places, sensor.places)
                by_offset[:, places] = 0.0  # of two sensors of a joint, the last one counts
                by_offset[np.arange(columns.start, columns.stop), places] = -1.0
        derived = np.zeros((len(stretches.states), num + finds_offset.sum(), 2 * num_places))
        derived[:, num:] = by_offset[finds_offset]
        if stretches.drift is not None:  # the lateness is the last of the parameters
            derived[:, num - 1] = stretches.drift @ self.start_tangents.T
        return derived

    def cut(
        self, readings: Readings, unit: np.ndarray, offsets: np.ndarray, steps: int, at_most: int
    ) -> Stretches:
        """At most `at_most` stretches of `steps` steps, spread evenly; `unit`: (N,)."""
        states, drift = self._as_read(readings.values, offsets), None
        if self.lateness is not None:
            by_step = self._per_step(states)
            states = self.physics.space.move(states, Lateness.steps(unit[-1]) * by_step)
            drift = Lateness.steps_per_unit() * by_step
        left = self.physics.replay_actuators(readings.actions, states, self._parameters(unit))
        num_steps = readings.actions.shape[1]
        length = min(steps, num_steps)
        starts = np.arange(0, num_steps - length + 1, length)
        episode = np.repeat(np.arange(len(states)), len(starts))
        step = np.tile(starts, len(states))
        known = np.isfinite(readings.values[episode, step]).any(-1) | (step == 0)
        episode, step = episode[known], step[known]
        kept = evenly(len(step), at_most)
        episode, step = episode[kept], step[kept]
        frames = step[:, None] + np.arange(length + 1)
        return Stretches(
            readings.actions[episode[:, None], frames[:, :-1]],
            readings.values[episode[:, None], frames],
            states[episode, step],
            left[episode, step],
            None if drift is None else drift[episode, step],
        )

    def play(
        self, stretches: Stretches, states: np.ndarray, units: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(G, W, K + 1, D) predictions and (G, W, S) first full states.

        From (G, W, nq + nv) initial states, in worlds of (G, N) parameters in unit coordinates.
        Predictions stay where they are long after a stretch's last reading.
        """
        (groups, num, size), lateness = states.shape, self.lateness
        states, units = states.reshape(-1, size), np.repeat(units, num, 0)
        left = stretches.actuator_states
        predicted = np.empty((len(states), *stretches.values.shape[1:]))
        first = np.empty((len(states), left.shape[-1]))
        for part in parts_to_play(stretches.values, groups, left.itemsize * left.shape[-1]):
            worlds, its = part.worlds, part.worlds % num
            full_states, seen = self.physics.play(
                states[worlds],
                self._parameters(units[worlds]),
                stretches.actions[its, : part.steps],
                left[its],
                1 if lateness is None else lateness.predictions_per_step,
            )
            if lateness is not None:
                seen = lateness.seen(seen, units[worlds, -1])
            first[worlds], predicted[worlds, : part.steps + 1] = full_states[:, 0], seen
            predicted[worlds, part.steps + 1 :] = seen[:, -1:]
        by_group = predicted.reshape(groups, num, *predicted.shape[1:])
        return by_group, first.reshape(groups, num, -1)

    def _parameters(self, units: np.ndarray) -> np.ndarray:
        """(..., N) parameters from coordinates that may end with a lateness."""
        return units[..., : len(self.physics.parameters)]


def _unseen(model: mujoco.MjModel, differs: np.ndarray, measured: list[int]) -> tuple[str, ...]:
    """Unmeasured joints whose position (nq,) differs between episodes.

    Without the objects of `loose_joints`.
    """
    differs = differs.copy()
    differs[measured] = False
    for place in loose_places(model):
        differs[place : place + 7] = False
    ends = [*model.jnt_qposadr[1:], model.nq]
    joints = enumerate(zip(model.jnt_qposadr, ends, strict=True))
    return tuple(model.joint(j).name for j, (start, end) in joints if differs[start:end].any())
