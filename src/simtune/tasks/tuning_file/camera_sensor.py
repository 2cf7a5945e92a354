"""Cameras that the model describes by a sensor and a lens, as those of devices are."""

import mujoco
import numpy as np

_SQUARE = 0.01  # relative difference of focal lengths, of pixels that are square
_IN_THE_MIDDLE = 1e-6


def use_fields_of_view(spec: mujoco.MjSpec) -> None:
    """Give cameras with a `sensorsize` the vertical field of view that follows from it.

    MuJoCo ignores the field of view of a camera that has a sensor, so a region, a lens or a search
    could not set it. A sensor stays if no field of view replaces it; see `beyond_a_field_of_view`.
    """
    model = spec.compile()
    for camera in spec.cameras:
        if not model.cam_sensorsize[camera.id].any():
            continue
        if not beyond_a_field_of_view(model, camera.id):
            camera.fovy = model.cam_fovy[camera.id]
            camera.sensor_size = camera.focal_length = camera.focal_pixel = np.zeros(2)


def beyond_a_field_of_view(model: mujoco.MjModel, camera: int) -> bool:
    """Whether a camera's pixels are not square, or its optical axis is not in the middle."""
    focal, principal = np.split(model.cam_intrinsic[camera], 2)
    is_square = abs(focal[0] / focal[1] - 1) < _SQUARE
    has_sensor = bool(model.cam_sensorsize[camera].any())
    return has_sensor and not (is_square and np.abs(principal).max() < _IN_THE_MIDDLE)
