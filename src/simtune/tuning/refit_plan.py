"""How many known worlds are fitted to judge a fit, and how much of each."""

from typing import NamedTuple

import numpy as np

from simtune.budget import Budget
from simtune.fit import FEW_EPISODES, MANY_EPISODES
from simtune.tuning.posterior_config import PosteriorSearchConfig

_MIN_WHOLE_REFITS = 4  # with time for fewer, they have fewer episodes than the real fit
_MIN_TIME_SHARE = 0.5  # of a fit's: with more left, a refit may be finished


class RefitPlan(NamedTuple):
    """How many known worlds to begin to fit, and the first episodes of each that are played."""

    num_worlds: int
    num_episodes: int

    @classmethod
    def within(
        cls,
        budget: Budget,
        fitted: tuple[int, int],
        fit_s: float,
        picture_s: float,
        config: PosteriorSearchConfig,
    ) -> "RefitPlan":
        """After a fit of `fitted` episodes and steps that took `fit_s`.

        `picture_s`: to draw a picture and to detect in it. A refit that does not end in time is
        dropped. Refits should resemble the real fit; with fewer episodes they err more. But a few
        small ones tell more than one or two large ones.
        """
        num_episodes, num_steps = fitted
        many = min(MANY_EPISODES, num_episodes)
        few = min(FEW_EPISODES, many)
        if budget.is_endless:
            planned = config.planned_refits
            return cls(planned, few if planned < _MIN_WHOLE_REFITS else many)
        each_s, film_s = budget.seconds_left / _MIN_WHOLE_REFITS, (num_steps + 1) * picture_s
        # A refit may take less time, since no latency is searched for.
        is_worth_it = budget.seconds_left > _MIN_TIME_SHARE * fit_s + few * film_s
        episodes = int(np.clip(each_s / (fit_s / num_episodes + film_s), few, many))
        return cls(config.most_refits if is_worth_it else 0, episodes)
