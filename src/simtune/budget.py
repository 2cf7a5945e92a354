"""How long work may take, and where it reports progress: handed down, part by part."""

import math
import time
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from simtune.progress import ReportProgress, silent

T = TypeVar("T")


class OutOfTime(Exception):
    """The time is over, and unfinished work is not worth more of it."""


class Budget:
    """A deadline, and a stretch of the progress bar.

    A command makes one; each piece of work gets a `part`, and only knows its own share. Without a
    limit, as in trainings, a budget only reports: work that is limited by time cannot be repeated
    bit for bit.
    """

    def __init__(
        self,
        seconds: float = math.inf,
        report: ReportProgress = silent,
        *,
        span: tuple[float, float] = (0.0, 1.0),
        prefix: str = "",
    ):
        """`seconds` from now on; `span`: shares of the bar at which the work starts and ends.

        Raises ValueError for NaN, which would pass for a budget that is over.
        """
        if math.isnan(seconds):
            raise ValueError("a budget must be a number of seconds, got NaN")
        self.seconds = max(seconds, 0.0)
        self._start, self._report, self._span, self._prefix = time.monotonic(), report, span, prefix

    @property
    def spent(self) -> float:
        """Share of the time that is over; more than 1 if it was exceeded."""
        return (time.monotonic() - self._start) / max(self.seconds, 1e-3)

    @property
    def seconds_left(self) -> float:
        return max(0.0, self._start + self.seconds - time.monotonic())

    @property
    def is_over(self) -> bool:
        return self.seconds_left == 0

    def check(self) -> None:
        """Raises OutOfTime if it is over."""
        if self.is_over:
            raise OutOfTime(f"the {self.seconds:.0f} s for this are over")

    @property
    def is_endless(self) -> bool:
        return math.isinf(self.seconds)

    def allows_another(self, num_done: int) -> bool:
        """Whether another piece of work, as long as each of `num_done` so far, ends in time."""
        return self.spent * (num_done + 1) <= num_done

    def each(self, work: Iterable[T]) -> Iterator[T]:
        """The pieces of `work`, the first one in any case, while it `allows_another`."""
        for num_done, piece in enumerate(work, 1):
            yield piece
            if not self.allows_another(num_done):
                break

    def report(self, doing: str, done: float = 0.0) -> None:
        """Report what is being done, and how much of this budget's work is done, 0 to 1."""
        low, high = self._span
        self._report(self._prefix + doing, low + (high - low) * min(1.0, done))

    def part(
        self, seconds: float, span: tuple[float, float] = (0.0, 1.0), prefix: str = ""
    ) -> "Budget":
        """`seconds` of it from now on, at most what is left, and a part of its bar."""
        low, high = self._span
        stretch = (low + (high - low) * span[0], low + (high - low) * span[1])
        given_s = min(seconds, self.seconds_left)  # NaN stays NaN, which is refused
        return Budget(given_s, self._report, span=stretch, prefix=self._prefix + prefix)

    def share(self, share: float, span: tuple[float, float] = (0.0, 1.0)) -> "Budget":
        """A share of all its time, from now on; at most what is left."""
        return self.part(share * self.seconds, span)


NO_LIMIT = Budget()  # which reports nowhere


def timed(work: Callable[[], T]) -> tuple[float, T]:
    """The seconds that `work` takes, and what it gives."""
    began_s = time.monotonic()
    done = work()
    return time.monotonic() - began_s, done
