"""Cameras that the model describes by a sensor and a lens, as those of devices are."""

from collections.abc import Sequence

import mujoco
import numpy as np

_SQUARE = 0.01  # relative difference of focal lengths, of pixels that are square
_IN_THE_MIDDLE = 1e-6
# The model's own cameras may have lenses etc. by default, which a tuning file does not ask for
_PLAIN = {
    "mode": mujoco.mjtCamLight.mjCAMLIGHT_FIXED,
    "proj": mujoco.mjtProjection.mjPROJ_PERSPECTIVE,
    **dict.fromkeys(("sensor_size", "focal_length", "focal_pixel"), (0.0, 0.0)),
    **dict.fromkeys(("principal_length", "principal_pixel"), (0.0, 0.0)),
}


def use_fields_of_view(spec: mujoco.MjSpec) -> None:
    """Give cameras with a `sensorsize` the vertical field of view that follows from it.

    MuJoCo ignores the field of view of a camera that has a sensor, so a region, a lens or a search
    could not set it. A sensor stays if its pixels are not square, or if the optical axis is not in
    the picture's middle: no field of view says that.
    """
    described = [camera for camera in spec.cameras if has_sensor(camera)]
    model = spec.compile() if described else None  # which takes long for a model of meshes
    for camera in described:
        assert model is not None
        focal, principal = np.split(model.cam_intrinsic[camera.id], 2)
        is_square = abs(focal[0] / focal[1] - 1) < _SQUARE
        if is_square and np.abs(principal).max() < _IN_THE_MIDDLE:
            camera.fovy = model.cam_fovy[camera.id]
            camera.sensor_size = camera.focal_length = camera.focal_pixel = np.zeros(2)


def add_plain_camera(
    body: mujoco.MjsBody, name: str, position_m: Sequence[float], quaternion: Sequence[float]
) -> mujoco.MjsCamera:
    """Add a fixed camera of which only the field of view is left to say."""
    camera = body.add_camera(name=name, pos=position_m, quat=quaternion, **_PLAIN)
    camera.alt.type = mujoco.mjtOrientation.mjORIENTATION_QUAT
    return camera


def has_sensor(camera: mujoco.MjsCamera) -> bool:
    """Whether a camera is described by a sensor, beside which its field of view does not count."""
    return bool(np.any(camera.sensor_size))
