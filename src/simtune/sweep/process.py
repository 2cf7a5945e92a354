"""Processes of runs: bound to cores, ended with whoever started them, what they say kept."""

import contextlib
import errno
import os
import subprocess
import sys
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from threading import Lock, Timer

from simtune.sweep.lease import Lease

NO_ROOM = (errno.ENOSPC, errno.EDQUOT)
_LAUNCH = Path(__file__).with_name("launch.py")
_TAIL = 30  # lines that are kept in memory: a full disk keeps none


class Processes:
    """Starts commands and waits for them, from several threads; `stop` ends them all for good."""

    def __init__(self, program: Sequence[str] = (sys.executable, "-m", "simtune")):
        """`program`: what the arguments of a run are given to; its first is an absolute path."""
        self._program, self._live = tuple(program), set[subprocess.Popen[str]]()
        self._lock, self.is_stopped = Lock(), False

    def stop(self) -> None:
        """Runs go on from their checkpoints, so there is nothing to be asked of them first."""
        with self._lock:
            self.is_stopped = True
            for process in self._live:
                process.kill()

    def run(
        self,
        arguments: Sequence[str],
        log: Path,
        lease: Lease,
        cores: Sequence[int],
        limit_s: float | None = None,
    ) -> tuple[int, list[str]]:
        """Its exit status, and the last lines that it said, which are added to `log`.

        It holds `lease` as well, so that no other can begin before it is gone. After `limit_s`
        seconds it is killed. No cores: it is bound to none.
        """
        bound = ",".join(map(str, cores)) or "all"
        launch = [sys.executable, "-I", "-S", str(_LAUNCH), str(os.getpid()), bound]
        process = subprocess.Popen(
            [*launch, *self._program, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            env=os.environ | {"OMP_NUM_THREADS": str(len(cores) or 1)},
            pass_fds=[lease.descriptor],
            start_new_session=True,  # a terminal's Ctrl-C is for `stop` to hand on
        )
        with self._lock:
            self._live.add(process)
            if self.is_stopped:
                process.kill()
        timer = Timer(limit_s, process.kill) if limit_s else None
        try:
            if timer:
                timer.start()
            lines = _read(process, log)
            return process.wait(), lines
        finally:
            if timer:
                timer.cancel()
            with self._lock:
                self._live.remove(process)


def _read(process: subprocess.Popen[str], log: Path) -> list[str]:
    """What it says until it ends: all of it into a file, its last lines returned."""
    assert process.stdout is not None, "a pipe, as asked"
    tail = deque[str](maxlen=_TAIL)
    with process.stdout as said:
        for line in said:
            tail.append(line.strip())
            with _room_or_not(), log.open("a", encoding="utf-8") as file:
                file.write(line)
    return [line for line in tail if line]


@contextlib.contextmanager
def _room_or_not():
    """A full disk only costs the log."""
    try:
        yield
    except OSError as error:
        if error.errno not in NO_ROOM:
            raise
