"""Shorthands that declare common parameters in one line each."""

from dataclasses import replace

from simtune.parameters.fields import field_of
from simtune.parameters.parameter import Parameter

_WITHIN_M, _WITHIN_RAD, _WITHIN_DEG = (
    field_of(name).within for name in ("cam_pos", "cam_quat", "cam_fovy")
)


def colour(
    name: str, objects: tuple[str, ...], rgb: tuple[float, float, float], field: str = "geom_rgba"
) -> list[Parameter]:
    """Parameters NAME_r, NAME_g and NAME_b: the colour of geoms, or another colour `field`."""
    return [
        _linear(f"{name}_{channel}", field, objects, rgb[index], (0.0, 1.0), index)
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
    """A positive physical parameter, searched on a log scale from nominal / 10 to nominal · 10."""
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


def camera_pose(
    name: str,
    camera: str,
    position_m: tuple[float, float, float],
    *,
    within_m: float = _WITHIN_M,
    within_rad: float = _WITHIN_RAD,
) -> list[Parameter]:
    """Parameters NAME_x, NAME_y, NAME_z (position) and NAME_pitch, NAME_yaw, NAME_roll of a camera.

    `position_m` is the nominal cam_pos; each axis is searched up to `within_m` from it. The
    rotations are about the camera's own x (pitch, up), y (yaw, to the left) and z (roll), up to
    `within_rad` in either direction.
    """
    moved = [
        (axis, "cam_pos", i, position_m[i], within_m, "within_m") for i, axis in enumerate("xyz")
    ]
    angles = ("pitch", "yaw", "roll")
    moved += [(a, "cam_quat", i, 0.0, within_rad, "within_rad") for i, a in enumerate(angles)]
    made = [
        (_linear(f"{name}_{what}", field, (camera,), at, (at - most, at + most), i), key)
        for what, field, i, at, most, key in moved
    ]
    return [replace(parameter, bound_keys=key) for parameter, key in made]


def field_of_view(name: str, camera: str, nominal_deg: float) -> Parameter:
    """The camera's vertical field of view, degrees."""
    bounds = (nominal_deg - _WITHIN_DEG, nominal_deg + _WITHIN_DEG)
    return _linear(name, "cam_fovy", (camera,), nominal_deg, bounds)


def _linear(
    name: str,
    field: str,
    objects: tuple[str, ...],
    nominal: float,
    bounds: tuple[float, float],
    component: int | None = None,
) -> Parameter:
    """A parameter on a linear scale, in the field's unit."""
    low, high = bounds
    return Parameter(
        name=name,
        field=field,
        objects=objects,
        component=component,
        nominal=nominal,
        low=low,
        high=high,
        scale="linear",
        unit=field_of(field).unit,
    )
