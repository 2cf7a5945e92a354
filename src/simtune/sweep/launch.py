"""Becomes another command, bound to its cores, which ends with the process that started it.

A script, started with `python -I -S`: PARENT CORES COMMAND... PARENT is that process's number;
CORES are numbers with commas between, or `all`. It imports nothing of simtune, so that a run
starts no later for it.
"""

import ctypes
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1  # <sys/prctl.h>; it outlives an exec


def main() -> None:
    parent, cores, *command = sys.argv[1:]
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != int(parent):  # it died before it could be watched
            sys.exit("what started this run is gone")
        if cores != "all":
            os.sched_setaffinity(0, {int(core) for core in cores.split(",")})
    os.execv(command[0], command)


if __name__ == "__main__":
    main()
