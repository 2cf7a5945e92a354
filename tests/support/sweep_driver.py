"""Run by tests of sweeps to be killed: a sweep of stand-ins. Arguments: GRID OUT WORKERS-OR-RAY"""

import os
import signal
import sys
from collections.abc import Mapping
from pathlib import Path

from simtune.config import SweepConfig
from simtune.sweep import sweep

STAND_IN = (sys.executable, "-S", str(Path(__file__).with_name("sweep_stand_in.py")))


def drive(grid: Path, out: Path, by: str) -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)  # shells' background jobs ignore it
    where = {"workers": int(by)} if by.isdigit() else {"ray": by}
    sweep(SweepConfig(grid=grid, out=out, **where), STAND_IN)


def drive_quietly(grid: Path, out: Path, by: str, environment: Mapping[str, str]) -> None:
    """In a forked process, whose environment is that of the process it is forked from."""
    os.environ.update(environment)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    drive(grid, out, by)


if __name__ == "__main__":
    drive(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3])
