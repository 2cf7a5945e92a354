"""What one process has to itself while it lives: a run, or a core.

A lease is the kernel's lock of an open file. It ends with the last process that holds the file
open, however that ends, so nothing has to be cleaned up after a kill.
"""

import fcntl
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

_LOOK_EVERY_S = 0.2  # for a free core


class Lease:
    """Given back by `close`; children that inherit `descriptor` hold it as well."""

    def __init__(self, descriptor: int):
        self.descriptor = descriptor

    @classmethod
    def take(cls, path: Path) -> "Lease | None":
        """None where it is taken. Raises OSError where no lock can be had."""
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
            return None
        except OSError:
            os.close(descriptor)
            raise
        return cls(descriptor)

    def close(self) -> None:
        os.close(self.descriptor)


def usable_cores() -> list[int]:
    """Those that this process may run on; none where an operating system does not say."""
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []


@contextmanager
def cores_taken(count: int, say: Callable[[str], None] = print) -> Iterator[list[int]]:
    """So many cores that no other run of any sweep on this machine is on, as soon as there are.

    Empty where processes cannot be bound to cores. What it waits for is said once.
    """
    folder = Path(tempfile.gettempdir()) / f"simtune-cores-{os.getuid()}"
    folder.mkdir(exist_ok=True)
    usable = usable_cores()
    leases = _take_cores(folder, usable, count)
    if leases is None:
        say(f"waiting for a core of {', '.join(map(str, usable))} that no other sweep is on")
    while leases is None:
        time.sleep(_LOOK_EVERY_S)
        leases = _take_cores(folder, usable, count)
    try:
        yield sorted(leases)
    finally:
        for lease in leases.values():
            lease.close()


def _take_cores(folder: Path, usable: list[int], count: int) -> dict[int, Lease] | None:
    """All of them or none, or two could wait for each other's for ever."""
    leases: dict[int, Lease] = {}
    for core in usable:
        if len(leases) < count and (lease := Lease.take(folder / str(core))):
            leases[core] = lease
    if usable and len(leases) < count:
        for lease in leases.values():
            lease.close()
        return None
    return leases
