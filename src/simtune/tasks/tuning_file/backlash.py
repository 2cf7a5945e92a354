"""The tables [[backlash]] of a tuning file: play between motors and the bodies they move."""

import mujoco
import numpy as np

from simtune.parameters.joint_types import HINGE, HINGE_OR_SLIDE
from simtune.tasks.tuning_file.object_names import find_objects
from simtune.toml_reading import TomlTable

_USUAL_RAD = 0.01  # play of a hobby servo, about half a degree; slides have no default
_HARD = 2.0  # timesteps: the shortest time constant of a limit that MuJoCo accepts
_IMPEDANCE = (0.95, 0.99, 1e-3, 0.5, 2.0)  # of the stops: harder ones rattle with light rotors
# Joints of the body's default class may be damped, sprung or driven, and a play is none of these
_FREE = {
    **dict.fromkeys(("damping", "frictionloss", "stiffness", "armature"), 0.0),
    **dict.fromkeys(("ref", "springref", "margin"), 0.0),
    "springdamper": (0.0, 0.0),
    "actfrclimited": mujoco.mjtLimited.mjLIMITED_FALSE,
    "actgravcomp": False,
}


def add_backlash(file: TomlTable, spec: mujoco.MjSpec) -> None:
    """Add a joint NAME_backlash in series with each named joint; in keyframes it is at 0.

    Raises InputError if a table is invalid or does not fit the model.
    """
    if not (entries := file.tables("backlash")):
        return
    model, places = spec.compile(), list[tuple[int, int]]()
    for entry in entries:
        entry.allow("joint", "play", "armature")
        with entry.at("joint"):
            joints = find_objects(model, "joint", entry.names("joint"))
        for joint in joints:
            _add(entry, spec, model, joint)
            index = model.joint(joint).id
            places.append((model.jnt_qposadr[index] + 1, model.jnt_dofadr[index] + 1))
    for i, key in enumerate(spec.keys):
        key.qpos = np.insert(model.key_qpos[i], [at for at, _ in places], 0.0)
        key.qvel = np.insert(model.key_qvel[i], [at for _, at in places], 0.0)


def _add(entry: TomlTable, spec: mujoco.MjSpec, model: mujoco.MjModel, name: str) -> None:
    index = model.joint(name).id
    body = model.jnt_bodyid[index]
    if model.jnt_type[index] not in HINGE_OR_SLIDE:
        raise entry.error(f"backlash is of a hinge or a slide, and {name!r} is neither", "joint")
    if index != np.flatnonzero(model.jnt_bodyid == body)[-1]:
        raise entry.error(f"{name!r} is followed by another joint of its body", "joint")
    driven, play_name = spec.joint(name), f"{name}_backlash"
    if spec.joint(play_name) is not None:
        raise entry.error(f"there is a joint {play_name!r} already", "joint")
    armature = entry.number("armature", float(model.dof_armature[model.jnt_dofadr[index]]))
    if armature <= 0:
        raise entry.error(
            f"within its play nothing holds {name!r} but its rotor, which has no inertia: "
            "give it an armature above 0, in kg·m² or kg",
            "armature",
        )
    driven.armature = armature
    play = _play(entry, model, index, name)
    added = spec.body(model.body(body).name).add_joint(
        name=play_name,
        type=driven.type,
        axis=driven.axis,
        pos=driven.pos,
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        # In the compiler's unit, which may be degrees
        range=np.array([-play, play]) / 2 * _per_radian(spec, model, index),
        solref_limit=[_HARD * spec.option.timestep, 1.0],
        solimp_limit=_IMPEDANCE,
        **_FREE,
    )
    if driven.frame:  # in which its axis and pos are
        added.set_frame(driven.frame)


def _play(entry: TomlTable, model: mujoco.MjModel, joint: int, name: str) -> float:
    """Play from end to end, rad or m."""
    if "play" not in entry and not _is_hinge(model, joint):
        raise entry.error(f"{name!r} is a slide, which has no usual play: give play, in m", "joint")
    return entry.number("play", _USUAL_RAD, above=0)


def _is_hinge(model: mujoco.MjModel, joint: int) -> bool:
    return bool(model.jnt_type[joint] == HINGE)


def _per_radian(spec: mujoco.MjSpec, model: mujoco.MjModel, joint: int) -> float:
    return 180 / np.pi if spec.compiler.degree and _is_hinge(model, joint) else 1.0
