"""Bases that no sensor measures, on which joints are that sensors do: how they begin to move.

Encoders tell how a robot's wheels or legs move, not how its base does. Three things are known of
it. Where an episode begins, what stands on the ground touches it (`standing.py`) and does not slip
there: `Bases.begun`. From then on a replay takes the base along, in which joints are put back where
they were read, row by row (`unmeasured.carried`): friction keeps its speed right. What is wrong
with it still is small, and an unknown of each part of an episode that is replayed on its own. So no
part depends on another one, and Gauss-Newton knows all that a step changes.
"""

from collections.abc import Sequence

import mujoco
import numpy as np

from simtune.fit.readings.standing import stood
from simtune.observation import JointSensor
from simtune.parameters import ModelWriter
from simtune.parameters.joint_types import FREE, SLIDE
from simtune.simulation import Simulator
from simtune.simulation.joints import joints_of_state, joints_up_from

_TOUCHING_SHARE = 0.02  # of a usual body's size, between what stands on each other
_SINGULAR_RATIO = 1e-3  # to the largest singular value: directions that contacts tell of
# Prior std of unknowns: of a usual speed, and rad or per second; and of an angle of a later part
_SPEED_SHARE, _MIN_STD, _ANGLE_STD = 0.1, 1e-4, 0.05


class Bases:
    """A simulator's bases, or parts of them, that no sensor measures."""

    def __init__(
        self,
        simulator: Simulator,
        sensors: Sequence[JointSensor],
        goes_on: np.ndarray,
        settled: np.ndarray,
    ):
        """`goes_on`: (nq + nv,) bool, see `unmeasured.what_goes_on`.

        `settled`: (nq + nv,) a state in which a robot that stands does so.
        """
        self._simulator, self._settled, model = simulator, settled, simulator.model
        of_joint = joints_of_state(model)
        joints = np.intersect1d(_joints_above(model, sensors), of_joint[goes_on])
        # (nq + nv,) bool: their positions and velocities
        self.parts = np.isin(of_joint, joints)
        is_its = self.parts[model.nq :]
        self.dofs = np.flatnonzero(is_its & goes_on[model.nq :])  # (B,) of unknown speed
        is_unread = np.isin(model.dof_jntid, of_joint[: model.nq][goes_on[: model.nq]])
        self._unread = np.flatnonzero(is_its & is_unread)  # dofs of unknown position
        self._angles = self._unread[_is_rotation(model)[self._unread]]  # (R,) of these, dofs

    def __bool__(self) -> bool:
        return bool(self.parts.any())

    @property
    def tangents(self) -> np.ndarray:
        """(B + R, 2 nv) directions of an initial state: each speed, then each angle."""
        nv = self._simulator.model.nv
        return np.eye(2 * nv)[[*(nv + self.dofs), *self._angles]]

    def start_std(self, states: np.ndarray, begins_later: bool) -> np.ndarray:
        """(B + R,) prior std of these, for (W, nq + nv) initial states.

        `begins_later`: whether some are of later parts of episodes. The tuning file says how an
        episode begins.
        """
        speeds = states[:, self._simulator.model.nq + self.dofs]
        of_speeds = _SPEED_SHARE * np.sqrt(np.square(speeds).mean(0)) + _MIN_STD
        return np.append(
            of_speeds, np.full(len(self._angles), _ANGLE_STD if begins_later else _MIN_STD)
        )

    def begun(self, states: np.ndarray, unit: np.ndarray) -> np.ndarray:
        """(E, nq + nv) states with bases that stand, and so fast that what touches does not slip.

        In a world of (N,) parameters in unit coordinates.
        """
        if not self:
            return states
        model = self._model(unit)
        return self._rolling(model, stood(model, states, self._settled, self._unread))

    def _rolling(self, model: mujoco.MjModel, states: np.ndarray) -> np.ndarray:
        """(E, nq + nv) states with other speeds of the bases.

        With relative velocities J q̇ of the contacts' points and the bases' columns J_b of J, the
        least change δ of q̇_b that minimises ‖J q̇ + J_b δ‖; directions across a contact count by
        its friction.
        """
        nq, data, states = model.nq, mujoco.MjData(model), states.copy()
        for state in states:
            data.qpos[:], data.qvel[:] = state[:nq], state[nq:]
            mujoco.mj_fwdPosition(model, data)
            rows = _slip_rows(model, data)
            change = np.linalg.lstsq(rows[:, self.dofs], rows @ data.qvel, rcond=_SINGULAR_RATIO)[0]
            state[nq + self.dofs] -= change
        return states

    def _model(self, unit: np.ndarray) -> mujoco.MjModel:
        """A world's model, in which what nearly touches is a contact."""
        simulator = self._simulator
        model = simulator.model.__copy__()
        ModelWriter(simulator.space, model).write(model, simulator.space.from_unit(unit))
        near = _TOUCHING_SHARE * model.stat.meansize
        model.geom_margin += near
        model.body_margin += near  # by which bodies are looked at that have several geoms
        return model


def _joints_above(model: mujoco.MjModel, sensors: Sequence[JointSensor]) -> list[int]:
    """Joints that carry what sensors measure, and those beside a measured joint, on its body."""
    found = set[int]()
    for sensor in sensors:
        at = joints_of_state(model) if sensor.is_position else model.dof_jntid
        for joint in at[sensor.places].tolist():
            above = joints_up_from(model, int(model.jnt_bodyid[joint]))
            found.update(other for other in above if other != joint)
    return sorted(found)


def _is_rotation(model: mujoco.MjModel) -> np.ndarray:
    """(nv,) bool"""
    kinds = model.jnt_type[model.dof_jntid]
    place = np.arange(model.nv) - model.jnt_dofadr[model.dof_jntid]
    return (kinds != SLIDE) & ((kinds != FREE) | (place >= 3))


def _slip_rows(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """(3 C, nv) by which velocities give how fast the bodies of C contacts move at each other.

    Along the normal, and across it by friction's square: a castor slips, and wheels do not.
    """
    rows, one, another = [], *np.zeros((2, 3, model.nv))
    for contact in data.contact:
        for geom, jacobian in zip(contact.geom, (one, another), strict=True):
            body = model.geom_bodyid[geom]
            mujoco.mj_jac(model, data, jacobian, None, contact.pos, body)
        sliding = contact.friction[0] ** 2 * (contact.dim > 1)
        weights = np.array([1.0, sliding, sliding])[:, None]
        rows.append(weights * (contact.frame.reshape(3, 3) @ (another - one)))
    return np.concatenate(rows) if rows else np.zeros((0, model.nv))
