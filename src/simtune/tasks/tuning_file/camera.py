"""The cameras of a tuning file: cameras of the model, or new ones with a given pose."""

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from simtune.cameras.footage import Footage
from simtune.errors import InputError, UnknownName
from simtune.tasks.tuning_file.camera_sensor import add_plain_camera, has_sensor
from simtune.tasks.tuning_file.footage import KEYS as FOOTAGE
from simtune.tasks.tuning_file.footage import read_footage
from simtune.tasks.tuning_file.region import own_fovy_deg, read_region, turn
from simtune.toml_reading import TomlTable

_ORTHOGRAPHIC = mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC
_POSE = ("position_m", "look_at_m", "up", "quat", "field_of_view_deg", "body")
_NARROWEST_DEG = 2.0  # field of view of a camera; less are radians
_ADDED = "simtune_camera"  # default name of a new camera in the model


@dataclass(frozen=True)
class FilmingCamera:
    """A camera's recordings, and its pose if the model does not have the camera."""

    footage: Footage
    position_m: tuple[float, ...] = ()  # (3,), empty if the camera is the model's
    quaternion: tuple[float, ...] = ()  # (4,) w, x, y, z: looks along −z, y is up
    fovy_deg: float = 0.0
    body: str = "world"  # on which the camera is mounted; the pose is in its frame

    def add_to(self, spec: mujoco.MjSpec) -> None:
        """Add the camera to a model; replaces it in a tuned and exported one that has it.

        Raises InputError for a camera of the model that no field of view describes.
        """
        name, lens = self.footage.camera, self.footage.lens
        if self.position_m:
            quaternion = lens.towards_region(self.quaternion) if lens else self.quaternion
            if before := spec.camera(name):
                spec.delete(before)
            camera = add_plain_camera(spec.body(self.body), name, self.position_m, quaternion)
            camera.fovy = self.fovy_deg
        elif spec.camera(name).proj == _ORTHOGRAPHIC:
            raise InputError(
                f"camera {name} of the model is orthographic, and a real camera has a perspective: "
                "give it a fovy in degrees"
            )
        elif has_sensor(spec.camera(name)):
            raise InputError(
                f"camera {name} of the model has pixels that are not square, or an optical axis "
                "beside its picture's middle: leave its sensorsize, focal and principal out, give "
                "it fovy, and say the rest as intrinsics in [camera]"
            )
        elif lens:
            turn(spec, name, lens)
            spec.camera(name).fovy = self.fovy_deg


def add_cameras(
    file: TomlTable, spec: mujoco.MjSpec, usual: str | None = None
) -> tuple[Footage, ...]:
    """The recordings of the cameras that a file names, which are added to the model.

    It says `camera = "NAME"`, a table [camera], or [[cameras]]. The default is the `usual` camera,
    or the model's only one; with sensors, it is no camera. Raises InputError.
    """
    cameras = _read(file, spec, usual)
    for camera in cameras:
        camera.add_to(spec)
    return tuple(camera.footage for camera in cameras)


def _read(file: TomlTable, spec: mujoco.MjSpec, usual: str | None) -> list[FilmingCamera]:
    known = [camera.name for camera in spec.cameras if camera.name]
    if "cameras" in file:
        if "camera" in file:
            raise file.error("give camera or [[cameras]], not both", "camera")
        return _several(file.tables("cameras"), spec, known, usual)
    if "camera" not in file:
        if "sensors" in file:
            return []
        if usual or len(known) == 1:
            return [_model_s(usual or known[0])]
        pose = "or say where one is in a table [camera] (docs/tuning-file.md)"
        if known:
            raise file.error(f"which camera films? camera = one of {', '.join(known)}, {pose}")
        raise file.error(f"no camera films: the model has none with a name; give it one, {pose}")
    if not file.is_table("camera"):
        return [_model_s(_named(file, "camera", known))]
    return [_of_table(file.table("camera"), spec, known, usual)]


def _several(
    tables: list[TomlTable], spec: mujoco.MjSpec, known: list[str], usual: str | None
) -> list[FilmingCamera]:
    """Cameras of [[cameras]]; raises InputError if two have the same name or key."""
    cameras: list[FilmingCamera] = []
    for table in tables:
        new = _of_table(table, spec, known, usual)
        for key in ("name", "key", "camera"):
            mine, others = getattr(new.footage, key), [getattr(c.footage, key) for c in cameras]
            if mine in others:
                says = f"two cameras with the {key} {mine!r}" if mine else f"two without a {key}"
                raise table.error(f"{says}: give each its own", key if key in table else None)
        cameras.append(new)
    return cameras


def _model_s(name: str) -> FilmingCamera:
    return FilmingCamera(Footage(camera=name, name=name))


def _named(table: TomlTable, key: str, known: list[str]) -> str:
    """Name of a camera that the model has. Raises InputError."""
    name = table.text(key)
    if name not in known:
        if not known:
            message = f"no camera {name!r} in the model, which has none; say where it is in a table"
            message += " [camera] (docs/tuning-file.md)"
            raise table.error(message, key)
        raise table.error(UnknownName("camera", name, "the model", known), key)
    return name


def _of_table(
    table: TomlTable, spec: mujoco.MjSpec, known: list[str], usual: str | None
) -> FilmingCamera:
    """A camera of the model, by default the usual or only one, or a new one; its recordings."""
    table.allow("name", "camera", *_POSE, *FOOTAGE)
    footage = read_footage(table)
    if footage.lens and "field_of_view_deg" in table:
        raise table.error("the lens says the field of view: leave this out", "field_of_view_deg")
    has_pose = any(key in table for key in _POSE)
    is_named = "camera" in table or "name" in table
    if not has_pose and not is_named and (usual or len(known) == 1):
        camera = _model_s(usual or known[0])
    elif "camera" in table or ("name" in table and not has_pose):
        for key in _POSE:
            if key in table:
                raise table.error(f"camera is the model's, which has a pose: leave {key} out", key)
        camera = _model_s(_named(table, "camera" if "camera" in table else "name", known))
    else:
        camera = replace(_posed(table), body=_body(table, spec))
    model_s = camera.footage.camera
    fovy_deg = camera.fovy_deg if camera.position_m else own_fovy_deg(spec, model_s)
    lens = read_region(table, footage.lens, fovy_deg)
    footage = replace(footage, camera=model_s, name=table.text("name", model_s), lens=lens)
    return replace(camera, footage=footage, fovy_deg=lens.fovy_deg if lens else fovy_deg)


def _body(table: TomlTable, spec: mujoco.MjSpec) -> str:
    name, known = table.text("body", "world"), [body.name for body in spec.bodies if body.name]
    if name not in known:
        raise table.error(UnknownName("body", name, "the model", known), "body")
    return name


def _posed(table: TomlTable) -> FilmingCamera:
    position = table.numbers("position_m", 3)
    if "quat" in table:
        if "look_at_m" in table or "up" in table:
            raise table.error("give look_at_m (and up) or quat, not both", "quat")
        quaternion = table.numbers("quat", 4)
        if not any(quaternion):
            raise table.error("quat must not be zero", "quat")
    else:
        if "look_at_m" not in table:
            raise table.error("expected look_at_m, a point in the picture's middle, or quat")
        target, up = table.numbers("look_at_m", 3), table.numbers("up", 3, (0.0, 0.0, 1.0))
        if target == position:
            raise table.error("the camera cannot look at where it is", "look_at_m")
        quaternion = _looking(np.array(position), np.array(target), np.array(up))
        if quaternion is None:
            key = "up" if "up" in table else "look_at_m"
            raise table.error(
                f"the camera looks along up = {list(up)}: give the up of its picture", key
            )
    fovy_deg = table.number("field_of_view_deg", 45.0, above=0, below=180)
    if fovy_deg < _NARROWEST_DEG:
        raise table.error(
            f"field_of_view_deg is in degrees, got {fovy_deg:g}; in radians that would be "
            f"{np.rad2deg(fovy_deg):.0f} degrees",
            "field_of_view_deg",
        )
    footage = Footage(camera=table.text("name", _ADDED))
    return FilmingCamera(footage, position, quaternion, fovy_deg)


def _looking(position: np.ndarray, target: np.ndarray, up: np.ndarray) -> tuple[float, ...] | None:
    """(4,) orientation of a camera that looks at `target`; None if it looks along `up`."""
    backward = (position - target) / np.linalg.norm(position - target)
    right = np.cross(up, backward)
    if np.linalg.norm(right) < 1e-6 * max(1e-9, float(np.linalg.norm(up))):
        return None
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(backward, right), backward], axis=1)
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, axes.ravel())
    return tuple(map(float, quaternion))
