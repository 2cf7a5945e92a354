"""The model of a tuning file: what the model file says, and what the tuning file changes in it."""

import re
from collections.abc import Iterable
from pathlib import Path

import mujoco

from simtune.errors import InputError, one_line
from simtune.tasks.tuning_file.actuators import add_actuators
from simtune.tasks.tuning_file.backlash import add_backlash
from simtune.tasks.tuning_file.fixed_joints import fix_joints
from simtune.tasks.tuning_file.name_all import name_all
from simtune.tasks.tuning_file.toml_table import TomlTable


def read_model(file: TomlTable) -> mujoco.MjSpec:
    """The model that `file` names, beside it; everything in it has a name.

    Raises InputError for what is wrong with it, or with what the file changes.
    """
    path = file.file.parent / file.text("model")
    if not path.is_file():
        raise file.error(f"there is no model file {path}", "model")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        why = _why(error, [path.parent])
        raise file.error(f"MuJoCo cannot read {path}: {why}", "model") from None
    try:
        _find_packages(spec, path)
        name_all(spec)
        fix_joints(file, spec)
        add_backlash(file, spec)
        add_actuators(file, spec)
        spec.compile()
    except InputError:
        raise
    except ValueError as error:
        folders = [path.parent / folder for folder in ("", spec.meshdir, spec.texturedir)]
        why = _why(error, folders)
        raise file.error(f"MuJoCo cannot compile {file.text('model')}: {why}", "model") from None
    return spec


def _find_packages(spec: mujoco.MjSpec, model: Path) -> None:
    """Put URDF's "package://NAME/FILE" where it is: in a folder NAME, or beside the model."""
    for mesh in spec.meshes:
        if not (words := re.fullmatch(r"package:/+([^/]+)/(.+)", mesh.file)):
            continue
        package, file = words.groups()
        folders = model.resolve().parents
        places = [folder / package / file for folder in folders]
        places += [folder / file for folder in folders if folder.name == package]
        places += [folders[0] / file, folders[0] / Path(file).name]
        if found := next((place for place in places if place.is_file()), None):
            mesh.file = str(found)


def _why(error: ValueError, folders: Iterable[Path]) -> str:
    """What MuJoCo says, and where it looked if it found no file."""
    said = one_line(error)
    if "opening file" not in said:
        return said
    looked = ", ".join(dict.fromkeys(map(str, folders)))
    return f"{said}; it was looked for in {looked}, and beside the file that includes it"
