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
    for tie in np.flatnonzero(model.eq_active0):
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
    is_tie = model.eq_active0 & (model.eq_type == _JOINTS) & (model.eq_obj2id >= 0)
    return np.flatnonzero(is_tie).tolist()


def with_tied(model: mujoco.MjModel, joints: Iterable[int]) -> set[int]:
    """Joints, and all that active equalities tie to these, also by others."""
    found = set(joints)
    pairs = [{int(model.eq_obj1id[tie]), int(model.eq_obj2id[tie])} for tie in joint_ties(model)]
    for _ in pairs:  # a chain may be written in any order
        for pair in pairs:
            if pair & found:
                found |= pair
    return found
