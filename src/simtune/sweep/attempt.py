"""Carries out a run: repeats the ordinary command in its folder until it is done or failed."""

import errno
import os
import re
import signal
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from simtune.sweep.asked import AskedRun
from simtune.sweep.lease import Lease, cores_taken
from simtune.sweep.process import NO_ROOM, Processes
from simtune.sweep.standing import Places, Standing

_FULL = tuple(map(os.strerror, NO_ROOM))
_ROOM_PAUSES_S = (1.0, 5.0, 20.0, 60.0)  # between attempts while the disk is full
_OTHERS_PAUSE_S = 0.5  # after a look at a run that another process has
_LONGEST_REASON = 300  # characters
_UNUSABLE = 2  # exit status for unusable input, which is so the next time as well
# Except this, which the machine's load decides; see `experiment.enough_time`
_TOO_SHORT = re.compile(r"--budget-minutes \S+ is too short")


@dataclass(frozen=True, kw_only=True)
class Attempts:
    """Settings common to all runs of a sweep."""

    folder: Path  # of the sweep
    retries: int
    cores_per_run: int
    processes: Processes
    say: Callable[[str], None] = print

    def carry_out(self, run: AskedRun) -> Standing:
        """Try a run until it is done or has failed too often; returns its final standing.

        Or "waiting", if another process has the run. Waits while the disk is full. All state is in
        files, so it continues where an earlier process was killed.
        """
        places, pauses = Places(self.folder, run.name), iter(_ROOM_PAUSES_S)
        while True:
            standing = places.standing(self.retries)
            if standing.status != "waiting" or self.processes.is_stopped:
                return standing
            try:
                if not self._try(run, places):
                    self._sleep(_OTHERS_PAUSE_S)
                    return standing
            except OSError as error:
                if error.errno not in NO_ROOM:
                    raise
                pause_s = next(pauses, _ROOM_PAUSES_S[-1])
                self.say(f"{run.name}: the disk is full; the next look in {pause_s:g} s")
                self._sleep(pause_s)

    def _try(self, run: AskedRun, places: Places) -> bool:
        """Make one attempt and note a failure; False if another process has the run.

        Raises OSError if the disk is full.
        """
        places.make_folders()
        if not (lease := Lease.take(places.lease)):
            return False
        try:
            wanted = cores_taken(self.cores_per_run, self.say, lambda: self.processes.is_stopped)
            with wanted as cores:
                # Another process may have finished the run during the wait for lease and cores.
                if places.standing(self.retries).status == "waiting":
                    arguments = run.arguments(places.run)
                    began_s = time.monotonic()
                    status, lines = self.processes.run(arguments, places.log, lease, cores)
                    if not self.processes.is_stopped:
                        self._note(places, time.monotonic() - began_s, status, lines)
        finally:
            lease.close()
        return True

    def _note(self, places: Places, spent_s: float, status: int, lines: list[str]) -> None:
        if status == 0 and places.standing(self.retries).status == "done":
            places.note(spent_s)
            return
        if any(words in line for words in _FULL for line in lines):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        reason = lines[-1][:_LONGEST_REASON] if lines else "it said nothing"
        if status == 0:
            reason = "it ended without a result.json and a report.html"
        by = f"killed by {_signal_name(-status)}" if status < 0 else f"exit status {status}"
        is_final = status == _UNUSABLE and not _TOO_SHORT.search(reason)
        failures = self.retries + 1 if is_final else 1
        places.note(spent_s, f"{by}: {reason}", killed=status < 0, failures=failures)

    def _sleep(self, seconds: float) -> None:
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s and not self.processes.is_stopped:
            time.sleep(min(0.2, seconds))


def _signal_name(number: int) -> str:
    """SIGKILL, say; real-time signals have no name."""
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
