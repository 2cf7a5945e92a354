"""`fixed_joints` of a tuning file: joints to remove, with everything that refers to them."""

from collections.abc import Callable, Iterable
from typing import Any

import mujoco
import numpy as np

from simtune.parameters.inferred import write_down_springs
from simtune.tasks.tuning_file.fixed_pose import keep_ties, move_bodies
from simtune.tasks.tuning_file.object_names import find_keyframe, find_objects
from simtune.toml_reading import TomlTable

_TRN, _OBJ, _EQ = mujoco.mjtTrn, mujoco.mjtObj, mujoco.mjtEq


def fix_joints(file: TomlTable, spec: mujoco.MjSpec) -> None:
    """Remove the file's `fixed_joints`; their bodies stay as in `fixed_pose`, by default qpos0.

    Springs, dampers and ties are as in the whole model, where MuJoCo infers them at qpos0.

    Raises InputError if the file is invalid, ValueError if MuJoCo refuses.
    """
    if "fixed_joints" not in file:
        if "fixed_pose" in file:
            raise file.error("fixed_pose is of fixed_joints, and there are none", "fixed_pose")
        return
    model = spec.compile()
    with file.at("fixed_joints"):
        names = find_objects(model, "joint", file.names("fixed_joints"), plays=True)
        fixed = {model.joint(name).id for name in names}
        write_down_springs(spec, model)
        if "fixed_pose" in file:
            with file.at("fixed_pose"):
                pose = model.key_qpos[find_keyframe(model, file.text("fixed_pose"))]
            moved = spec.compile()
            move_bodies(moved, fixed, pose)
            spec.copy_back(moved)
            keep_ties(spec, model)
    actuators = _remove(spec, names)
    _shorten_keyframes(spec, model, fixed, {model.actuator(name).id for name in actuators})


def _remove(spec: mujoco.MjSpec, joints: Iterable[str]) -> list[str]:
    """Remove joints and what refers to them; returns the names of the removed actuators."""
    gone: dict[Any, set[str]] = {_OBJ.mjOBJ_JOINT: set(joints)}
    gone[_OBJ.mjOBJ_TENDON] = _delete(
        spec,
        spec.tendons,
        lambda tendon: any(
            wrap.type == mujoco.mjtWrap.mjWRAP_JOINT and wrap.target.name in joints
            for wrap in tendon.path
        ),
    )
    moved = {_TRN.mjTRN_JOINT: _OBJ.mjOBJ_JOINT, _TRN.mjTRN_JOINTINPARENT: _OBJ.mjOBJ_JOINT}
    moved[_TRN.mjTRN_TENDON] = _OBJ.mjOBJ_TENDON
    gone[_OBJ.mjOBJ_ACTUATOR] = _delete(
        spec, spec.actuators, lambda a: a.target in gone.get(moved.get(a.trntype), ())
    )
    tied = {_EQ.mjEQ_JOINT: _OBJ.mjOBJ_JOINT, _EQ.mjEQ_TENDON: _OBJ.mjOBJ_TENDON}
    _delete(
        spec,
        spec.equalities,
        lambda e: not gone.get(tied.get(e.type), set()).isdisjoint((e.name1, e.name2)),
    )
    _delete(
        spec,
        spec.sensors,
        lambda s: s.objname in gone.get(s.objtype, ()) or s.refname in gone.get(s.reftype, ()),
    )
    _delete(spec, spec.joints, lambda joint: joint.name in joints)
    return sorted(gone[_OBJ.mjOBJ_ACTUATOR])


def _delete(
    spec: mujoco.MjSpec, elements: Iterable[Any], is_gone: Callable[[Any], bool]
) -> set[str]:
    """Delete the elements for which `is_gone`; returns their names."""
    chosen = [element for element in elements if is_gone(element)]
    names = {element.name for element in chosen}
    for element in chosen:
        spec.delete(element)
    return names


def _shorten_keyframes(
    spec: mujoco.MjSpec, model: mujoco.MjModel, joints: set[int], actuators: set[int]
) -> None:
    """Remove the numbers of joints and actuators that `model` had from the spec's keyframes."""

    def kept(num: int, starts: np.ndarray, counts: Iterable[int], removed: set[int]) -> np.ndarray:
        spans = zip(starts.tolist(), counts, strict=True)
        gone = [np.arange(at, at + n) for i, (at, n) in enumerate(spans) if i in removed and n]
        return np.delete(np.arange(num), np.concatenate(gone).astype(int) if gone else [])

    # Ends of the joints' spans in qpos and qvel
    ends = np.append(model.jnt_qposadr[1:], model.nq), np.append(model.jnt_dofadr[1:], model.nv)
    where = {
        "qpos": kept(model.nq, model.jnt_qposadr, ends[0] - model.jnt_qposadr, joints),
        "qvel": kept(model.nv, model.jnt_dofadr, ends[1] - model.jnt_dofadr, joints),
        "act": kept(model.na, model.actuator_actadr, model.actuator_actnum, actuators),
        "ctrl": kept(model.nu, model.actuator_ctrladr, model.actuator_ctrlnum, actuators),
    }
    for i, key in enumerate(spec.keys):
        for what, entries in where.items():
            setattr(key, what, getattr(model, f"key_{what}")[i][entries])
