"""How long a round may take, and when another one is not worth its time."""

import math
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from simtune.budget import Budget
from simtune.randomization import Distribution
from simtune.tuning.estimate import Estimate

# The parts of a round, as spans of its progress bar
SIMULATE, TRAIN_DETECTOR, TRAIN_POSTERIOR_NET, TRAIN_ESTIMATOR, FIT, FIT_AGAIN, REFIT = pairwise(
    (0.0, 0.1, 0.4, 0.5, 0.55, 0.6, 0.65, 1.0)
)
_MAX_ROUND_RATIO = 1.5  # of a later round's time to a whole first one's
_NEAR_ZERO_SHARE = 0.1  # of the range: half-widths of what is nearer to 0 are not relative to that
_NARROWED_WIDTH_RATIO = 0.8  # of intervals between rounds; below, it pays to go on


class RoundTime(NamedTuple):
    """How long a round may take."""

    budget: Budget  # its part
    is_last: bool  # whether it may be the last one
    whole: Budget  # of this round and all later ones


def plan_round(seconds_left: float, full_s: float, is_last: bool) -> float:
    """Seconds for the next round, if a whole first one takes `full_s`.

    All that is left, if that is not enough for two: one sound round tells more than two unsound.
    """
    if is_last or seconds_left < (1 + _MAX_ROUND_RATIO) * full_s:
        return seconds_left
    return min(_MAX_ROUND_RATIO * full_s, seconds_left / 2)


def half_widths(estimate: Estimate, first: Distribution) -> np.ndarray:
    """(N,) half of each 90 % interval, relative to the estimate.

    Relative to at least a tenth of the first range if the parameter may be 0, such as a colour, and
    to all of it if the parameter may be negative.
    """
    half, low = (estimate.high - estimate.low) / 2, first.space.low
    share = np.select([low > 0, low == 0], [0.0, _NEAR_ZERO_SHARE], 1.0)
    size = np.maximum(np.abs(estimate.mean) * (low >= 0), share * (first.high - first.low))
    return half / np.maximum(size, 1e-12)


def is_precise(widths: np.ndarray, precision: float) -> bool:
    """Whether all (N,) half-widths are within the precision."""
    return bool((widths <= precision).all())


def gains_nothing(before: np.ndarray, now: np.ndarray, precision: float) -> bool:
    """Whether a round narrowed no interval much, of those (N,) not yet within the precision."""
    return bool(((now > _NARROWED_WIDTH_RATIO * before) | (now <= precision)).all())


class Rounds:
    """Counts rounds, plans their time, and decides when to stop."""

    def __init__(self, most: int, precision: float, counted: str = "parameter"):
        """See `PosteriorSearchConfig`: `num_rounds`, `precision`. `counted`: whose widths count."""
        self._most, self._precision, self._counted = most, precision, counted
        self.num_done, self.stop_reason = 0, ""
        self._widths: list[float] | None = None  # relative, of the last round

    def plan(self, budget: Budget, full_s: float) -> RoundTime:
        """The next round's part of the budget; `full_s`: seconds of a whole first round."""
        index = min(self.num_done, self._most - 1)
        span = index / self._most, (index + 1) / self._most
        name, is_last = f"round {self.num_done + 1}: ", index == self._most - 1
        if budget.is_endless:
            part, may_be_last = budget.part(math.inf, span, name), is_last or self._precision > 0
            return RoundTime(part, may_be_last, budget)
        seconds = plan_round(budget.seconds_left, full_s, is_last)
        return RoundTime(budget.part(seconds, span, name), True, budget)

    def end(
        self,
        widths: np.ndarray,
        may_be_known: bool = True,
        is_judged: bool = True,
        lacked_time: bool = False,
    ) -> None:
        """End a round with `half_widths` of what counts.

        `may_be_known`: false if the simulator may lack something, so that narrow intervals prove
        nothing.
        `is_judged`: intervals that no known world has judged say nothing yet.
        `lacked_time`: where time was short for what verdicts rest on, a warning says that a larger
        budget goes on. So the search is not over, however many rounds are done.
        """
        self.num_done += 1
        if lacked_time:
            self.stop_reason = ""
            return
        if not is_judged:
            self.stop_reason = "all rounds are done" if self.num_done >= self._most else ""
            return
        precision, before = self._precision, self._widths
        # A round without a fit repeats the widths, and says nothing.
        may_say = bool(precision and before) and before != widths.tolist()
        if precision and may_be_known and is_precise(widths, precision):
            self.stop_reason = f"every {self._counted} is known to {100 * precision:g} %"
        elif may_say and gains_nothing(np.array(before), widths, precision):
            self.stop_reason = "another round would tell hardly more"
        elif self.num_done >= self._most:
            self.stop_reason = "all rounds are done"
        self._widths = widths.tolist()

    def state(self) -> dict[str, Any]:
        """JSON."""
        return {
            "num_rounds": self.num_done,
            "stop_reason": self.stop_reason,
            "widths": self._widths,
        }

    def load(self, state: dict[str, Any]) -> None:
        self.num_done, self.stop_reason = state["num_rounds"], state["stop_reason"]
        self._widths = state["widths"]
