"""The built-in tasks by name; add one by a file here and a line in TASKS. Users' own are files."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from simtune.errors import InputError, UnknownName
from simtune.tasks import ball_in_cup, cabinet_slide, cartpole, cheetah, finger, rope_peg, walker
from simtune.tasks.environment_task import EnvironmentTask
from simtune.tasks.known_colours import known_values, with_known_colours
from simtune.tasks.task import Task
from simtune.tasks.tuning_file import TomlTable, load_tuning_file, named_files, read_task

AnyTask = Task | EnvironmentTask
IN_PYTHON = "in Python: "  # before the names of tasks that no file holds

TASKS: dict[str, Callable[[], Task]] = {
    "ball_in_cup": ball_in_cup.catch,
    "walker": walker.walk,
    "cheetah": cheetah.run,
    "finger": finger.spin,
    "rope_peg": rope_peg.insert,
    "cabinet_slide": cabinet_slide.slide,
    "cartpole": cartpole.balance,
}


def load_task(name: str) -> Task:
    """A built-in task, or the one of a model that a tuning file declares. Raises InputError."""
    return with_model(load_any_task(name))


def with_model(task: AnyTask) -> Task:
    """The task, which has to be of a model. Raises InputError for one of an environment."""
    if isinstance(task, EnvironmentTask):
        raise InputError(f"{task.name} is of an environment: only `simtune tune` takes those")
    return task


_Any = TypeVar("_Any", bound=AnyTask)


def before_one_camera(task: _Any) -> _Any:
    """The task as a policy on pixels sees it, and the paper's search: a square by one camera.

    Raises InputError for one of several cameras.
    """
    if len(task.cameras) > 1:
        raise InputError(
            f"{task.name} has {len(task.cameras)} cameras; policies and the paper's search look "
            "through one: leave the other [[cameras]] out"
        )
    return replace(task, cameras=tuple(replace(f, is_square=True) for f in task.cameras))


def load_any_task(name: str) -> AnyTask:
    """The same, of a model or of an environment."""
    if name.startswith(IN_PYTHON):
        raise InputError(
            f"the environment of {name.removeprefix(IN_PYTHON)!r} was an object in Python: no file "
            "holds it"
        )
    if name.endswith(".toml"):
        path = Path(name).resolve()
        task = load_tuning_file(Path(name))
        return replace(task, source=str(path), files=named_files(path))
    if name.endswith((".xml", ".mjcf", ".urdf")):
        raise InputError(f"{name} is a model: give a tuning file that names it, as NAME.toml")
    if name not in TASKS and (Path(name) / "tune.toml").is_file():
        raise InputError(f"{name} is a folder: give its tuning file, {Path(name) / 'tune.toml'}")
    if name not in TASKS:
        raise UnknownName("task", name, "simtune (tuning files end in .toml)", TASKS)
    return replace(TASKS[name](), source=name)


def read_declared(values: Mapping[str, Any]) -> AnyTask:
    """The task of a dict that has a tuning file's keys.

    A model may be a spec, and an environment what makes one, which no later command finds again.
    Raises InputError "task['parameters'][0]: what is wrong".
    """
    task = read_task(TomlTable(dict(values), Path.cwd() / "task.toml"))
    is_object = not isinstance(values.get("environment", ""), str)
    return replace(task, source=f"{IN_PYTHON}{task.name}") if is_object else task


__all__ = [
    "IN_PYTHON",
    "TASKS",
    "AnyTask",
    "EnvironmentTask",
    "Task",
    "before_one_camera",
    "known_values",
    "load_any_task",
    "load_task",
    "named_files",
    "read_declared",
    "with_known_colours",
    "with_model",
]
