"""The model of a tuning file: what the model file says, and what the tuning file changes in it."""

import mujoco

from simtune.errors import InputError, one_line
from simtune.tasks.tuning_file.actuators import add_actuators
from simtune.tasks.tuning_file.fixed_joints import fix_joints
from simtune.tasks.tuning_file.object_names import name_all
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
        raise file.error(f"MuJoCo cannot read {path}: {one_line(error)}", "model") from None
    try:
        name_all(spec)
        fix_joints(file, spec)
        add_actuators(file, spec)
        spec.compile()
    except InputError:
        raise
    except ValueError as error:
        model = file.text("model")
        raise file.error(f"MuJoCo cannot compile {model}: {one_line(error)}", "model") from None
    return spec
