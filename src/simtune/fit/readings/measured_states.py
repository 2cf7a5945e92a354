"""What joint readings say of a simulator's states."""

from collections.abc import Collection, Sequence

import numpy as np

from simtune.fit.physics import Physics
from simtune.fit.readings.bases import Bases
from simtune.fit.readings.consistent import ConsistentStates
from simtune.fit.readings.readings import filled, is_within, moving_from_the_start, velocities
from simtune.fit.readings.segments import Stretches
from simtune.fit.readings.unmeasured import what_goes_on
from simtune.observation import JointSensor, measured_places
from simtune.parameters.backlash_joints import play_of
from simtune.simulation.loose_objects import gliding_joints, loose_joints, passive_joints

_VELOCITY_ERROR = 3.0  # std of an initial velocity, in position noise per step


class MeasuredStates:
    """States as joint sensors read them: which parts, how well, and how they change."""

    def __init__(
        self, physics: Physics, sensors: Sequence[JointSensor], untouched: Collection[int] = ()
    ):
        """`untouched`: joints of objects that nothing can touch."""
        self.physics, self.sensors = physics, tuple(sensors)
        ends = np.cumsum([0, *(sensor.size for sensor in sensors)]).tolist()
        self.num_readings = ends[-1]  # D
        # Each sensor with its columns of the readings
        self._columns = list(zip(self.sensors, map(slice, ends, ends[1:]), strict=True))
        places, space = measured_places(sensors), physics.space
        tangents = np.zeros((2 * len(places), space.num_tangent))
        model, self._places = physics.simulator.model, np.array(places, int)
        self._dofs = np.array(
            [model.jnt_dofadr[list(model.jnt_qposadr).index(p)] for p in places], int
        )
        for i, dof in enumerate(self._dofs):
            tangents[i, dof] = tangents[len(places) + i, space.nv + dof] = 1.0
        self.goes_on = what_goes_on(model, sensors, untouched)  # (nq + nv,) bool
        self.bases = Bases(physics.simulator, sensors, self.goes_on, physics.some_state)
        self.pushed = self.goes_on & ~self.bases.parts  # (nq + nv,) bool: by a robot
        # (S, 2 nv) directions of an initial state: each measured position, then its velocity, then
        # what is unknown of bases
        self.start_tangents = np.concatenate([tangents, self.bases.tangents])
        self.consistent = ConsistentStates(physics.simulator, self._places, self._dofs)
        # (nq,) and (nv,) bool: positions and velocities of loose objects, which no sensor reads
        self.is_loose_position, self.is_loose = np.zeros(model.nq, bool), np.zeros(model.nv, bool)
        for joint in loose_joints(model):
            place, dof = model.jnt_qposadr[joint], model.jnt_dofadr[joint]
            self.is_loose_position[place : place + 7] = self.is_loose[dof : dof + 6] = True
        self.gliding = gliding_joints(model, places)
        self.is_loose_position[model.jnt_qposadr[self.gliding]] = True
        self.is_loose[model.jnt_dofadr[self.gliding]] = True

    @property
    def num_places(self) -> int:
        """Of measured positions."""
        return len(self._places)

    @property
    def tells_places(self) -> np.ndarray:
        """(D,) bool: readings of positions, and of speeds of joints whose positions none reads."""
        speeds = [s.places if s.is_velocity else np.full(s.size, -1) for s in self.sensors]
        return ~np.isin(np.concatenate(speeds), self._dofs) & ~self.of_actions

    @property
    def of_actions(self) -> np.ndarray:
        """(D,) bool: torques, which say nothing of states."""
        return np.repeat([s.is_torque for s in self.sensors], [s.size for s in self.sensors])

    @property
    def knows_all_but_objects(self) -> bool:
        """Whether there are loose objects, and readings determine all else that moves."""
        return bool(self.is_loose.any()) and self.knows_robot

    @property
    def knows_robot(self) -> bool:
        """Whether readings, and what is driven, determine all states but loose objects'.

        Not those of a door or a lid: whatever touches it moves it, and only pictures show that.
        """
        model = self.physics.simulator.model
        measured = model.dof_jntid[self._dofs].tolist()
        known = [*measured, *(play_of(model, joint) for joint in measured), *self.gliding]
        known += self.consistent.placed_joints
        return bool(np.isin(passive_joints(model), known).all())

    def as_read(
        self, values: np.ndarray, unit: np.ndarray, offsets: np.ndarray | float = 0.0
    ) -> np.ndarray:
        """(E, T + 1, nq + nv) states from (E, T + 1, D) readings with offsets (D,), or one of all.

        Unmeasured positions are those that equalities tie to measured ones in a world of (N,)
        parameters in unit coordinates, or else those at the start of a simulated episode.
        """
        states = np.tile(self.physics.some_state, (*values.shape[:2], 1))
        read, nq = moving_from_the_start(values) - offsets, self.physics.space.nq
        step_s = self.physics.simulator.step_s
        # Measured velocities last: they take precedence over differentiated positions
        for sensor, columns in sorted(self._columns, key=lambda part: part[0].is_velocity):
            if sensor.is_torque:
                continue
            joint_values = read[..., columns]
            if sensor.is_velocity:
                states[..., nq + sensor.places] = joint_values
                continue
            states[..., sensor.places] = joint_values
            states[..., self._velocities_of(sensor)] = velocities(joint_values) / step_s
        states = self.consistent.following(states, unit, self.physics.some_state)
        states[:, 0] = self.bases.begun(states[:, 0], unit)
        return states

    def change_per_late_step(self, states: np.ndarray) -> np.ndarray:
        """(E, T + 1, 2 nv) change of states per step of lateness of the readings.

        Extrapolated from (E, T + 1, nq + nv) states as read. Bases stay: they are not read.
        """
        velocities = states[..., self.physics.space.nq :]
        moved = self.physics.simulator.step_s * velocities
        changes = np.stack([moved, np.gradient(velocities, axis=1)], -2)
        changes[..., self.bases.parts[self.physics.space.nq :]] = 0.0
        return changes.reshape(*states.shape[:-1], -1)

    def corrected(self, states: np.ndarray, change: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """(E, T + 1, nq + nv) states with measured positions changed by `change`, (E, T + 1, D).

        `rate`: (E, T + 1, D), by how much that changes per step, which corrects velocities. Of two
        sensors of a joint, the last one counts, as in `as_read`.
        """
        by, rate_s = np.zeros_like(states), rate / self.physics.simulator.step_s
        for sensor, columns in self._columns:
            if sensor.is_position:
                by[..., sensor.places] = change[..., columns]
                by[..., self._velocities_of(sensor)] = rate_s[..., columns]
        return states + by

    def moved(self, states: np.ndarray, shift: np.ndarray, start_std: np.ndarray) -> np.ndarray:
        """(W, nq + nv) initial states, moved by `shift` (W, S) times `start_std` (S,)."""
        return self.along(states, (shift * start_std) @ self.start_tangents)

    def along(self, states: np.ndarray, tangents: np.ndarray) -> np.ndarray:
        """(..., nq + nv) states moved by (..., 2 nv), not yet `consistent`."""
        return self.physics.space.move(states, tangents)

    def start_std(self, noise: np.ndarray, stretches: Stretches) -> np.ndarray:
        """(S,) prior std of an initial state of stretches, whose readings have noise (D,).

        A jerking servo turns faster within a step than the parabola through its readings says. If
        some stretches begin between a joint's readings, it is as wide as a line may miss.
        """
        values, begin = stretches.values, stretches.begin
        std, bends = np.zeros((2, self.num_places))
        # Before the first reading and after the last, such as in a padded episode, nothing moves
        known = is_within(values)[:, 2:] & is_within(values)[:, :-2]
        bent = np.square(np.diff(filled(values), 2, axis=1)) * known
        bend = np.sqrt(bent.sum((0, 1)) / np.maximum(known.sum((0, 1)), 1))
        guessed = noise if begin is None else np.hypot(noise, bend * _missed(values, begin))
        for sensor, columns in self._columns:
            if sensor.is_position:
                places = np.searchsorted(self._places, sensor.places)
                std[places], bends[places] = guessed[columns], bend[columns]
        step_s = self.physics.simulator.step_s
        speeds = np.hypot(_VELOCITY_ERROR * std, bends) / step_s
        begins_later = begin is not None and bool(begin.any())
        of_bases = self.bases.start_std(stretches.states, begins_later)
        return np.concatenate([std, speeds, of_bases])

    def starts_by_offset(self) -> np.ndarray:
        """(D, S) derivatives of initial states by readings' offsets: what was read, less these."""
        by_offset = np.zeros((self.num_readings, len(self.start_tangents)))
        for sensor, columns in self._columns:
            if sensor.is_position:
                places = np.searchsorted(self._places, sensor.places)
                by_offset[:, places] = 0.0  # of two sensors of a joint, the last one counts
                by_offset[np.arange(columns.start, columns.stop), places] = -1.0
        return by_offset

    def _velocities_of(self, sensor: JointSensor) -> np.ndarray:
        """(J,) indices, in a state, of the velocities of the positions that a sensor reads."""
        dofs = self._dofs[np.searchsorted(self._places, sensor.places)]
        return self.physics.space.nq + dofs


def _missed(values: np.ndarray, begin: np.ndarray) -> np.ndarray:
    """(D,) by how many bends, changes of speed per row, a line between readings is off.

    Midway between readings n rows apart n² / 8. 0 where all (W, K + 1, D) stretches of these (W,)
    first rows begin with a reading; what an episode's first rows lack is guessed otherwise.
    """
    is_between = (np.isnan(values[:, 0]) & (begin > 0)[:, None]).any(0)
    within, known = is_within(values).sum((0, 1)), np.isfinite(values).sum((0, 1))
    return is_between * np.square(within / np.maximum(known, 1)) / 8
