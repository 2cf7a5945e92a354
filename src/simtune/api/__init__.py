"""The API of `import simtune`: the commands as functions, and a run's result as an object."""

from simtune.api.commands import check, load, load_task, record, train, tune
from simtune.api.result import Result

__all__ = ["Result", "check", "load", "load_task", "record", "train", "tune"]
