"""What is known of a field of MjModel, and the types of objects that own fields."""

from dataclasses import KW_ONLY, dataclass
from math import inf, isfinite
from typing import Literal

import mujoco
import numpy as np

# What reveals a value: the pixels only (it moves nothing), any single picture, or motion only
Shows = Literal["appearance", "picture", "motion"]
_RANGE_FACTOR = 10.0  # a positive number is searched from nominal / 10 to nominal · 10


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
            return nominal / _RANGE_FACTOR, nominal * _RANGE_FACTOR, "log"
        return low if isfinite(low) else None, high if isfinite(high) else None, "linear"

    def read(self, model: mujoco.MjModel) -> np.ndarray:
        """The field of a model: a view; a copy if it is a scalar such as opt.timestep."""
        return np.asarray(getattr(model.opt if self.is_option else model, self.attribute))

    def write(self, model: mujoco.MjModel, value: np.ndarray) -> None:
        if value.ndim == 0:
            setattr(model.opt, self.attribute, value.item())
        else:
            self.read(model)[...] = value
