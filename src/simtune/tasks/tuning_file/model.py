"""The model of a tuning file: read from the model file, then changed as the tuning file says."""

import os
from collections.abc import Iterable
from pathlib import Path

import mujoco

from simtune.errors import InputError, one_line
from simtune.tasks.tuning_file.actuators import add_actuators
from simtune.tasks.tuning_file.backlash import add_backlash
from simtune.tasks.tuning_file.camera_sensor import use_fields_of_view
from simtune.tasks.tuning_file.fixed_joints import fix_joints
from simtune.tasks.tuning_file.name_all import name_all
from simtune.tasks.tuning_file.urdf import find_packages, read_urdf
from simtune.toml_reading import TomlTable

_PART = "mujocoinclude"  # the element of an included file


def read_model(file: TomlTable) -> mujoco.MjSpec:
    """The model that the tuning file names, relative to its folder; all objects get names.

    Raises InputError if the model, or a change by the tuning file, is invalid.
    """
    path = file.file.parent / model_name(file)
    spec = file.value("model").copy() if _is_spec(file) else _read(file, path)
    try:
        find_packages(spec, path)
        name_all(spec)
        use_fields_of_view(spec)
        fix_joints(file, spec)
        add_backlash(file, spec)
        add_actuators(file, spec)
        spec.compile()
    except InputError:
        raise
    except ValueError as error:
        folders = [path.parent / folder for folder in ("", spec.meshdir, spec.texturedir)]
        why = _why(error, folders)
        raise file.error(f"MuJoCo cannot compile {model_name(file)}: {why}", "model") from None
    return spec


def model_name(file: TomlTable) -> str:
    """The model's file name, or the name of the spec that a dict has instead. Raises InputError."""
    if "model" in file and isinstance(file.value("model"), mujoco.MjModel):
        raise file.error("a compiled MjModel: give the mujoco.MjSpec, or the file", "model")
    if _is_spec(file):
        return file.value("model").modelname
    name = file.text("model")
    if is_xml(name):
        raise file.error("XML text: give a file, or mujoco.MjSpec.from_string(...)", "model")
    return name


def is_xml(name: str) -> bool:
    """Whether this is a model itself, or other text of many lines, where a name is expected."""
    return "<" in name or "\n" in name


def _is_spec(file: TomlTable) -> bool:
    return "model" in file and isinstance(file.value("model"), mujoco.MjSpec)


def _read(file: TomlTable, path: Path) -> mujoco.MjSpec:
    if not os.path.isfile(path):  # a name may be too long for a file's
        raise file.error(f"there is no model file {path}", "model")
    if path.suffix.lower() == ".xacro":
        raise file.error(f"{path} is no model yet: run xacro on it, and give the result", "model")
    try:
        is_urdf = path.suffix.lower() == ".urdf"
        return read_urdf(path) if is_urdf else mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        why = _why(error, [path.parent])
        raise file.error(f"MuJoCo cannot read {path}: {why}", "model") from None


def _why(error: ValueError, folders: Iterable[Path]) -> str:
    """MuJoCo's message, with the folders it searched if it found no file."""
    said = one_line(error)
    if _PART in said:
        return "it is a part that other models include: give one of those"
    if "opening file" not in said:
        return said
    looked = ", ".join(dict.fromkeys(map(str, folders)))
    return f"{said}; it was looked for in {looked}, and beside the file that includes it"
