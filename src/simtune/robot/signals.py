"""Signals that end a process: what moves is stopped first."""

import signal
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

_TOLD_TO_END = (signal.SIGTERM, signal.SIGHUP)  # the latter as a terminal is closed


class ToldToEnd(SystemExit):
    """Ends the process, with the exit status that shells give to the signal."""

    def __init__(self, number: int):
        super().__init__(128 + number)
        self._name = signal.Signals(number).name

    def __str__(self) -> str:
        return f"the process was told to end by {self._name}"


@contextmanager
def ended_in_order() -> Iterator[None]:
    """Have SIGTERM and SIGHUP raise ToldToEnd, since Python would die at once.

    One that is ignored, as under `nohup`, or that somebody else handles, is left alone.
    """
    usual = [number for number in _TOLD_TO_END if signal.getsignal(number) is signal.SIG_DFL]
    with _handled(usual, _end):
        yield


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Ignore Ctrl-C and these, so that a second one does not prevent the first from stopping."""
    with _handled((signal.SIGINT, *_TOLD_TO_END), signal.SIG_IGN):
        yield


def _end(number: int, _: object) -> None:
    raise ToldToEnd(number)


@contextmanager
def _handled(numbers: Iterable[signal.Signals], handler: Any) -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield  # signals go to the main thread, and only it may set handlers
        return
    # None: something other than Python handles it, which could not be put back
    ours = [number for number in numbers if signal.getsignal(number) is not None]
    before = {number: signal.signal(number, handler) for number in ours}
    try:
        yield
    finally:
        for number, former in before.items():
            signal.signal(number, former)
