"""The camera of a tuning file: one of the model's by name, or one of a pose of its own."""

from dataclasses import dataclass, replace

import mujoco
import numpy as np

from simtune.errors import UnknownName
from simtune.footage import PLAIN, Footage
from simtune.tasks.tuning_file.footage import KEYS as FOOTAGE
from simtune.tasks.tuning_file.footage import read_footage
from simtune.tasks.tuning_file.toml_table import TomlTable

_POSE = ("position_m", "look_at_m", "up", "quat", "field_of_view_deg")
_ADDED = "simtune_camera"  # what a camera of its own is called in the model


@dataclass(frozen=True)
class FilmingCamera:
    """A camera by name, where to put it if the model has none of that name, and its footage."""

    name: str
    position_m: tuple[float, ...] = ()  # (3,), empty where the model has it
    quaternion: tuple[float, ...] = ()  # (4,) w, x, y, z: looks along −z, y is up
    fovy_deg: float = 0.0
    footage: Footage = PLAIN

    def add_to(self, spec: mujoco.MjSpec) -> None:
        if not self.position_m:
            if self.footage.lens:
                spec.camera(self.name).fovy = self.fovy_deg
            return
        if before := spec.camera(self.name):  # of a model that was tuned and exported
            spec.delete(before)
        spec.worldbody.add_camera(
            name=self.name, pos=self.position_m, quat=self.quaternion, fovy=self.fovy_deg
        )


def read_camera(file: TomlTable, spec: mujoco.MjSpec) -> FilmingCamera | None:
    """`camera = "NAME"`, a table [camera], [[cameras]], or nothing where the model has just one.

    Where sensors measure, one that is not named is not looked at: None.

    Raises InputError.
    """
    known = [camera.name for camera in spec.cameras if camera.name]
    if "cameras" in file:
        if "camera" in file:
            raise file.error("give camera or [[cameras]], not both", "camera")
        first, *others = file.tables("cameras") or [file.table("camera")]
        if others:
            raise others[0].error("one camera films today: leave the other [[cameras]] out")
        return _of_table(first, known)
    if "camera" not in file:
        if "sensors" in file:
            return None
        if len(known) == 1:
            return FilmingCamera(known[0])
        there = (
            f"name one of {', '.join(known)}" if known else "the model has no camera with a name"
        )
        raise file.error(f"which camera films? {there}, or give a pose in a table [camera]")
    if not file.is_table("camera"):
        return FilmingCamera(_named(file, known))
    return _of_table(file.table("camera"), known)


def _named(table: TomlTable, known: list[str]) -> str:
    """One of the model's cameras."""
    name = table.text("camera")
    if name not in known:
        if not known:
            message = f"no camera {name!r} in the model, which has none; give a table [camera]"
            raise table.error(message, "camera")
        raise table.error(UnknownName("camera", name, "the model", known), "camera")
    return name


def _of_table(table: TomlTable, known: list[str]) -> FilmingCamera:
    """The model's or one of its own, with what its recordings are."""
    table.allow("name", "camera", *_POSE, *FOOTAGE)
    footage = read_footage(table)
    if footage.lens and "field_of_view_deg" in table:
        raise table.error("the lens says the field of view: leave this out", "field_of_view_deg")
    if "camera" not in table:
        camera = _posed(table)
    else:
        for key in _POSE:
            if key in table:
                raise table.error(f"camera is the model's, which has a pose: leave {key} out", key)
        camera = FilmingCamera(_named(table, known))
    fovy_deg = footage.lens.fovy_deg if footage.lens else camera.fovy_deg
    return replace(camera, footage=footage, fovy_deg=fovy_deg)


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
    fovy_deg = table.number("field_of_view_deg", 45.0, above=0)
    if fovy_deg >= 180:
        raise table.error(
            f"field_of_view_deg must be below 180, got {fovy_deg:g}", "field_of_view_deg"
        )
    return FilmingCamera(_ADDED, position, quaternion, fovy_deg)


def _looking(position: np.ndarray, target: np.ndarray, up: np.ndarray) -> tuple[float, ...] | None:
    """The orientation of a camera that looks at a point; None where `up` says no way up."""
    backward = (position - target) / np.linalg.norm(position - target)
    right = np.cross(up, backward)
    if np.linalg.norm(right) < 1e-6 * max(1e-9, float(np.linalg.norm(up))):
        return None
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(backward, right), backward], axis=1)
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, axes.ravel())
    return tuple(map(float, quaternion))
