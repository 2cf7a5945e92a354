"""The tables [[actuators]] of a tuning file: servos for joints that the model does not drive."""

import mujoco
import numpy as np

from simtune.parameters.joint_types import HINGE_OR_SLIDE
from simtune.simulation.prepare import lift_limit
from simtune.tasks.tuning_file.object_names import find_objects
from simtune.toml_reading import TomlTable

# The model's own actuators may have gears etc. by default, which a table does not ask for
_PLAIN = {
    "gear": (1.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    **dict.fromkeys(("damping", "armature", "inheritrange", "delay"), 0.0),
    **dict.fromkeys(("nsample", "interp", "actearly"), 0),
    "actlimited": mujoco.mjtLimited.mjLIMITED_FALSE,
    "actrange": (0.0, 0.0),
}


def add_actuators(file: TomlTable, spec: mujoco.MjSpec) -> None:
    """Add position servos; in keyframes, a servo's control is its joint's position.

    Raises InputError if a table is invalid or does not fit the model.
    """
    entries = file.tables("actuators")
    if not entries:
        return
    model = spec.compile()
    taken = {actuator.name for actuator in spec.actuators}
    driven: list[int] = []
    for entry in entries:
        entry.allow("name", "joint", "kp", "kv", "torque_limit", "limited")
        with entry.at("joint"):
            joints = find_objects(model, "joint", entry.names("joint"))
        if "name" in entry and len(joints) > 1:
            raise entry.error(
                f"name is of one servo, and joint names {len(joints)}: leave it out, "
                "and each is called as its joint",
                "name",
            )
        for joint in joints:
            name = entry.text("name", joint)
            if name in taken:
                raise entry.error(f"there is an actuator {name!r} already: say another name")
            taken.add(name)
            _add(entry, spec, model, name, joint)
            driven.append(int(model.joint(joint).qposadr[0]))
    for i, key in enumerate(spec.keys):
        key.ctrl = np.concatenate([model.key_ctrl[i], model.key_qpos[i, driven]])


def _add(
    entry: TomlTable, spec: mujoco.MjSpec, model: mujoco.MjModel, name: str, joint: str
) -> None:
    index = model.joint(joint).id
    if model.jnt_type[index] not in HINGE_OR_SLIDE:
        raise entry.error(f"a servo moves a hinge or a slide, and {joint!r} is neither", "joint")
    servo = spec.add_actuator(name=name, target=joint, trntype=mujoco.mjtTrn.mjTRN_JOINT, **_PLAIN)
    kp, kv = entry.number("kp", above=0), entry.number("kv", 0.0, least=0)
    servo.set_to_position(kp=kp, kv=kv)
    is_limited = entry.flag("limited", default=True) and bool(model.jnt_limited[index])
    servo.ctrllimited = is_limited
    if is_limited:
        servo.ctrlrange = model.jnt_range[index]
    limit = entry.number("torque_limit", None, above=0)
    servo.forcelimited = limit is not None
    if limit is not None:
        servo.forcerange = [-limit, limit]
        lift_limit(spec, servo)
