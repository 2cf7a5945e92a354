"""A parameter: one number of the simulator, by field and object name."""

from dataclasses import dataclass

import numpy as np

from simtune.errors import InputError

# Fields that hold colours: always absolute values in [0, 1], also on several objects.
COLOUR_FIELDS = frozenset(
    {
        "geom_rgba",
        "mat_rgba",
        "site_rgba",
        "tendon_rgba",
        "light_diffuse",
        "light_ambient",
        "light_specular",
    }
)

# First words of the fields that show in a single picture; the others show in motion only.
_VISIBLE = (
    "mat_",
    "site_rgba",
    "site_size",
    "tendon_rgba",
    "light_",
    "cam_",
    "geom_rgba",
    "geom_size",
)


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One tunable number of an MjModel.

    On one object the value is the field's own, in `unit`; on several objects it is a factor
    on their nominal values (unit "×", nominal 1). Colours are absolute either way.
    """

    name: str
    field: str  # an MjModel field, e.g. "body_mass", or "opt.gravity"
    objects: tuple[str, ...] = ()  # names of the bodies, geoms, joints, ... ; empty for "opt.*"
    component: int | None = None  # index within the object's row; None writes the whole row
    nominal: float
    low: float
    high: float
    scale: str = "log"  # "log" or "linear": how values are spread between low and high
    unit: str

    def __post_init__(self) -> None:
        if self.scale not in ("log", "linear"):
            raise InputError(f"{self.name}: scale must be 'log' or 'linear', got {self.scale!r}")
        if not np.all(np.isfinite([self.nominal, self.low, self.high])):
            raise InputError(f"{self.name}: nominal, low and high must be finite numbers")
        if not self.low < self.high:
            raise InputError(f"{self.name}: low must be below high, got {self.low} and {self.high}")
        if not self.low <= self.nominal <= self.high:
            raise InputError(
                f"{self.name}: nominal {self.nominal} lies outside [{self.low}, {self.high}]"
            )
        if self.scale == "log" and self.low <= 0:
            raise InputError(f"{self.name}: a log scale needs low > 0, got {self.low}")

    @property
    def is_colour(self) -> bool:
        return self.field in COLOUR_FIELDS

    @property
    def is_visible(self) -> bool:
        """Whether a single picture can tell the value, without any motion."""
        return self.field.startswith(_VISIBLE)

    @property
    def is_factor(self) -> bool:
        """Whether the value multiplies the objects' nominal values instead of replacing them."""
        return len(self.objects) > 1 and not self.is_colour


def colour(name: str, objects: tuple[str, ...], rgb: tuple[float, float, float]) -> list[Parameter]:
    """The three parameters NAME_r, NAME_g, NAME_b of the geoms' colour."""
    return [
        Parameter(
            name=f"{name}_{channel}",
            field="geom_rgba",
            objects=objects,
            component=index,
            nominal=rgb[index],
            low=0.0,
            high=1.0,
            scale="linear",
            unit="1",
        )
        for index, channel in enumerate("rgb")
    ]


def dynamics(
    name: str,
    field: str,
    objects: tuple[str, ...],
    *,
    nominal: float = 1.0,
    unit: str = "×",
    component: int | None = None,
) -> Parameter:
    """A positive number of the physics: on a log scale, from a tenth to ten times nominal."""
    return Parameter(
        name=name,
        field=field,
        objects=objects,
        component=component,
        nominal=nominal,
        low=nominal / 10,
        high=nominal * 10,
        scale="log",
        unit=unit,
    )
