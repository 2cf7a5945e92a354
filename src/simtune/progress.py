"""Progress of long work, as a command reports it."""

import logging
import math
import sys
import time
from collections.abc import Callable

from tqdm import tqdm

# What is being done, and the share of the whole that is done
ReportProgress = Callable[[str, float], None]

log = logging.getLogger(__name__)
_LINE_EVERY_S = 15.0


def silent(doing: str, done: float) -> None:
    """Report nothing."""


def told(warnings: list[str]) -> list[str]:
    """The warnings, which are logged: at once, not after minutes."""
    for warning in warnings:
        log.warning("%s", warning)
    return warnings


class _AboveTheBar(logging.Handler):
    """Prints messages above the bar."""

    def emit(self, record: logging.LogRecord) -> None:
        tqdm.write(self.format(record), file=sys.stderr)


class ProgressBar:
    """Use as a `ReportProgress`; a context manager, so that the terminal is left tidy.

    While open, it shows simtune's log from INFO on.
    """

    def __init__(self, total_s: float = math.inf):
        """`total_s`: longest time of the whole, for the first estimates."""
        self._bar = tqdm(
            total=100.0,
            bar_format="{percentage:3.0f} %|{bar:24}| {desc} [{elapsed}, about {remaining} left]",
            disable=not sys.stderr.isatty(),
        )
        self._start, self._total_s = time.monotonic(), total_s
        self._doing, self._last_line = "", -_LINE_EVERY_S
        self._log, self._handler = logging.getLogger("simtune"), _AboveTheBar()
        self._level = self._log.level

    def __call__(self, doing: str, done: float) -> None:
        now = time.monotonic()
        # The share of the time keeps the bar moving while the work's share does not.
        spent = (now - self._start) / self._total_s
        done = min(max(done, min(spent, 0.99)), 1.0)
        if spent > 1:
            doing += " (time is over; what has begun ends first)"
        if not self._bar.disable:
            self._bar.set_description_str(doing, refresh=False)
            if doing != self._doing:  # perhaps a training after a search, which begins at 0
                self._bar.n = 100 * done
                self._bar.refresh()
            self._bar.update(max(0.0, 100 * done - self._bar.n))
        elif doing != self._doing or now - self._last_line > _LINE_EVERY_S:
            print(
                f"{now - self._start:5.0f} s {100 * done:3.0f} %  {doing}",
                file=sys.stderr,
                flush=True,
            )
            self._last_line = now
        self._doing = doing

    def __enter__(self) -> "ProgressBar":
        self._log.addHandler(self._handler)
        self._log.setLevel(logging.INFO)
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.close()
        self._log.removeHandler(self._handler)
        self._log.setLevel(self._level)
