"""Parameters that are often declared, in one line each."""

from simtune.parameters.parameter import Parameter


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


def delay(name: str, actuators: tuple[str, ...], high_s: float) -> Parameter:
    """Seconds, 0 to `high_s`, by which the actuators follow their controls late; nominally 0.

    More than 0 is at least one physics step: whatever is shorter acts as one.
    """
    return Parameter(
        name=name,
        field="actuator_delay",
        objects=actuators,
        nominal=0.0,
        low=0.0,
        high=high_s,
        scale="linear",
        unit="s",
    )


def camera_pose(
    name: str,
    camera: str,
    position_m: tuple[float, float, float],
    *,
    within_m: float = 0.1,
    within_rad: float = 0.1,
) -> list[Parameter]:
    """NAME_x, NAME_y, NAME_z, where the camera is, and NAME_pitch, NAME_yaw, NAME_roll, its rotation.

    `position_m` is the nominal cam_pos, from which at most `within_m` is searched along each axis;
    rotations of at most `within_rad` either way are about the camera's own x (pitch, up), y (yaw, to
    the left) and z (roll).
    """
    places = [
        Parameter(
            name=f"{name}_{axis}",
            field="cam_pos",
            objects=(camera,),
            component=index,
            nominal=position_m[index],
            low=position_m[index] - within_m,
            high=position_m[index] + within_m,
            scale="linear",
            unit="m",
        )
        for index, axis in enumerate("xyz")
    ]
    rotations = [
        Parameter(
            name=f"{name}_{rotation}",
            field="cam_quat",
            objects=(camera,),
            component=index,
            nominal=0.0,
            low=-within_rad,
            high=within_rad,
            scale="linear",
            unit="rad",
        )
        for index, rotation in enumerate(("pitch", "yaw", "roll"))
    ]
    return [*places, *rotations]


def field_of_view(
    name: str, camera: str, nominal_deg: float, *, within_deg: float = 10.0
) -> Parameter:
    """The camera's vertical field of view, degrees."""
    return Parameter(
        name=name,
        field="cam_fovy",
        objects=(camera,),
        nominal=nominal_deg,
        low=nominal_deg - within_deg,
        high=nominal_deg + within_deg,
        scale="linear",
        unit="°",
    )
