"""Leases: exclusive use of a run or a core by one process while it lives.

A lease is the kernel's lock of an open file. It ends with the last process that has the file open,
even if that is killed, so nothing has to be cleaned up.
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
    """Released by `close`; child processes that inherit `descriptor` hold it as well."""

    def __init__(self, descriptor: int):
        self.descriptor = descriptor

    @classmethod
    def take(cls, path: Path) -> "Lease | None":
        """A new lease, or None if it is taken. Raises OSError if locks are not supported."""
        try:
            return cls._locked(path, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return None

    @classmethod
    @contextmanager
    def awaited(cls, path: Path) -> Iterator[None]:
        """Wait for a lease and hold it; for short work. Raises OSError."""
        path.parent.mkdir(exist_ok=True)
        lease = cls._locked(path, fcntl.LOCK_EX)
        try:
            yield
        finally:
            lease.close()

    @classmethod
    def _locked(cls, path: Path, how: int) -> "Lease":
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.flock(descriptor, how)
        except OSError:
            os.close(descriptor)
            raise
        return cls(descriptor)

    def close(self) -> None:
        os.close(self.descriptor)


def usable_cores() -> list[int]:
    """Cores that this process may run on; empty if the operating system does not tell."""
    return sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []


@contextmanager
def cores_taken(
    count: int, say: Callable[[str], None], is_over: Callable[[], bool] = lambda: False
) -> Iterator[list[int]]:
    """Wait for `count` cores that no other run of any sweep on this machine uses, and lease them.

    Empty if processes cannot be bound to cores, or once `is_over` says that there is no need. A
    wait is reported once.
    """
    folder = Path(tempfile.gettempdir()) / f"simtune-cores-{os.getuid()}"
    folder.mkdir(exist_ok=True)
    usable = usable_cores()
    leases = _take_cores(folder, usable, count)
    if leases is None:
        say(f"waiting for a core of {', '.join(map(str, usable))} that no other sweep is on")
    while leases is None and not is_over():
        time.sleep(_LOOK_EVERY_S)
        leases = _take_cores(folder, usable, count)
    leases = leases or {}
    try:
        yield sorted(leases)
    finally:
        for lease in leases.values():
            lease.close()


def _take_cores(folder: Path, usable: list[int], count: int) -> dict[int, Lease] | None:
    """Lease `count` cores, or none (None): otherwise two processes could deadlock."""
    leases: dict[int, Lease] = {}
    for core in usable:
        if len(leases) < count and (lease := Lease.take(folder / str(core))):
            leases[core] = lease
    if usable and len(leases) < count:
        for lease in leases.values():
            lease.close()
        return None
    return leases
