"""Run by test_sweep.py to be killed: a sweep of stand-ins. Arguments: GRID OUT WORKERS"""

import sys
from pathlib import Path

from simtune.config import SweepConfig
from simtune.sweep import sweep

STAND_IN = (sys.executable, "-S", str(Path(__file__).with_name("sweep_stand_in.py")))

if __name__ == "__main__":
    grid, out, workers = sys.argv[1:]
    sweep(SweepConfig(grid=Path(grid), out=Path(out), workers=int(workers)), STAND_IN)
