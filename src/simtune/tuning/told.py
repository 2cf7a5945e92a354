"""What joint readings alone tell, before videos are looked at: whole episodes, not short windows.

Beside video the motion is fitted in windows of a quarter of a second, which tell less of a servo
than a whole episode does. So the readings' own fit comes first. What it identifies is held there
while the videos tell the rest, and refits of known worlds show what that costs: they begin as far
beside the truth as the readings may be. In the end each parameter is as the better of both says.
"""

from dataclasses import replace

import numpy as np

from simtune.budget import Budget
from simtune.fit import OpenLoop, PointEstimate
from simtune.fit.uncertainty import tell_apart
from simtune.observation import joints_of, read_later
from simtune.randomization import Distribution
from simtune.simulation import Simulator
from simtune.trajectory import Trajectory, delayed
from simtune.tuning.readings import ReadingsConfig, ReadingsSearch
from simtune.tuning.search import Estimate, SearchContext

_CENTRAL = 2 * 1.645  # standard deviations in a 90 % interval


class Told:
    """An estimate from readings, and what of it is told well."""

    def __init__(self, estimate: Estimate, distribution: Distribution, is_trusted: bool):
        """`distribution`: the range that the estimate leaves; `is_trusted`: whether two fits ended
        there, and explain readings as well as a tuning file declares.
        """
        self._estimate, self._seen, self._is_trusted = estimate, distribution, is_trusted
        identified = np.array([verdict == "identified" for verdict in estimate.verdict])
        self.is_held = identified & is_trusted  # (N,)
        is_any = bool(self.is_held.any())
        self.latency_steps = estimate.latency_steps if is_any else 0
        self.late_s = estimate.readings_late_s if is_any else (0.0, 0.0)  # and how sure that is

    @classmethod
    def by_readings(
        cls, context: SearchContext, real: list[Trajectory], budget: Budget
    ) -> "Told | None":
        """None where nothing is read, or nothing moves that readings could tell.

        Nor where joints begin anywhere that no sensor measures, such as a walker's torso: whole
        episodes cannot be replayed then, but windows can, whose states pictures show.
        """
        simulator, seen = context.simulator, context.observation
        is_readable = bool(joints_of(seen.sensors)) and not simulator.space.is_appearance.all()
        if not is_readable or not isinstance(simulator, Simulator):
            return None
        if OpenLoop.of(simulator, seen, context.start).unseen:
            return None
        search = ReadingsSearch(context, ReadingsConfig(precision=0.0))
        estimate = search.run_round(real, budget).estimate
        return cls(estimate, search.distribution, search.is_trusted)

    def narrowed(self, searched: Distribution) -> Distribution:
        """The range to search, with what is held within what readings leave open."""
        low = np.where(self.is_held, self._seen.low, searched.low)
        high = np.where(self.is_held, self._seen.high, searched.high)
        return searched.with_interval(np.clip(searched.mean, low, high), low, high)

    def late(self, real: list[Trajectory]) -> list[Trajectory]:
        """The same, with actions when they took effect, and what was read when it was so."""
        steps, late_s = self.latency_steps, self.late_s[0]
        if not steps and not late_s:
            return real
        return [
            replace(
                t,
                actions=delayed(t.actions, steps),
                readings={n: read_later(its, late_s / t.step_s) for n, its in t.readings.items()},
            )
            for t in real
        ]

    def start(self, guess: PointEstimate) -> PointEstimate:
        """Where a fit begins: what is held, where readings have it."""
        space, its = self._seen.space, self._estimate
        std = (space.to_unit(its.high) - space.to_unit(its.low)) / _CENTRAL
        return PointEstimate(
            np.where(self.is_held, its.mean, guess.parameters),
            np.where(self.is_held, std, guess.std),
        )

    def better(self, estimate: Estimate) -> Estimate:
        """Each parameter from the estimate of readings and video, or from this one if narrower."""
        space, its = self._seen.space, self._estimate
        widths = [space.to_unit(e.high) - space.to_unit(e.low) for e in (its, estimate)]
        own = (widths[0] <= widths[1]) & ~space.is_appearance & self._is_trusted
        mixed = _mixed(own, its, estimate)
        together = {} if mixed.correlation is None else tell_apart(mixed.correlation, space)
        late = estimate.latency_steps + self.latency_steps
        return replace(
            mixed, correlations=together, latency_steps=late, readings_late_s=self.late_s
        )


def _mixed(own: np.ndarray, its: Estimate, other: Estimate) -> Estimate:
    """`its` of the parameters `own`, (N,) bool; the rest of `other`."""
    curves = {
        name: its.curves[name] if mine else curve
        for (name, curve), mine in zip(other.curves.items(), own, strict=True)
    }
    correlation = other.correlation
    if correlation is not None and its.correlation is not None:
        mine, both = np.outer(own, own), np.outer(~own, ~own)
        correlation = np.where(mine, its.correlation, np.where(both, correlation, np.eye(len(own))))
    picked = zip(own, its.verdict, other.verdict, strict=True)
    return replace(
        other,
        mean=np.where(own, its.mean, other.mean),
        low=np.where(own, its.low, other.low),
        high=np.where(own, its.high, other.high),
        verdict=[one if mine else another for mine, one, another in picked],
        curves=curves,
        correlation=correlation,
    )
