"""How long runs take, and what is left of a sweep."""

from collections.abc import Iterable, Mapping
from itertools import chain
from statistics import fmean

from simtune.sweep.asked import AskedRun
from simtune.sweep.pilot import Pilots
from simtune.sweep.standing import Standing


class Expectation:
    """Wall time of runs: the mean of finished ones of the same kind, else a pilot's."""

    def __init__(self, runs: Iterable[AskedRun], standings: Mapping[str, Standing], pilots: Pilots):
        self._pilots, self._done = pilots, dict[str, list[float]]()
        for run in runs:
            if (standing := standings[run.name]).status == "done":
                # What a killed driver saw of it, only the run itself remembers.
                wall_s = max(standing.spent_s, standing.scores.get("wall_s", 0.0))
                self._done.setdefault(run.kind, []).append(wall_s)

    def __getitem__(self, run: AskedRun) -> float | None:
        """Seconds; as of all finished runs where nothing is known of its kind, or else None."""
        if alike := self._done.get(run.kind):
            return fmean(alike)
        if (pilot := self._pilots.get(run.kind)) and pilot.wall_s is not None:
            return pilot.wall_s
        return fmean(chain(*self._done.values())) if self._done else None


def seconds_left(left_s: Iterable[float | None], workers: int) -> float | None:
    """Until `workers` have done work of so many seconds each; None where one is unknown.

    No less than the longest, nor than an even share of all: a greedy schedule ends between this
    and twice as much, the nearer to it the more runs there are.
    """
    known = list(left_s)
    if None in known:
        return None
    lengths = [max(0.0, s) for s in known if s is not None]
    return max([sum(lengths) / workers, *lengths], default=0.0)
