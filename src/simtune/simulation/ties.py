"""What a model's tendons and equalities tie to each other."""

from collections.abc import Iterable, Iterator

import mujoco
import numpy as np

from simtune.simulation.joints import dofs_above

_EQ, _WRAP, _SITE = mujoco.mjtEq, mujoco.mjtWrap, mujoco.mjtObj.mjOBJ_SITE.value
_BODY_EQUALITIES = (_EQ.mjEQ_CONNECT.value, _EQ.mjEQ_WELD.value)
_FLEX_EQUALITIES = (_EQ.mjEQ_FLEX.value, _EQ.mjEQ_FLEXVERT.value, _EQ.mjEQ_FLEXSTRAIN.value)
_JOINT_EQUALITY = _EQ.mjEQ_JOINT.value
_GEOM_WRAPS = (_WRAP.mjWRAP_SPHERE.value, _WRAP.mjWRAP_CYLINDER.value)


def tied_bodies(model: mujoco.MjModel) -> set[int]:
    """Bodies that a tendon touches, or that an active equality ties, perhaps to the world.

    Those of joints' equalities are left out: these are never free.
    """
    tied = set[int]()
    for tendon in range(model.ntendon):
        tied.update(bodies_of_tendon(model, tendon))
    for tie in np.flatnonzero(_is_active(model)):
        kind, ends = model.eq_type[tie], (model.eq_obj1id[tie], model.eq_obj2id[tie])
        if kind in _BODY_EQUALITIES:
            by_site = model.eq_objtype[tie] == _SITE
            tied.update(int(model.site_bodyid[end] if by_site else end) for end in ends)
        elif kind in _FLEX_EQUALITIES:
            at, num = model.flex_vertadr[ends[0]], model.flex_vertnum[ends[0]]
            tied.update(model.flex_vertbodyid[at : at + num].tolist())
    return tied - {-1}  # a body of a soft one's vertex that nodes move


def bodies_of_tendon(model: mujoco.MjModel, tendon: int) -> list[int]:
    """Those that a spatial tendon touches, at sites or around geoms."""
    bodies = list[int]()
    for kind, wrapped in _wrapped(model, tendon):
        if kind == _WRAP.mjWRAP_SITE.value:
            bodies.append(int(model.site_bodyid[wrapped]))
        elif kind in _GEOM_WRAPS:
            bodies.append(int(model.geom_bodyid[wrapped]))
    return bodies


def joints_of_tendon(model: mujoco.MjModel, tendon: int) -> list[int]:
    """Whose positions a fixed tendon adds up."""
    wrapped = _wrapped(model, tendon)
    return [int(joint) for kind, joint in wrapped if kind == _WRAP.mjWRAP_JOINT.value]


def _wrapped(model: mujoco.MjModel, tendon: int) -> Iterator[tuple[int, int]]:
    """Kind and index of each object along a tendon."""
    at, num = model.tendon_adr[tendon], model.tendon_num[tendon]
    return zip(model.wrap_type[at:][:num], model.wrap_objid[at:][:num], strict=True)


def joint_ties(model: mujoco.MjModel) -> list[int]:
    """Active equalities that tie one joint to another, both hinges or slides, as MuJoCo asks."""
    is_tie = _is_active(model) & (model.eq_type == _JOINT_EQUALITY) & (model.eq_obj2id >= 0)
    return np.flatnonzero(is_tie).tolist()


def dofs_of_ties(model: mujoco.MjModel) -> dict[int, set[int]]:
    """{active equality of two bodies or of joints: the velocities that move what it ties}.

    Not of mocap bodies.
    """
    found = dict[int, set[int]]()
    for tie in np.flatnonzero(_is_active(model)).tolist():
        ends = [int(model.eq_obj1id[tie]), int(model.eq_obj2id[tie])]
        if model.eq_type[tie] == _JOINT_EQUALITY:
            found[tie] = {int(model.jnt_dofadr[joint]) for joint in ends if joint >= 0}
        elif model.eq_type[tie] in _BODY_EQUALITIES:
            if model.eq_objtype[tie] == _SITE:
                ends = model.site_bodyid[ends].tolist()
            if np.any(model.body_mocapid[model.body_rootid[ends]] >= 0):
                continue  # a state places it, not the model
            # What moves both ends moves neither relative to the other
            found[tie] = dofs_above(model, ends[0]) ^ dofs_above(model, ends[1])
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
