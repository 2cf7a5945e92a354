"""The task as a camera sees it that may be elsewhere, with surfaces of any colour."""

from dataclasses import replace

import mujoco
import numpy as np

from simtune.config.camera_pose import CameraPoseOptions
from simtune.errors import InputError
from simtune.footage import Footage
from simtune.observation import ObservationModel, joints_of
from simtune.parameters import Parameter, ParameterSpace, camera_pose, colour, field_of_view
from simtune.tasks import Task
from simtune.trajectory import Trajectory

_MOST_COLOURS = 12  # surfaces whose colour is anything
_LARGEST_FOV_DEG = 170.0


def with_any_camera(task: Task, footage: Footage, options: CameraPoseOptions) -> Task:
    """The task with one camera, whose pose and field of view are all that is tuned but colours.

    The first parameters are those of the camera.
    Raises InputError where no joints are measured.
    """
    if not joints_of(task.sensors):
        raise InputError(
            "where a camera is can be told where joints are measured: declare [[sensors]] "
            "(docs/tuning-file.md), or have `simtune tune` find a camera_pose"
        )
    model = task.load_model()
    its = model.camera(footage.camera)
    x, y, z = map(float, its.pos)
    within_rad = float(np.radians(options.within_deg))
    camera = camera_pose(
        "camera", footage.camera, (x, y, z), within_m=options.within_m, within_rad=within_rad
    )
    if footage.lens is None and options.within_fov_deg:
        fovy = float(its.fovy[0])
        low = max(fovy - options.within_fov_deg, fovy / 4)
        high = min(fovy + options.within_fov_deg, _LARGEST_FOV_DEG)
        seen = field_of_view("camera_field_of_view", footage.camera, fovy)
        camera.append(replace(seen, low=low, high=high))
    space = ParameterSpace([*camera, *_any_colours(model)])
    return replace(task, parameters=space, cameras=(footage,))


def camera_parameters(space: ParameterSpace) -> np.ndarray:
    """(P,) indices of those of the camera."""
    return np.flatnonzero([parameter.field.startswith("cam_") for parameter in space])


def surfaces(space: ParameterSpace) -> list[np.ndarray]:
    """Of each surface the indices of its red, green and blue."""
    colours = np.flatnonzero([parameter.name.startswith("surface_") for parameter in space])
    return list(colours.reshape(-1, 3))


def _any_colours(model: mujoco.MjModel) -> list[Parameter]:
    """Of the materials, and of the geoms without one, of all that can move."""
    moves = (model.body_weldid[model.geom_bodyid] != 0) & (model.geom_rgba[:, 3] > 0)
    materials = np.unique(model.geom_matid[moves & (model.geom_matid >= 0)])
    plain = np.flatnonzero(moves & (model.geom_matid < 0))
    found = [("mat_rgba", model.material(m).name, model.mat_rgba[m]) for m in materials]
    found += [("geom_rgba", model.geom(g).name, model.geom_rgba[g]) for g in plain]
    named = [(field, name, rgba) for field, name, rgba in found if name]
    return [
        channel
        for i, (field, name, rgba) in enumerate(named[:_MOST_COLOURS])
        for channel in colour(f"surface_{i}", (name,), _rgb(rgba), field=field)
    ]


def _rgb(rgba: np.ndarray) -> tuple[float, float, float]:
    red, green, blue = map(float, rgba[:3])
    return red, green, blue


def measured_states(
    model: mujoco.MjModel,
    observation: ObservationModel,
    trajectories: list[Trajectory],
    full_state: np.ndarray,
) -> np.ndarray:
    """(F, S) full states at all frames, one episode after the other, at rest.

    Joints that nobody measures are as in `full_state`; where a reading is missing it is NaN.
    """
    states = []
    for trajectory in trajectories:
        its = np.tile(full_state, (len(trajectory) + 1, 1))
        its[:, 1 + model.nq : 1 + model.nq + model.nv] = 0.0
        for sensor in joints_of(observation.sensors):
            if not sensor.is_velocity:
                its[:, 1 + sensor.places] = trajectory.readings[sensor.name]
        states.append(its)
    return np.concatenate(states)
