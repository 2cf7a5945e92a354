"""A fit to joint readings alone, over whole episodes, before videos are used.

With video the motion is fitted in windows of a quarter of a second, which tell less of a servo than
a whole episode. So readings are fitted first. The parameters that they identify are held while
videos determine the rest, if two fits agree. If everything is read but loose objects, readings give
the robot's motion as well (`fit.readings.joint_motion`), and all that they tell of its parameters
is held, even if there was no time for a second fit: measured angles correct the motion, and no
window of a quarter of a second knows servos better. Refits of known worlds include the cost, since
they start as far from the truth as the readings' fit may be. In the end each parameter is taken
from the better of both.
"""

import math
from dataclasses import replace

import numpy as np

from simtune.budget import Budget
from simtune.fit import (
    FitConfig,
    JointMotion,
    OpenLoopReplay,
    PointEstimate,
    Unexplained,
    correlated_pairs,
    set_up_loop,
)
from simtune.observation import advanced, finds_offset
from simtune.randomization import Distribution
from simtune.simulation import Simulator
from simtune.trajectory import Trajectory, delayed
from simtune.tuning.estimate import Estimate
from simtune.tuning.readings.combined import (
    contradicting,
    covering_both,
    doubted_beside_film,
    merged,
    normal_std,
)
from simtune.tuning.readings.search import ReadingsSearch
from simtune.tuning.readings.verdict import ReadingsResult
from simtune.tuning.search import SearchContext

_NO_SAY = "Joint readings alone had no say in the estimates: "


def search_of(
    context: SearchContext, real: list[Trajectory]
) -> tuple[ReadingsSearch, OpenLoopReplay] | None:
    """With what replays the readings; None if there are none, or they could show nothing.

    Also None if joints that nothing measures begin anywhere and readings show where, such as a
    walker's torso: windows are replayed then, of which pictures show the states, too.
    """
    simulator, seen = context.simulator, context.observation
    is_readable = bool(seen.sensors) and not simulator.space.is_appearance.all()
    if not is_readable or not isinstance(simulator, Simulator):
        return None
    search = ReadingsSearch(context)
    loop = search.look_at(real)[1]
    return None if loop.unseen else (search, loop)


class ReadingsEstimate:
    """An estimate from readings, which of its parameters are held, and which count in the end.

    What decides, of the whole fit and then of each parameter:

    is_in_time  no delay is left that the fit cannot describe
    is_trusted  besides, two fits agree, starts are read, and no more is left than is declared
    is_used     if trusted; in time suffices where all but loose objects is read. Else readings have
                no say: none of the below applies, and actions count as on time
    is_held     identified, or at least weak where all but loose objects is read: no fit to videos
                changes it
    own         no wider than with videos: the result is this one
    apart       the two are over three standard deviations apart: the result covers both

    What is `own` is one of motion, held or not. It stays "identified" beside a film that no setting
    explains only if the readings are trusted and it may be the film that is wrong.
    """

    def __init__(self, fit: ReadingsResult, first: Distribution, joints: JointMotion | None = None):
        """`first`: the first range; `joints`: if everything is read but loose objects."""
        estimate = fit.estimate
        self._estimate, self._range, self.joints = estimate, fit.distribution, joints
        self._first, self._is_trusted, self.lacked_time = first, fit.is_trusted, fit.lacked_time
        # Whether the readings have a say, as in how late actions are
        self.is_used = fit.is_trusted or (joints is not None and fit.is_in_time)
        enough = ("identified",) if joints is None else ("identified", "weak")
        is_known = np.array([verdict in enough for verdict in estimate.verdict])
        self.is_held = is_known & self.is_used  # (N,)
        self.latency_steps = estimate.latency_steps if self.is_used else 0
        self.late_s = estimate.readings_late_s if self.is_used else (0.0, 0.0)  # with std

    @classmethod
    def fitted(
        cls, search: ReadingsSearch, real: list[Trajectory], budget: Budget
    ) -> "ReadingsEstimate":
        """What a `search_of` readings finds."""
        context, joints = search.context, None
        loop = set_up_loop(context.simulator, context.observation, context.start)
        if loop.measured.knows_all_but_objects:
            joints = JointMotion(loop, finds_offset(loop.sensors))
        return cls(search.fit(real, budget), search.first, joints)

    def fit_config(self, config: FitConfig) -> FitConfig:
        """How to fit what readings leave open."""
        config = replace(config, held=tuple(np.flatnonzero(self.is_held).tolist()))
        if self.joints is None:
            return config
        return replace(config, shooting=config.shooting.where_joints_are_known())

    def narrowed(self, searched: Distribution) -> Distribution:
        """The range to search, with held parameters limited to what readings leave open."""
        low = np.where(self.is_held, self._range.low, searched.low)
        high = np.where(self.is_held, self._range.high, searched.high)
        return searched.with_interval(np.clip(searched.mean, low, high), low, high)

    def without_delay(self, real: list[Trajectory]) -> list[Trajectory]:
        """The trajectories with actions shifted to when they took effect, and readings likewise."""
        steps, late_s = self.latency_steps, self.late_s[0]
        if not steps and not late_s:
            return real
        return [
            replace(
                t,
                actions=delayed(t.actions, steps),
                readings={n: advanced(read, late_s / t.step_s) for n, read in t.readings.items()},
            )
            for t in real
        ]

    def start(self, guess: PointEstimate) -> PointEstimate:
        """Start of a fit: held parameters as readings have them, the others from `guess`."""
        space, told = self._range.space, self._estimate
        std = normal_std(told, space)
        return PointEstimate(
            np.where(self.is_held, told.mean, guess.parameters),
            np.where(self.is_held, std, guess.std),
        )

    def combined_with(self, estimate: Estimate, unexplained: Unexplained = "nothing") -> Estimate:
        """Each parameter from the estimate of readings and video, or from this one if narrower.

        The offsets are this one's if any parameter is; its warnings are told if it is used, and
        else that it is not. Where the two contradict each other, the interval covers both.
        `unexplained`: what may be wrong where no setting explains the motion.
        """
        space, told = self._range.space, self._estimate
        is_comparable = ~space.is_appearance & self.is_used
        own = is_comparable & (normal_std(told, space) <= normal_std(estimate, space))
        apart = is_comparable & contradicting(told, estimate, space)
        both = merged(own, told, estimate)
        both = covering_both(apart, both, told, estimate, self._first)
        both = doubted_beside_film(both, own, unexplained, self._is_trusted, space.names)
        doubts = told.warnings
        if not self.is_used:
            doubts = [_NO_SAY + warning for warning in doubts if warning not in both.warnings]
        together = {} if both.correlation is None else correlated_pairs(both.correlation, space)
        late = estimate.latency_steps + self.latency_steps
        (found_s, std_s), (rest_s, rest_std_s) = self.late_s, estimate.readings_late_s
        return replace(
            both,
            correlations=together,
            latency_steps=late,
            readings_late_s=(found_s + rest_s, math.hypot(std_s, rest_std_s)),
            offsets=told.offsets if own.any() else estimate.offsets,
            warnings=list(dict.fromkeys([*doubts, *both.warnings])),
        )
