"""Parameters that are often declared, in one line each."""

from simtune.parameters.fields import field_of
from simtune.parameters.parameter import Parameter

_WITHIN_M, _WITHIN_RAD, _WITHIN_DEG = (
    field_of(name).within for name in ("cam_pos", "cam_quat", "cam_fovy")
)


def colour(
    name: str, objects: tuple[str, ...], rgb: tuple[float, float, float], field: str = "geom_rgba"
) -> list[Parameter]:
    """The three parameters NAME_r, NAME_g, NAME_b of the colour of geoms, or of another field."""
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


def delay(name: str, actuators: tuple[str, ...], high_s: float) -> Parameter:
    """Seconds, 0 to `high_s`, by which the actuators follow their controls late; nominally 0.

    More than 0 is at least one physics step: a shorter delay acts as one.
    """
    return _linear(name, "actuator_delay", actuators, 0.0, (0.0, high_s))


def camera_pose(
    name: str,
    camera: str,
    position_m: tuple[float, float, float],
    *,
    within_m: float = _WITHIN_M,
    within_rad: float = _WITHIN_RAD,
) -> list[Parameter]:
    """NAME_x, NAME_y, NAME_z, the camera's position, and NAME_pitch, NAME_yaw, NAME_roll.

    `position_m` is the nominal cam_pos, from which at most `within_m` is searched along each axis.
    The rotations, of at most `within_rad` either way, are about the camera's own x (pitch, up),
    y (yaw, to the left) and z (roll).
    """
    moved = [(axis, "cam_pos", i, position_m[i], within_m) for i, axis in enumerate("xyz")]
    angles = ("pitch", "yaw", "roll")
    moved += [(angle, "cam_quat", i, 0.0, within_rad) for i, angle in enumerate(angles)]
    return [
        _linear(f"{name}_{what}", field, (camera,), nominal, (nominal - most, nominal + most), i)
        for what, field, i, nominal, most in moved
    ]


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
    """On a linear scale, in the field's unit."""
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
