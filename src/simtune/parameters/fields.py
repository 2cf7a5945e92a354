"""Properties of MjModel's fields, in one table that all other code uses.

A new kind of parameter needs an entry in `_TABLE`, a test, and a line in docs/tuning-file.md. A
field without an entry can be tuned as well: its name tells which objects own it, and whether it is
a position or an orientation.
"""

from dataclasses import KW_ONLY, dataclass
from functools import cache
from math import inf, isfinite
from typing import Any, Literal

import mujoco
import numpy as np

from simtune.parameters.backlash import driven_through

# What reveals a value: the pixels only (it moves nothing), any single picture, or motion only
Shows = Literal["appearance", "picture", "motion"]
_FACTOR = 10.0  # a positive number is searched from nominal / 10 to nominal · 10, on a log scale


@dataclass(frozen=True)
class ObjectType:
    """A type of objects that own fields; the first word of a field's name gives the type."""

    mjt: mujoco.mjtObj
    count: str  # MjModel's attribute with the number of objects
    shows: Shows = "motion"  # for fields whose entry says nothing else

    @property
    def name(self) -> str:
        """The type's name in MJCF and MjSpec."""
        return self.mjt.name.removeprefix("mjOBJ_").lower()


OBJECT_TYPES = {
    "body": ObjectType(mujoco.mjtObj.mjOBJ_BODY, "nbody"),
    "geom": ObjectType(mujoco.mjtObj.mjOBJ_GEOM, "ngeom"),
    "jnt": ObjectType(mujoco.mjtObj.mjOBJ_JOINT, "njnt"),
    "dof": ObjectType(mujoco.mjtObj.mjOBJ_JOINT, "njnt"),
    "qpos0": ObjectType(mujoco.mjtObj.mjOBJ_JOINT, "njnt"),
    "qpos": ObjectType(mujoco.mjtObj.mjOBJ_JOINT, "njnt"),
    "site": ObjectType(mujoco.mjtObj.mjOBJ_SITE, "nsite"),
    "cam": ObjectType(mujoco.mjtObj.mjOBJ_CAMERA, "ncam", "picture"),
    "light": ObjectType(mujoco.mjtObj.mjOBJ_LIGHT, "nlight", "appearance"),
    "mat": ObjectType(mujoco.mjtObj.mjOBJ_MATERIAL, "nmat", "appearance"),
    "actuator": ObjectType(mujoco.mjtObj.mjOBJ_ACTUATOR, "nactuator"),
    "tendon": ObjectType(mujoco.mjtObj.mjOBJ_TENDON, "ntendon"),
    "eq": ObjectType(mujoco.mjtObj.mjOBJ_EQUALITY, "neq"),
}


@dataclass(frozen=True)
class Kind:
    """Meaning of `kind = NAME` in a tuning file."""

    name: str
    component: int | None = None  # None: the whole row
    asks_component: bool = False  # the file may choose another component
    makes: Literal["number", "rgb", "pose"] = "number"
    # How a value v is stored in the field: as v, −v, the range (−v, v), the range (−v / 2, v / 2),
    # or added to the model's value
    form: Literal["itself", "negative", "range", "play", "shift"] = "itself"
    is_apart: bool = False  # the field's entry holds for this kind only, not for `field = NAME`


@dataclass(frozen=True)
class Field:
    """A field of MjModel, an option ("opt.gravity"), or a number of a gymnasium environment."""

    name: str
    unit: str = "1"
    unit_of_slides: str = ""  # unit on slide joints, if different
    _: KW_ONLY
    kind: Kind | None = None
    within: float = inf  # largest distance from nominal that is searched, to either side
    within_of_slides: float = inf  # likewise on slide joints, if smaller
    least: float = -inf  # lower limit of the search
    most: float = inf  # upper limit
    shows_in: Shows | None = None  # None: as its object type's `shows`
    is_colour: bool = False  # absolute, also on several objects
    is_delay: bool = False  # absolute, also on several objects
    is_lag: bool = False  # absolute, also on several objects
    is_one_for_all: bool = False  # absolute, also on several objects
    is_never_negative: bool = False  # a negative value makes no sense in physics
    carries: str = ""  # another field that is written along with this one
    material_ids: str = ""  # field of the materials that colour objects of MuJoCo's default grey
    is_drawn_per_world: bool = False  # the ray caster reads it; other fields act through poses
    is_not_copied: bool = False  # MuJoCo 3.17's `MjSpec.copy_back` omits it, as measured
    is_direction: bool = False  # vectors of length 1
    needs_all_terms: bool = False  # MuJoCo skips terms of bodies that it compiles as "simple"
    components: range | None = None  # those that can be tuned, one by one; None: all, or whole rows
    usual: float | None = None  # nominal if the model has no value
    not_tunable: str = ""  # reason why a tuning file cannot declare it

    @property
    def object_type(self) -> ObjectType | None:
        """None if the field has no named owner."""
        return OBJECT_TYPES.get(self.prefix)

    @property
    def prefix(self) -> str:
        """The first word: "geom", "dof", ..., or "opt"."""
        return self.name.replace(".", "_", 1).partition("_")[0]

    @property
    def attribute(self) -> str:
        """Attribute of MjModel, or of its options."""
        return self.name.removeprefix("opt.")

    @property
    def form(self) -> str:
        """See `Kind`."""
        return self.kind.form if self.kind else "itself"

    @property
    def is_option(self) -> bool:
        return self.name.startswith("opt.")

    @property
    def is_rotation(self) -> bool:
        """Whether parameters are angles about an axis instead of values of the field."""
        return self.name.endswith("quat")

    @property
    def has_alpha(self) -> bool:
        """Whether each row is r, g, b, alpha."""
        return self.name.endswith("_rgba")

    @property
    def shows(self) -> Shows:
        return self.shows_in or (self.object_type.shows if self.object_type else "motion")

    def usual_range(
        self, nominal: float, is_slide: bool = False
    ) -> tuple[float | None, float | None, Literal["log", "linear"]]:
        """(low, high, scale); low or high is None if it has no default."""
        within = min(self.within, self.within_of_slides) if is_slide else self.within
        low, high = max(self.least, nominal - within), min(self.most, nominal + within)
        if not (isfinite(low) or isfinite(high) or self.name.endswith("_pos")) and nominal > 0:
            return nominal / _FACTOR, nominal * _FACTOR, "log"
        return low if isfinite(low) else None, high if isfinite(high) else None, "linear"

    def object_problem(self, model: mujoco.MjModel, rows: np.ndarray, name: str) -> str:
        """Reason why this object's value cannot be tuned, although it has the field; "" if none."""
        if self.name == "geom_size" and model.geom_type[rows].item() in _SHAPED_BY_ASSETS:
            return f"{name} has the size of its mesh or height field: scale that"
        if self.name in _OF_MOVING and model.body_weldid[rows].item() == 0:
            return f"{name} cannot move, so its {self.name[5:]} changes nothing"
        if self.form == "shift" and model.joint(name).type[0] not in HINGE_OR_SLIDE:
            return f"{name} is neither a hinge nor a slide, so it has no one zero"
        if self.form == "negative" and model.actuator_biasprm[rows, 1].item() >= 0:
            return f"{name} is no servo of positions (<position>), so it has no damping of its own"
        if self.form == "play" and driven_through(model, int(rows[0])) < 0:
            return (
                f"{name} is no play between a motor and what it moves: declare [[backlash]] with "
                f'joint = "{name}", and its play is "{name}_backlash"'
            )
        limit = _LIMITS.get(self.name) if self.form == "itself" else None
        if limit and not getattr(model, self.name.replace("range", "limited"))[rows].item():
            return f'{name} has no limit: give it a range in the model ({limit}="...")'
        if self.name == "cam_quat" and model.cam_mode[rows].item() in _AIMED:
            return f"{name} turns by itself, towards a body, so no angle of it can be tuned"
        if self.is_lag and model.actuator_dyntype[rows].item() not in FOLLOWS:
            return f"{name} has dynamics of its own (dyntype), so it can have no lag"
        return ""

    def read(self, model: mujoco.MjModel) -> np.ndarray:
        """The field of a model: a view; a copy if it is a scalar such as opt.timestep."""
        return np.asarray(getattr(model.opt if self.is_option else model, self.attribute))

    def write(self, model: mujoco.MjModel, value: np.ndarray) -> None:
        if value.ndim == 0:
            setattr(model.opt, self.attribute, value.item())
        else:
            self.read(model)[...] = value


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


_CAM, _DYN, _JNT = mujoco.mjtCamLight, mujoco.mjtDyn, mujoco.mjtJoint
HINGE_OR_SLIDE = (_JNT.mjJNT_HINGE.value, _JNT.mjJNT_SLIDE.value)
# Transmissions of actuators that drive a joint
OF_JOINTS = (mujoco.mjtTrn.mjTRN_JOINT.value, mujoco.mjtTrn.mjTRN_JOINTINPARENT.value)
# Dynamics of actuators that follow their control
FOLLOWS = (_DYN.mjDYN_NONE.value, _DYN.mjDYN_FILTER.value, _DYN.mjDYN_FILTEREXACT.value)
_SHAPED_BY_ASSETS = (mujoco.mjtGeom.mjGEOM_MESH.value, mujoco.mjtGeom.mjGEOM_HFIELD.value)
_OF_MOVING = ("body_mass", "body_inertia", "body_gravcomp")
_AIMED = (_CAM.mjCAMLIGHT_TARGETBODY.value, _CAM.mjCAMLIGHT_TARGETBODYCOM.value)
# Limits, as MJCF calls them: MuJoCo ignores the numbers of one that is off (`*_limited`)
_LIMITS = {
    **dict.fromkeys(("jnt_range", "tendon_range"), "range"),
    **dict.fromkeys(("jnt_actfrcrange", "tendon_actfrcrange"), "actuatorfrcrange"),
    **{f"actuator_{kind}range": f"{kind}range" for kind in ("ctrl", "force", "act")},
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
    Field("body_ipos", "m", needs_all_terms=True),
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
