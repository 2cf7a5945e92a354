"""How long rounds of the posterior search would take here."""

from typing import NamedTuple

from simtune.search_param_model.posterior import PosteriorSearchParamModel
from simtune.trajectory import Trajectory
from simtune.tuning.pace import Pace, Work, smallest
from simtune.tuning.posterior_config import PosteriorSearchConfig
from simtune.tuning.search import SearchContext, TimeNeeded


class RoundTimes(NamedTuple):
    """Seconds of a first round, and of one of its pictures."""

    least_s: float  # of the smallest sound round
    whole_s: float
    picture_s: float  # to draw one, and to detect in it


def measure_times(
    context: SearchContext,
    model: PosteriorSearchParamModel,
    config: PosteriorSearchConfig,
    real: list[Trajectory],
) -> tuple[RoundTimes, TimeNeeded]:
    """Of rounds with these episodes; without what comes before the first one."""
    pace = Pace.measure(context, model, context.first)
    can_fit, least = context.can_fit, smallest(config)
    work = Work.of(context.simulator, real, can_fit)
    times = RoundTimes(
        least_s=pace.round_s(least, work),
        whole_s=pace.round_s(config, work),
        picture_s=pace.frame_s + pace.detect_s,
    )
    check_s = pace.check_s(work, bool(context.observation.sensors)) * can_fit
    return times, TimeNeeded(times.least_s, times.whole_s, check_s, pace.mostly(least, work))
