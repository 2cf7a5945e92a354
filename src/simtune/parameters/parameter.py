"""A parameter: one number of the simulator, by field and object name."""

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from simtune.errors import InputError
from simtune.parameters.field import Field
from simtune.parameters.fields import KINDS, field_of

_LONGEST_DELAY_S = 10.0  # a longer delay must be a mistake of units


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One tunable number of an MjModel.

    For one object, the value is the field's own, in `unit`. For several objects, it is a factor on
    their nominal values (unit "×", nominal 1) or, with `is_sum`, their sum, of which each keeps its
    share. Colours, delays, lags, offsets and a compensated weight are absolute in both cases.
    For a field of orientations ("cam_quat"), the value is the angle, in rad, by which the objects
    are rotated from their nominal orientation about their own axis `component`: 0 x, 1 y, 2 z.
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
    is_sum: bool = False  # of several objects, e.g. the length of a rope made of pieces
    # Name in `KINDS`, if it says more than the field's name
    kind: str = dataclasses.field(default="", repr=False)
    # Keys of the tuning file that give the bounds
    bound_keys: str = dataclasses.field(default="low and high", repr=False, compare=False)

    def __post_init__(self) -> None:
        if problem := next(self._problems(), None):
            raise InputError(f"{self.name}: {problem}")

    def _problems(self) -> Iterator[str]:
        if self.scale not in ("log", "linear"):
            yield f"scale must be 'log' or 'linear', got {self.scale!r}"
        if not np.all(np.isfinite([self.nominal, self.low, self.high])):
            yield "nominal, low and high must be finite numbers"
        if not self.low < self.high:
            yield f"low must be below high, got {self.low} and {self.high}"
        if not self.low <= self.nominal <= self.high:
            yield f"nominal {self.nominal} lies outside [{self.low}, {self.high}]"
        if self.scale == "log" and self.low <= 0:
            yield f"a log scale needs low > 0, got {self.low}"
        if self.is_rotation and self.component not in (0, 1, 2):
            wanted = "a component, the axis to turn about: 0, 1 or 2"
            yield f"{self.field} needs {wanted}, got {self.component}"
        if self.field_info.is_never_negative and self.low < 0:
            yield f"{self.field} cannot be negative, got low = {self.low:g}"
        if self.field == "cam_fovy" and (self.low < 0 or self.high >= 180):
            yield f"a field of view lies between 0 and 180°, got {self.low:g} to {self.high:g}"
        if self.is_delay and self.high > _LONGEST_DELAY_S:
            yield f"a delay is at most {_LONGEST_DELAY_S:g} s, got high = {self.high:g}"

    @cached_property
    def field_info(self) -> Field:
        """Properties of the field."""
        return KINDS[self.kind][0] if self.kind else field_of(self.field)

    @property
    def is_colour(self) -> bool:
        return self.field_info.is_colour

    @property
    def is_delay(self) -> bool:
        return self.field_info.is_delay

    @property
    def is_lag(self) -> bool:
        return self.field_info.is_lag

    @property
    def compensates_weight(self) -> bool:
        """Whether this is gravity compensation: a force other than the servos' holds bodies up."""
        return self.field == "body_gravcomp"

    @property
    def changes_model(self) -> bool:
        """Whether a model must be prepared for this parameter before it is compiled."""
        of_actuator = self.is_delay or self.is_lag or self.field_info.form == "range"
        return of_actuator or self.compensates_weight or self.field_info.needs_all_terms

    @property
    def is_rotation(self) -> bool:
        """Whether the value is an angle about an axis instead of a value of the field."""
        return self.field_info.is_rotation

    @property
    def is_visible(self) -> bool:
        """Whether a single picture can reveal the value, without any motion."""
        return self.field_info.shows != "motion"

    @property
    def is_appearance(self) -> bool:
        """Whether the value changes a picture's pixels but moves nothing in it."""
        return self.field_info.shows == "appearance"

    @cached_property
    def is_factor(self) -> bool:
        """Whether the value multiplies the objects' nominal values instead of replacing them."""
        is_absolute = self.is_colour or self.is_delay or self.is_lag or self.is_rotation
        is_absolute |= self.field_info.form == "shift" or self.field_info.is_one_for_all
        return len(self.objects) > 1 and not is_absolute
