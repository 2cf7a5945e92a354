"""Properties of MjModel's fields, in one table that all other code uses.

A new kind of parameter needs an entry in `_TABLE`, a test, and a line in docs/tuning-file.md. A
field without an entry can be tuned as well: its name tells which objects own it, and whether it is
a position or an orientation.
"""

from functools import cache
from typing import Any

import mujoco

from simtune.parameters.field import Field, Kind


@cache
def field_of(name: str) -> Field:
    """Properties of the field `name`, which need not exist."""
    if name in FIELDS:
        return FIELDS[name]
    if name.endswith("_quat"):
        return Field(name, "rad", within=0.1)
    return Field(name, "m" if name.endswith("_pos") else "1")


def _colour(name: str, **known: Any) -> Field:
    return Field(name, is_colour=True, least=0.0, most=1.0, shows_in="appearance", **known)


_DYN = mujoco.mjtDyn
# Transmissions of actuators that drive a joint
OF_JOINTS = (mujoco.mjtTrn.mjTRN_JOINT.value, mujoco.mjtTrn.mjTRN_JOINTINPARENT.value)
# {transmission: prefix of what it drives, which may have a limit of its own (actuatorfrcrange)}
DRIVEN = {**dict.fromkeys(OF_JOINTS, "jnt"), mujoco.mjtTrn.mjTRN_TENDON.value: "tendon"}
# Dynamics of actuators that follow their control
FOLLOWS = (_DYN.mjDYN_NONE.value, _DYN.mjDYN_FILTER.value, _DYN.mjDYN_FILTEREXACT.value)
FEW_SIZES = {  # shapes whose size is fewer than three numbers
    mujoco.mjtGeom.mjGEOM_SPHERE.value: ("sphere", 1),
    mujoco.mjtGeom.mjGEOM_CAPSULE.value: ("capsule", 2),
    mujoco.mjtGeom.mjGEOM_CYLINDER.value: ("cylinder", 2),
}
_TIMESTEP = (
    "opt.timestep says how finely physics is computed, and a recording knows its own time: "
    "it cannot be tuned"
)
_LENS = "a camera without a sensor's size has no lens of its own: tune its cam_fovy"
# fmt: off
_TABLE = (  # kinds in the order in which messages name them
    _colour("geom_rgba", kind=Kind("colour", makes="rgb"), material_ids="geom_matid",
            is_drawn_per_world=True),
    _colour("mat_rgba", kind=Kind("material_colour", makes="rgb"), is_drawn_per_world=True),
    _colour("site_rgba", material_ids="site_matid"),
    _colour("tendon_rgba", material_ids="tendon_matid"),
    Field("cam_pos", "m", kind=Kind("camera_pose", makes="pose"), within=0.1),
    Field("body_mass", "kg", kind=Kind("mass"), carries="body_inertia", is_never_negative=True),
    Field("body_inertia", is_never_negative=True),
    Field("body_ipos", "m", kind=Kind("center_of_mass", asks_component=True), within=0.05,
          needs_all_terms=True),
    Field("body_iquat", "rad", within=0.1, needs_all_terms=True),
    Field("body_gravcomp", kind=Kind("gravity_compensation"), least=0.0, most=1.2,
          usual=0.5, is_one_for_all=True, is_never_negative=True, is_not_copied=True),
    Field("geom_friction", kind=Kind("friction", 0), is_never_negative=True),
    Field("geom_fluid", is_not_copied=True, components=range(1, 6)),
    Field("geom_size", "m", kind=Kind("size", asks_component=True), shows_in="picture",
          is_never_negative=True, is_drawn_per_world=True),
    Field("site_size", shows_in="picture", is_not_copied=True),
    Field("dof_damping", "N·m·s/rad", "N·s/m", kind=Kind("damping"), is_never_negative=True),
    Field("dof_armature", "kg·m²", "kg", kind=Kind("armature"), is_never_negative=True),
    Field("dof_frictionloss", "N·m", "N", kind=Kind("friction_loss"), is_never_negative=True),
    Field("jnt_stiffness", "N·m/rad", "N/m", kind=Kind("stiffness"), is_never_negative=True),
    Field("qpos0", "rad", "m", within=0.1, within_of_slides=0.02, carries="qpos_spring",
          kind=Kind("joint_offset", form="shift", is_apart=True)),
    Field("jnt_range", "rad", "m", is_never_negative=True,
          kind=Kind("backlash", form="play", is_apart=True)),
    Field("jnt_pos", "m", needs_all_terms=True),
    Field("jnt_axis", is_direction=True, components=range(3), needs_all_terms=True),
    Field("jnt_actfrcrange", "N·m", "N", is_not_copied=True),
    Field("tendon_range", "m", kind=Kind("tendon_length", 1)),
    Field("tendon_damping", "N·s/m", kind=Kind("tendon_damping"), is_never_negative=True),
    Field("tendon_stiffness", "N/m", kind=Kind("tendon_stiffness"), is_never_negative=True),
    Field("tendon_frictionloss", is_never_negative=True),
    Field("tendon_armature", is_never_negative=True),
    Field("actuator_gainprm", kind=Kind("gain", 0), carries="actuator_biasprm"),
    Field("actuator_biasprm", "N·m·s/rad", "N·s/m", is_never_negative=True,
          kind=Kind("gain_damping", 2, form="negative", is_apart=True)),
    Field("actuator_forcerange", "N·m", "N", is_never_negative=True,
          kind=Kind("torque_limit", form="range", is_apart=True)),
    Field("actuator_dynprm", "s", is_lag=True, usual=0.05, is_never_negative=True,
          kind=Kind("lag", 0, is_apart=True)),
    Field("actuator_gear", kind=Kind("gear", 0)),
    Field("actuator_delay", "s", kind=Kind("delay"), least=0.0, is_delay=True,
          is_never_negative=True, is_not_copied=True),
    _colour("light_diffuse", kind=Kind("light"), is_drawn_per_world=True),
    _colour("light_ambient", is_drawn_per_world=True),
    _colour("light_specular", is_drawn_per_world=True),
    *(Field(f"light_{name}", is_drawn_per_world=True)
      for name in ("attenuation", "cutoff", "exponent")),
    *(Field(f"light_{name}", is_not_copied=True)
      for name in ("bulbradius", "range", "intensity", "softness")),
    Field("light_dir", is_direction=True, components=range(3)),
    *(Field(f"mat_{name}", is_drawn_per_world=True)
      for name in ("emission", "shininess", "specular", "texrepeat")),
    *(Field(f"mat_{name}", is_not_copied=True) for name in ("metallic", "roughness")),
    Field("cam_fovy", "°", kind=Kind("field_of_view"), within=10.0, least=1.0, most=170.0,
          is_never_negative=True, is_drawn_per_world=True),
    *(Field(f"cam_{name}", not_tunable=_LENS) for name in ("intrinsic", "sensorsize")),
    Field("opt.gravity", "m/s²"),
    Field("opt.timestep", "s", not_tunable=_TIMESTEP),
    Field("environment.picture", shows_in="picture"),
)
# fmt: on
FIELDS = {field.name: field for field in _TABLE if not (field.kind and field.kind.is_apart)}
KINDS = {field.kind.name: (field, field.kind) for field in _TABLE if field.kind}
