"""The API of `import simtune`: the commands as functions, and a run's result as an object."""

import os

# Set before torch is loaded, as in cli/program.py: threads that spin while waiting make training
# five times slower as soon as anything else runs on the machine.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

from simtune.api.commands import check, load, load_task, train, tune
from simtune.api.result import Result

__all__ = ["Result", "check", "load", "load_task", "train", "tune"]
