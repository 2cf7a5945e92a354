"""`task = "walker"`: a built-in task before other cameras or backgrounds, or other parameters."""

from dataclasses import replace

import mujoco
import numpy as np

from simtune.errors import UnknownName
from simtune.parameters import Parameter, ParameterSpace
from simtune.simulation.rendering.plate import geoms_coloured_by, stands_still
from simtune.tasks.built_in import TASKS
from simtune.tasks.task import Task
from simtune.tasks.tuning_file.camera import add_cameras
from simtune.tasks.tuning_file.name_all import name_all
from simtune.tasks.tuning_file.parameters import read_known_colours, read_parameters
from simtune.toml_reading import TomlTable, usual_name

_KEYS = ("task", "name", "description", "camera", "cameras", "parameters")


def read_built_in(file: TomlTable) -> Task:
    """The task that a file names, with the file's cameras and parameters, if it has any.

    Its own parameters by default; before a background that is the recordings' or unknown, without
    colours of what stands still, which nobody draws then. Raises InputError.
    """
    file.allow(*_KEYS)
    if (name := file.text("task")) not in TASKS:
        raise file.error(UnknownName("task", name, "simtune", TASKS), "task")
    task = TASKS[name]()
    spec = task.load_spec()
    name_all(spec)
    footage, load_spec = add_cameras(file, spec, task.cameras[0].camera), spec.copy
    if "parameters" in file:
        names, step_s = [f.camera for f in footage], task.control_timestep_s * task.action_repeat
        parameters = read_parameters(file, load_spec(), names, step_s)
    else:
        has_own = all(f.background is None for f in footage)
        parameters = task.parameters if has_own else _of_what_moves(task.parameters, spec)
    return replace(
        task,
        name=file.text("name", usual_name(file.file)),
        description=file.text("description", task.description),
        declared=file.content() + "".join(f.content() for f in footage),
        load_spec=load_spec,
        parameters=parameters,
        known_colours=read_known_colours(file, parameters),
        cameras=footage,
    )


def _of_what_moves(space: ParameterSpace, spec: mujoco.MjSpec) -> ParameterSpace:
    """Without colours of geoms that all stand still."""
    model = spec.copy().compile()
    moves = ~stands_still(model)

    def is_kept(parameter: Parameter) -> bool:
        coloured = geoms_coloured_by(model, parameter) if parameter.is_colour else np.zeros(0, bool)
        return not coloured.any() or bool((coloured & moves).any())

    return ParameterSpace([p for p in space if is_kept(p)], where=space.where)
