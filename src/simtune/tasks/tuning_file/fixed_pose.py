"""Moves bodies to a pose of some joints, so that these joints can be removed."""

from typing import NamedTuple

import mujoco
import numpy as np

from simtune.errors import InputError
from simtune.parameters.joint_types import BALL, FREE, SLIDE

_EQ, _OBJ = mujoco.mjtEq, mujoco.mjtObj


class _Pose(NamedTuple):
    """A rigid motion: rotation, then translation."""

    pos: np.ndarray  # (3,) m
    quat: np.ndarray  # (4,) w, x, y, z

    def then(self, other: "_Pose") -> "_Pose":
        """The product self · other: `other` in this pose's frame."""
        pos, quat = np.empty(3), np.empty(4)
        mujoco.mju_mulPose(pos, quat, self.pos, self.quat, other.pos, other.quat)
        return _Pose(pos, quat)

    @property
    def inverse(self) -> "_Pose":
        pos, quat = np.empty(3), np.empty(4)
        mujoco.mju_negPose(pos, quat, self.pos, self.quat)
        return _Pose(pos, quat)

    def point(self, point: np.ndarray) -> np.ndarray:
        return self.pos + self.turn(point)

    def turn(self, vector: np.ndarray) -> np.ndarray:
        turned = np.empty(3)
        mujoco.mju_rotVecQuat(turned, vector, self.quat)
        return turned


def move_bodies(model: mujoco.MjModel, fixed: set[int], qpos: np.ndarray) -> None:
    """Move bodies to where the fixed joints are at (nq,) `qpos` and the other joints at qpos0.

    A remaining joint moves along with the fixed joints that come after it in the same body. Raises
    InputError if it is a ball joint, whose coordinates would change their meaning.
    """
    for body in range(1, model.nbody):
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        after = _Pose(np.zeros(3), np.array([1.0, 0, 0, 0]))
        for joint in reversed(range(first, first + count)):
            at = int(model.jnt_qposadr[joint])
            if joint in fixed and model.jnt_type[joint] == FREE:
                model.body_pos[body], model.body_quat[body] = (
                    qpos[at : at + 3],
                    qpos[at + 3 : at + 7],
                )
            elif joint in fixed:
                after = _displacement(model, joint, qpos, at).then(after)
            elif model.jnt_type[joint] == BALL and abs(after.quat[0]) < 1 - 1e-9:
                name = model.joint(joint).name
                raise InputError(f"ball joint {name!r} comes before fixed joints: fix it as well")
            else:
                back = after.inverse
                model.jnt_pos[joint] = back.point(model.jnt_pos[joint])
                model.jnt_axis[joint] = back.turn(model.jnt_axis[joint])
        own = _Pose(model.body_pos[body].copy(), model.body_quat[body].copy()).then(after)
        model.body_pos[body], model.body_quat[body] = own


def _displacement(model: mujoco.MjModel, joint: int, qpos: np.ndarray, at: int) -> _Pose:
    """Motion of the joint's body at `qpos`, in the body's frame."""
    axis, anchor = model.jnt_axis[joint], model.jnt_pos[joint]
    moved = qpos[at] - model.qpos0[at]
    quat = np.array([1.0, 0, 0, 0])
    if model.jnt_type[joint] == SLIDE:
        return _Pose(axis * moved, quat)
    if model.jnt_type[joint] == BALL:
        quat = qpos[at : at + 4] / np.linalg.norm(qpos[at : at + 4])
    else:
        mujoco.mju_axisAngle2Quat(quat, axis, moved)
    turned = _Pose(np.zeros(3), quat).turn(anchor)
    return _Pose(anchor - turned, quat)


def keep_ties(spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
    """Let equalities tie bodies as in `model`, from before bodies were moved.

    MuJoCo infers the poses of welds and the second anchors of connections from the bodies' default
    places. Raises InputError for tied tendons whose default length has changed.
    """
    moved = spec.compile()
    for tie in spec.equalities:
        data, ids = model.eq_data[tie.id], (model.eq_obj1id[tie.id], model.eq_obj2id[tie.id])
        if tie.type == _EQ.mjEQ_WELD and tie.objtype == _OBJ.mjOBJ_BODY:
            tie.data = data
        elif tie.type == _EQ.mjEQ_CONNECT and tie.objtype == _OBJ.mjOBJ_BODY:
            if not np.allclose(data, moved.eq_data[tie.id]):
                _connect_sites(spec, tie, (data[:3], data[3:6]))
        elif tie.type == _EQ.mjEQ_TENDON:
            lengths = [m.tendon_length0[[i for i in ids if i >= 0]] for m in (model, moved)]
            if not np.allclose(*lengths):
                raise InputError(
                    f"equality {tie.name!r} ties tendons by their lengths in the default state, "
                    "which the pose changes: leave fixed_pose out, or delete the equality"
                )


def _connect_sites(
    spec: mujoco.MjSpec, tie: mujoco.MjsEquality, anchors: tuple[np.ndarray, np.ndarray]
) -> None:
    """Give a connection of bodies both of its anchors, as sites, which nobody sees."""
    bodies, names = (tie.name1, tie.name2), (f"{tie.name} anchor 1", f"{tie.name} anchor 2")
    for body, name, anchor in zip(bodies, names, anchors, strict=True):
        spec.body(body or "world").add_site(name=name, pos=anchor, group=5, rgba=(0, 0, 0, 0))
    tie.objtype, (tie.name1, tie.name2) = _OBJ.mjOBJ_SITE, names
