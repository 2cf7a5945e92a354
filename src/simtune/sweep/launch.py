"""Replaces itself by another command that is bound to cores and ends with its parent process.

A script, started with `python -I -S`: PARENT CORES COMMAND... PARENT is the parent's process id;
CORES are numbers separated by commas, or `all`. It imports nothing of simtune, so that it does not
delay the run's start.
"""

import ctypes
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1  # from <sys/prctl.h>; the setting survives exec


def main() -> None:
    parent, cores, *command = sys.argv[1:]
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() != int(parent):  # the parent died before prctl took effect
            sys.exit("what started this run is gone")
        if cores != "all":
            os.sched_setaffinity(0, {int(core) for core in cores.split(",")})
    os.execv(command[0], command)


if __name__ == "__main__":
    main()
