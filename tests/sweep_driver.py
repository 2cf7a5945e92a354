"""Run by tests of sweeps to be killed: a sweep of stand-ins. Arguments: GRID OUT WORKERS-OR-RAY"""

import signal
import sys
from pathlib import Path

from simtune.config import SweepConfig
from simtune.sweep import sweep

STAND_IN = (sys.executable, "-S", str(Path(__file__).with_name("sweep_stand_in.py")))

if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.default_int_handler)  # shells' background jobs ignore it
    grid, out, by = sys.argv[1:]
    where = {"workers": int(by)} if by.isdigit() else {"ray": by}
    sweep(SweepConfig(grid=Path(grid), out=Path(out), **where), STAND_IN)
