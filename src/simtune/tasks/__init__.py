"""The built-in tasks by name; add one by a file here and a line in TASKS. Users' own are files."""

from collections.abc import Callable
from pathlib import Path

from simtune.errors import InputError, UnknownName
from simtune.tasks import (
    ball_in_cup,
    cabinet_slide,
    cartpole,
    cheetah,
    finger,
    rope_peg,
    walker,
)
from simtune.tasks.task import Task
from simtune.tasks.tuning_file import load_tuning_file

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
    """A built-in task, or the one that a tuning file declares. Raises InputError."""
    if name.endswith(".toml"):
        return load_tuning_file(Path(name))
    if name.endswith((".xml", ".mjcf", ".urdf")):
        raise InputError(f"{name} is a model: give a tuning file that names it, as NAME.toml")
    if name not in TASKS:
        raise UnknownName("task", name, "simtune", TASKS)
    return TASKS[name]()


__all__ = ["TASKS", "Task", "load_task"]
