"""What `import simtune` offers: the commands as functions, and what a run found as an object."""

import os

# Before torch is loaded, as the command line does: threads that wait for each other by spinning
# make training five times slower as soon as anything else runs on the machine.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

from simtune.api.commands import check, load, load_task, train, tune
from simtune.api.result import Result

__all__ = ["Result", "check", "load", "load_task", "train", "tune"]
