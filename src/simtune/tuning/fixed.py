"""No search: Ξ stays as it is, for domain randomisation and the oracle (Sec. VI-A)."""

from simtune.budget import Budget
from simtune.randomization import Distribution
from simtune.trajectory import Trajectory
from simtune.tuning.estimate import unsure
from simtune.tuning.search import NO_CALLBACKS, Callbacks, Round, Search


class FixedRange(Search):
    """Uses no data and moves nothing."""

    def __init__(self, distribution: Distribution):
        self.distribution = distribution

    @property
    def stop_reason(self) -> str:
        return "nothing is searched for"

    def run_round(
        self,
        real: list[Trajectory],
        budget: Budget,
        callbacks: Callbacks = NO_CALLBACKS,
    ) -> Round:
        return Round(unsure(self.distribution, "not identifiable"), [], {})
