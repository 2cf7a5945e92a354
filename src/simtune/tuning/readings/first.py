"""Joint readings, fitted alone before the first round of a search that looks at videos."""

import math
from typing import Any

from simtune.budget import Budget
from simtune.trajectory import Trajectory
from simtune.tuning.readings.estimate import ReadingsEstimate, search_of
from simtune.tuning.readings.search import ReadingsSearch
from simtune.tuning.search import SearchContext

_TIME_SHARE = 0.35  # of all time
# At least, since keypoints of what readings tell are not looked for (`keypoints_of_run`)
_MIN_TIME_SHARE = 0.15
_ROBOT_TIME_SHARES = 0.5, 0.35  # if videos tell little of a robot's motion that readings do not
_NO_TIME = (
    "There was no time to fit the joint readings alone, over whole episodes, before the videos: "
    "that takes {:.0f} s here, {:.0f} s were left for it. Windows of a quarter of a second, which "
    "are fitted with the videos, tell less of servos, dampings and frictions. Give it more "
    "minutes, or look at the readings alone (--observe joints)."
)


def seconds_for(left_s: float, round_s: float, knows_robot: bool) -> float:
    """Of the time that is left, before a round; `knows_robot`: where all but loose objects is.

    If videos cannot be fitted in what the least share leaves, readings get all that they may.
    """
    if math.isinf(left_s):
        return left_s
    most, least = _ROBOT_TIME_SHARES if knows_robot else (_TIME_SHARE, _MIN_TIME_SHARE)
    spare = left_s - round_s
    return min(most * left_s, spare) if spare >= least * left_s else most * left_s


class ReadingsFirst:
    """What the readings of a run's first episodes tell; fitted once in each session."""

    def __init__(self, context: SearchContext):
        self._context = context
        self._estimate: ReadingsEstimate | None = None
        self.warnings: list[str] = []
        # Episodes before the first round, which come last in later ones; a later session reads the
        # same ones again
        self._num_episodes = 0

    @property
    def lacked_time(self) -> bool:
        """Whether in this session something was left out that more time may tell."""
        return bool(self.warnings) or (self._estimate is not None and self._estimate.lacked_time)

    def measure_s(self, real: list[Trajectory]) -> float:
        """Seconds that `fit` would usually take, if there were enough."""
        if not self._context.can_fit or not (found := search_of(self._context, real)):
            return 0.0
        return found[0].measure_time(real).whole_s

    def fit(
        self, real: list[Trajectory], round_s: float, budget: Budget
    ) -> ReadingsEstimate | None:
        """None if readings alone tell nothing, see `search_of`, or whole episodes take too long.

        `round_s`: what the smallest sound round needs of the time.
        """
        if self._estimate is None and self._context.can_fit:
            self._num_episodes = self._num_episodes or len(real)
            first, self.warnings = real[-self._num_episodes :], []
            if found := search_of(self._context, first):
                search, loop = found
                seconds = seconds_for(budget.seconds_left, round_s, loop.measured.knows_robot)
                self._fit(search, first, budget.part(seconds, (0.0, 0.1), "readings: "))
        return self._estimate

    def _fit(self, search: ReadingsSearch, real: list[Trajectory], budget: Budget) -> None:
        least_s = 0.0 if budget.is_endless else search.measure_time(real).least_s
        if least_s > (left_s := budget.seconds_left):
            self.warnings = [_NO_TIME.format(least_s, max(left_s, 0.0))]
        else:
            self._estimate = ReadingsEstimate.fitted(search, real, budget)

    def state(self) -> dict[str, Any]:
        """JSON."""
        return {"num_episodes": self._num_episodes}

    def load(self, state: dict[str, Any]) -> None:
        self._num_episodes = state["num_episodes"]
