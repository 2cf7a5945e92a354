"""Estimates of the time of runs, and of a sweep's remaining time."""

from collections.abc import Iterable, Mapping
from itertools import chain
from statistics import fmean

from simtune.sweep.asked import AskedRun
from simtune.sweep.pilot import Pilots
from simtune.sweep.standing import Standing


class Expectation:
    """Expected wall time of runs: the mean of finished runs of the same kind, else a pilot's."""

    def __init__(self, runs: Iterable[AskedRun], standings: Mapping[str, Standing], pilots: Pilots):
        self._pilots, self._done = pilots, dict[str, list[float]]()
        for run in runs:
            if (standing := standings[run.name]).status == "done":
                # The time seen by a killed driver is known to the run only.
                wall_s = max(standing.spent_s, standing.scores.get("wall_s", 0.0))
                self._done.setdefault(run.kind, []).append(wall_s)

    def __getitem__(self, run: AskedRun) -> float | None:
        """Seconds; the mean of all finished runs if the kind is unknown; None without any."""
        if alike := self._done.get(run.kind):
            return fmean(alike)
        if (pilot := self._pilots.get(run.kind)) and pilot.wall_s is not None:
            return pilot.wall_s
        return fmean(chain(*self._done.values())) if self._done else None


def seconds_left(left_s: Iterable[float | None], workers: int) -> float | None:
    """Seconds until `workers` have done runs of `left_s` seconds each; None if one is unknown.

    This is the longest run or an even share of all, whichever is more. A greedy schedule takes
    between this and twice as much; with many runs, hardly more.
    """
    known = list(left_s)
    if None in known:
        return None
    lengths = [max(0.0, s) for s in known if s is not None]
    return max([sum(lengths) / workers, *lengths], default=0.0)
