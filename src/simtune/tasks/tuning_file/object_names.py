"""Finds a model's objects by name, by a pattern, or by the joint or body they belong to."""

import re
from collections.abc import Sequence
from fnmatch import fnmatchcase

import mujoco
import numpy as np

from simtune.errors import InputError, UnknownName
from simtune.parameters.backlash_joints import driven_through
from simtune.parameters.field import OBJECT_TYPES
from simtune.parameters.fields import OF_JOINTS

_KINDS = {owner.name: owner for owner in OBJECT_TYPES.values()}
_OF_BODIES = {"geom": "geom_bodyid", "joint": "jnt_bodyid", "site": "site_bodyid"}


def names_of(model: mujoco.MjModel, kind: str) -> list[str]:
    """Names of all objects of a kind, such as "joint", in the model's order; "" if unnamed."""
    owner = _KINDS[kind]
    count = getattr(model, owner.count)
    return [mujoco.mj_id2name(model, owner.mjt, i) or "" for i in range(count)]


def find_objects(
    model: mujoco.MjModel, kind: str, given: Sequence[str], *, plays: bool = False
) -> tuple[str, ...]:
    """Names of the given objects; "left_*" and "geoms of gripper" may be several.

    Patterns do not mean the world, which is a body to MuJoCo. Among several joints, those that are
    the play of another are meant with `plays` only. Raises UnknownName for objects that the model
    lacks, InputError if a body or joint has none.
    """
    known, found = names_of(model, kind), []
    for text in given:
        if text in known:
            found.append(text)  # duplicates are kept; callers report them
            continue
        meant = _belonging(model, kind, text)
        if meant is None:
            others = known[1:] if kind == "body" else known
            meant = [name for name in others if name and fnmatchcase(name, text)]
        if not meant:
            raise UnknownName(kind, text, "the model", filter(None, known))
        if kind == "joint" and not plays:
            meant = _without_plays(model, meant)
        found += [name for name in meant if name not in found]
    return tuple(found)


def _without_plays(model: mujoco.MjModel, joints: list[str]) -> list[str]:
    """The joints that are no play; all of them if all are plays, as with "*_backlash"."""
    return [j for j in joints if driven_through(model, model.joint(j).id) < 0] or joints


def _belonging(model: mujoco.MjModel, kind: str, given: str) -> list[str] | None:
    """Names meant by "actuator of elbow" or "geoms of hose_*"; None for other texts."""
    words = re.fullmatch(rf"{kind}s? of (.+)", given)
    if not words:
        return None
    if kind == "actuator":
        joints = _indices(model, "joint", words[1])
        ids = np.isin(model.actuator_trntype, OF_JOINTS) & np.isin(
            model.actuator_trnid[:, 0], joints
        )
        whose = "joint"
    elif kind in _OF_BODIES:
        ids = np.isin(getattr(model, _OF_BODIES[kind]), _indices(model, "body", words[1]))
        whose = "body"
    else:
        return None
    known = names_of(model, kind)
    names = [known[i] for i in np.flatnonzero(ids) if known[i]]
    if not names:
        raise InputError(f"{whose} {words[1]!r} has no {kind}")
    return names


def _indices(model: mujoco.MjModel, kind: str, given: str) -> list[int]:
    """Of the object with this name, or of those that a pattern chooses; not the world's."""
    known = names_of(model, kind)
    if given in known:
        return [known.index(given)]
    first = int(kind == "body")
    chosen = [i for i, name in enumerate(known) if i >= first and name and fnmatchcase(name, given)]
    if not chosen:
        raise UnknownName(kind, given, "the model", filter(None, known))
    return chosen


def find_keyframe(model: mujoco.MjModel, name: str) -> int:
    """Index of a keyframe. Raises UnknownName."""
    known = [model.key(i).name for i in range(model.nkey)]
    if name not in known:
        raise UnknownName("keyframe", name, "the model", filter(None, known))
    return known.index(name)
