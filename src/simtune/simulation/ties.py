"""What a model's tendons and equalities tie to each other."""

from collections.abc import Iterable, Iterator

import mujoco
import numpy as np

_EQ, _WRAP, _SITE = mujoco.mjtEq, mujoco.mjtWrap, mujoco.mjtObj.mjOBJ_SITE.value
_OF_BODIES = (_EQ.mjEQ_CONNECT.value, _EQ.mjEQ_WELD.value)
_OF_FLEXES = (_EQ.mjEQ_FLEX.value, _EQ.mjEQ_FLEXVERT.value, _EQ.mjEQ_FLEXSTRAIN.value)
_JOINTS = _EQ.mjEQ_JOINT.value
_ON_GEOMS = (_WRAP.mjWRAP_SPHERE.value, _WRAP.mjWRAP_CYLINDER.value)


def tied_bodies(model: mujoco.MjModel) -> set[int]:
    """Bodies that a tendon touches, or that an active equality ties, perhaps to the world.

    Those of joints' equalities are left out: these are never free.
    """
    tied = set[int]()
    for kind, at in zip(model.wrap_type, model.wrap_objid, strict=True):
        if kind == _WRAP.mjWRAP_SITE.value:
            tied.add(int(model.site_bodyid[at]))
        elif kind in _ON_GEOMS:
            tied.add(int(model.geom_bodyid[at]))
    for tie in np.flatnonzero(_is_active(model)):
        kind, ends = model.eq_type[tie], (model.eq_obj1id[tie], model.eq_obj2id[tie])
        if kind in _OF_BODIES:
            by_site = model.eq_objtype[tie] == _SITE
            tied.update(int(model.site_bodyid[end] if by_site else end) for end in ends)
        elif kind in _OF_FLEXES:
            at, num = model.flex_vertadr[ends[0]], model.flex_vertnum[ends[0]]
            tied.update(model.flex_vertbodyid[at : at + num].tolist())
    return tied - {-1}  # a body of a soft one's vertex that nodes move


def joints_of_tendon(model: mujoco.MjModel, tendon: int) -> Iterator[int]:
    """Whose positions a fixed tendon adds up."""
    at, num = model.tendon_adr[tendon], model.tendon_num[tendon]
    for kind, joint in zip(model.wrap_type[at:][:num], model.wrap_objid[at:][:num], strict=True):
        if kind == _WRAP.mjWRAP_JOINT.value:
            yield int(joint)


def joint_ties(model: mujoco.MjModel) -> list[int]:
    """Active equalities that tie one joint to another, both hinges or slides, as MuJoCo asks."""
    is_tie = _is_active(model) & (model.eq_type == _JOINTS) & (model.eq_obj2id >= 0)
    return np.flatnonzero(is_tie).tolist()


def dofs_of_ties(model: mujoco.MjModel) -> dict[int, set[int]]:
    """{active equality of two bodies or of joints: the velocities that move what it ties}.

    Not of mocap bodies.
    """
    found = dict[int, set[int]]()
    for tie in np.flatnonzero(_is_active(model)).tolist():
        ends = [int(model.eq_obj1id[tie]), int(model.eq_obj2id[tie])]
        if model.eq_type[tie] == _JOINTS:
            found[tie] = {int(model.jnt_dofadr[joint]) for joint in ends if joint >= 0}
        elif model.eq_type[tie] in _OF_BODIES:
            if model.eq_objtype[tie] == _SITE:
                ends = model.site_bodyid[ends].tolist()
            if np.any(model.body_mocapid[model.body_rootid[ends]] >= 0):
                continue  # a state places it, not the model
            # What moves both ends moves neither relative to the other
            found[tie] = _dofs_above(model, ends[0]) ^ _dofs_above(model, ends[1])
    return found


def _dofs_above(model: mujoco.MjModel, body: int) -> set[int]:
    """Indices of the velocities that move a body."""
    found = set[int]()
    while body > 0:
        first, num = int(model.body_dofadr[body]), int(model.body_dofnum[body])
        found |= set(range(first, first + num))
        body = int(model.body_parentid[body])
    return found


def _is_active(model: mujoco.MjModel) -> np.ndarray:
    """(neq,) bool"""
    are_off = model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_EQUALITY.value
    return model.eq_active0 * (not are_off) > 0


def with_tied(model: mujoco.MjModel, joints: Iterable[int]) -> set[int]:
    """Joints, and all that active equalities tie to these, also by others."""
    found = set(joints)
    pairs = [{int(model.eq_obj1id[tie]), int(model.eq_obj2id[tie])} for tie in joint_ties(model)]
    for _ in pairs:  # a chain may be written in any order
        for pair in pairs:
            if pair & found:
                found |= pair
    return found
