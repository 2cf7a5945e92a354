"""Built-in tasks by name, and users' tasks from files.

A new built-in task needs a file in this folder and a line in `built_in`.
"""

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from simtune.errors import InputError, UnknownName
from simtune.tasks.built_in import TASKS
from simtune.tasks.environment_task import EnvironmentTask
from simtune.tasks.known_colours import check_known_is_used, known_values, with_known_colours
from simtune.tasks.task import Task
from simtune.tasks.tuning_file.load import read_task
from simtune.tasks.tuning_file.model import is_xml
from simtune.tasks.tuning_file.named_files import named_files
from simtune.toml_reading import TomlTable, read_toml

AnyTask = Task | EnvironmentTask
IN_PYTHON = "in Python: "  # prefix of the names of tasks that were declared without a file
_LONGEST = 100  # characters of a name, in a message


def load_task(name: str) -> Task:
    """A built-in task, or a tuning file's task, which must have a model. Raises InputError."""
    return with_model(load_any_task(name))


def with_model(task: AnyTask) -> Task:
    """The same task, if it has a model. Raises InputError if it has an environment."""
    if isinstance(task, EnvironmentTask):
        raise InputError(f"{task.name} is of an environment: only `simtune tune` takes those")
    return task


def check_reward(task: AnyTask) -> None:
    """Raises InputError for a task in which no policy can be trained."""
    if with_model(task).reward is None:
        raise InputError(
            f"{task.name} has no reward, so there is nothing to train a policy for: declare one "
            "in the tuning file's [policy] (docs/tuning-file.md)"
        )


_Any = TypeVar("_Any", bound=AnyTask)


def with_one_square_camera(task: _Any) -> _Any:
    """The task with square pictures by one camera, as pixel policies and the paper's search need.

    Raises InputError if it has several cameras.
    """
    if len(task.cameras) > 1:
        raise InputError(
            f"{task.name} has {len(task.cameras)} cameras; policies and the paper's search look "
            "through one: leave the other [[cameras]] out"
        )
    return replace(task, cameras=tuple(replace(f, is_square=True) for f in task.cameras))


def load_any_task(name: str) -> AnyTask:
    """Like `load_task`, but the task may also have an environment instead of a model."""
    if name.startswith(IN_PYTHON):
        raise InputError(
            f"the environment of {name.removeprefix(IN_PYTHON)!r} was an object in Python: no file "
            "holds it"
        )
    if is_xml(name):
        raise InputError(
            "the task is XML text: give a tuning file, or a dict with "
            "model = mujoco.MjSpec.from_string(...)"
        )
    if name.endswith(".toml"):
        path = Path(name).resolve()
        task = read_task(read_toml(Path(name)))
        return replace(task, source=str(path), files=named_files(path))
    if name.endswith((".xml", ".mjcf", ".urdf")):
        raise InputError(f"{name} is a model: give a tuning file that names it, as NAME.toml")
    if name not in TASKS and os.path.isfile(Path(name) / "tune.toml"):  # a name may be too long
        raise InputError(f"{name} is a folder: give its tuning file, {Path(name) / 'tune.toml'}")
    if name not in TASKS:
        raise UnknownName("task", name[:_LONGEST], "simtune (tuning files end in .toml)", TASKS)
    return replace(TASKS[name](), source=name)


def read_declared(values: Mapping[str, Any]) -> AnyTask:
    """The task declared by a dict with a tuning file's keys.

    The model may be a spec, and the environment an object or a function that makes one; later
    commands cannot find such a task again. Raises InputError "task['parameters'][0]: ...".
    """
    task = read_task(TomlTable(dict(values), Path.cwd() / "task.toml"))
    is_object = not isinstance(values.get("environment", ""), str)
    return replace(task, source=f"{IN_PYTHON}{task.name}") if is_object else task


__all__ = [
    "IN_PYTHON",
    "TASKS",
    "AnyTask",
    "Task",
    "check_known_is_used",
    "check_reward",
    "known_values",
    "load_any_task",
    "load_task",
    "named_files",
    "read_declared",
    "with_known_colours",
    "with_model",
    "with_one_square_camera",
]
