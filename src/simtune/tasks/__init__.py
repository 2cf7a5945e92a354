"""The built-in tasks by name; add one by a file here and a line in TASKS."""

from collections.abc import Callable

from simtune.errors import UnknownName
from simtune.tasks import ball_in_cup, cartpole, cheetah, finger, walker
from simtune.tasks.task import Task

TASKS: dict[str, Callable[[], Task]] = {
    "ball_in_cup": ball_in_cup.catch,
    "walker": walker.walk,
    "cheetah": cheetah.run,
    "finger": finger.spin,
    "cartpole": cartpole.balance,
}


def load_task(name: str) -> Task:
    """A built-in task. Raises UnknownName."""
    if name not in TASKS:
        raise UnknownName("task", name, "simtune", TASKS)
    return TASKS[name]()


__all__ = ["TASKS", "Task", "load_task"]
