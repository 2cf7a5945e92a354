"""Processes of runs: bound to cores, ended with their parent process, output logged."""

import contextlib
import errno
import os
import signal
import subprocess
import sys
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from threading import Lock, Timer

from simtune.sweep.lease import Lease

NO_ROOM = (errno.ENOSPC, errno.EDQUOT)
_LAUNCH = Path(__file__).with_name("launch.py")
_TAIL = 30  # lines kept in memory, since a full disk cannot keep the log


class Processes:
    """Starts commands and waits for them, from several threads; `stop` ends all of them."""

    def __init__(self, program: Sequence[str] | None = None):
        """`program`: the command that gets a run's arguments; it starts with an absolute path.

        By default this machine's simtune, which may lie elsewhere than that of a sweep's driver.
        """
        self._program = tuple(program or (sys.executable, "-m", "simtune"))
        self._live = set[subprocess.Popen[str]]()
        self._lock, self.is_stopped = Lock(), False

    def stop(self) -> None:
        """Kill all processes, now and in future; runs resume from their checkpoints."""
        with self._lock:
            self.is_stopped = True
            for process in self._live:
                _kill(process)

    def run(
        self,
        arguments: Sequence[str],
        log: Path,
        lease: Lease,
        cores: Sequence[int],
        limit_s: float | None = None,
    ) -> tuple[int, list[str]]:
        """Run a command; returns its exit status and last lines. Its output is added to `log`.

        The process inherits `lease`, so that no other can start before it has ended. It is killed
        after `limit_s` seconds. Without `cores`, it is not bound to any.
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
            start_new_session=True,  # a terminal's Ctrl-C reaches it only through `stop`
        )
        with self._lock:
            self._live.add(process)
            if self.is_stopped:
                _kill(process)
        timer = Timer(limit_s, _kill, [process]) if limit_s else None
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


def _kill(process: subprocess.Popen[str]) -> None:
    """Kill it and all that it has started, which would keep its output open."""
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


def _read(process: subprocess.Popen[str], log: Path) -> list[str]:
    """Copy a process's output into a file until it ends; returns the last lines."""
    assert process.stdout is not None, "a pipe, as asked"
    tail = deque[str](maxlen=_TAIL)
    with process.stdout as output:
        for line in output:
            tail.append(line.strip())
            with _room_or_not(), log.open("a", encoding="utf-8") as file:
                file.write(line)
    return [line for line in tail if line]


@contextlib.contextmanager
def _room_or_not():
    """Ignore a full disk: only the log is lost."""
    try:
        yield
    except OSError as error:
        if error.errno not in NO_ROOM:
            raise
