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
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from simtune.budget import Budget
from simtune.fit import (
    FitConfig,
    JointMotion,
    OpenLoopReplay,
    PointEstimate,
    correlated_pairs,
    set_up_loop,
)
from simtune.normal import STDS_90
from simtune.observation import advanced, finds_offset, joints_of
from simtune.parameters import ParameterSpace
from simtune.randomization import Distribution
from simtune.simulation import Simulator
from simtune.trajectory import Trajectory, delayed
from simtune.tuning.estimate import Estimate
from simtune.tuning.readings.search import ReadingsSearch
from simtune.tuning.readings.verdict import ReadingsResult
from simtune.tuning.search import SearchContext
from simtune.verdicts import at_most_weak

_CONTRADICTION = (
    "Joint readings and videos contradict each other on {}: [{:.4g}, {:.4g}] by readings alone, "
    "[{:.4g}, {:.4g}] with videos. The model lacks something, or one of them is wrong; the "
    "interval covers both."
)
_NO_SAY = "Joint readings alone had no say in the estimates: "
# Standard deviations between means from which two estimates contradict each other. That their
# intervals do not meet says less: a wide one misses the truth once in ten times.
_CONTRADICTS = 3.0


def search_of(
    context: SearchContext, real: list[Trajectory]
) -> tuple[ReadingsSearch, OpenLoopReplay] | None:
    """With what replays the readings; None if there are none, or they could show nothing.

    Also None if joints that nothing measures begin anywhere and readings show where, such as a
    walker's torso: windows are replayed then, of which pictures show the states, too.
    """
    simulator, seen = context.simulator, context.observation
    is_readable = bool(joints_of(seen.sensors)) and not simulator.space.is_appearance.all()
    if not is_readable or not isinstance(simulator, Simulator):
        return None
    search = ReadingsSearch(context)
    loop = search.look_at(real)[1]
    return None if loop.unseen else (search, loop)


class ReadingsEstimate:
    """An estimate from readings, and which of its parameters are held."""

    def __init__(self, fit: ReadingsResult, joints: JointMotion | None = None):
        """`joints`: if everything is read but loose objects."""
        estimate = fit.estimate
        self._estimate, self._range, self.joints = estimate, fit.distribution, joints
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
        return cls(search.fit(real, budget), joints)

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
        std = _std(told, space)
        return PointEstimate(
            np.where(self.is_held, told.mean, guess.parameters),
            np.where(self.is_held, std, guess.std),
        )

    def combined_with(self, estimate: Estimate) -> Estimate:
        """Each parameter from the estimate of readings and video, or from this one if narrower.

        If any parameter comes from this one, so do its warnings and offsets. Where the two
        contradict each other, the interval covers both.
        """
        space, told = self._range.space, self._estimate
        std, of_both = _std(told, space), _std(estimate, space)
        is_comparable = ~space.is_appearance & self.is_used
        own = (std <= of_both) & is_comparable
        distance = np.abs(space.to_unit(told.mean) - space.to_unit(estimate.mean))
        apart = is_comparable & (distance > _CONTRADICTS * np.hypot(std, of_both))
        merged = _covering_both(apart, _merged(own, told, estimate), told, estimate, space.names)
        doubts = told.warnings
        if not own.any():
            doubts = [_NO_SAY + w for w in doubts if not self.is_used and w not in merged.warnings]
        together = {} if merged.correlation is None else correlated_pairs(merged.correlation, space)
        late = estimate.latency_steps + self.latency_steps
        (found_s, std_s), (rest_s, rest_std_s) = self.late_s, estimate.readings_late_s
        return replace(
            merged,
            correlations=together,
            latency_steps=late,
            readings_late_s=(found_s + rest_s, math.hypot(std_s, rest_std_s)),
            offsets=told.offsets if own.any() else estimate.offsets,
            warnings=list(dict.fromkeys([*doubts, *merged.warnings])),
        )


def _std(estimate: Estimate, space: ParameterSpace) -> np.ndarray:
    """(N,) standard deviations in unit coordinates, if an interval is a normal distribution's.

    By its longer side: the other one may be cut off at a bound.
    """
    mean, low, high = map(space.to_unit, (estimate.mean, estimate.low, estimate.high))
    return np.maximum(mean - low, high - mean) / STDS_90


def _covering_both(
    apart: np.ndarray, merged: Estimate, told: Estimate, other: Estimate, names: Sequence[str]
) -> Estimate:
    """`merged`, with both intervals and both curves of parameters that are `apart`, (N,) bool."""
    if not apart.any():
        return merged
    curves, warnings = dict(merged.curves), list(merged.warnings)
    for i in np.flatnonzero(apart).tolist():
        (one, above), (another, below) = told.curves[names[i]], other.curves[names[i]]
        at = np.union1d(one, another)
        curves[names[i]] = at, (np.interp(at, one, above) + np.interp(at, another, below)) / 2
        ends = (e for estimate in (told, other) for e in (estimate.low[i], estimate.high[i]))
        warnings.append(_CONTRADICTION.format(names[i], *ends))
    return replace(
        merged,
        low=np.where(apart, np.minimum(told.low, other.low), merged.low),
        high=np.where(apart, np.maximum(told.high, other.high), merged.high),
        verdict=at_most_weak(merged.verdict, apart),
        curves=curves,
        warnings=warnings,
    )


def _merged(own: np.ndarray, fit: Estimate, other: Estimate) -> Estimate:
    """`fit` for the parameters `own`, (N,) bool; `other` for the rest."""
    curves = {
        name: fit.curves[name] if mine else curve
        for (name, curve), mine in zip(other.curves.items(), own, strict=True)
    }
    correlation = other.correlation
    if own.any() and fit.correlation is not None:
        mine, both, none = np.outer(own, own), np.outer(~own, ~own), np.eye(len(own))
        rest = none if correlation is None else np.where(both, correlation, none)
        correlation = np.where(mine, fit.correlation, rest)
    picked = zip(own, fit.verdict, other.verdict, strict=True)
    return replace(
        other,
        mean=np.where(own, fit.mean, other.mean),
        low=np.where(own, fit.low, other.low),
        high=np.where(own, fit.high, other.high),
        verdict=[one if mine else another for mine, one, another in picked],
        curves=curves,
        correlation=correlation,
    )
