"""Sensitivity of joint readings to parameters, and how well they could identify these at best."""

from dataclasses import dataclass, replace

import numpy as np

from simtune.budget import NO_LIMIT, Budget, timed
from simtune.checking.sensitivity.information import affordable, information, num_frames
from simtune.columns import cut
from simtune.fit.lateness import late_unit
from simtune.fit.physics import Physics, is_lost
from simtune.fit.readings.growth import follow, growth
from simtune.fit.readings.measured_states import MeasuredStates
from simtune.fit.readings.open_loop import OpenLoopReplay
from simtune.fit.readings.readings import Readings
from simtune.fit.readings.recorded_loop import recorded_loop
from simtune.fit.readings.segments import Segments, Stretches
from simtune.observation import ObservationModel, units_of
from simtune.random_streams import Purpose, stream
from simtune.simulation import ActionMapping, Simulator
from simtune.tuning.pace import MOST_REPLAYED

_MOST_NAMED, _LARGE_SHARE = 3, 0.1  # actions, of the largest one's size
LONGEST_S = 8.0  # of an episode, replayed; the rest is assumed to tell as much
# From the start, more than joints move, and many times as far as readings do: such a world has
# diverged. A motor that turns on and on moves far
_DIVERGED_DISTANCE, _DIVERGED_TRAVELS = 1e3, 10.0
_FOLLOWING_SHARE = 0.4  # of all time
_NOT_ERRING = "there was time for {:.0%} of the errors of first readings: others may grow more"
_NOT_FOLLOWED = (
    "the time for it was over after {:.0%} of the episodes: how far they can be followed open loop "
    "was not looked at in the rest, which is assumed to tell as much"
)
_ASTRAY = (
    "no episode can be replayed from where its readings begin: the model goes astray there. Are "
    "the readings' columns, their unit and their sign right?"
)
_OF_ITSELF = (
    "every episode diverged, without any action: the timestep may be too long, or the model's "
    "start impossible"
)


@dataclass(frozen=True)
class ReadingChanges:
    """Of N parameters and D readings; lengths in the readings' units."""

    labels: tuple[str, ...]  # (D,)
    units: tuple[str, ...]
    rms: np.ndarray  # (N, D) changes of the readings when a parameter changes
    largest: np.ndarray  # (N, D)
    noise: np.ndarray  # (D,) standard deviation of an independent error in each reading
    # (N, N) Fisher information of all episodes, in unit coordinates; and if a fit left as little as
    # it may at best, None: that is the same
    information: np.ndarray
    information_at_best: np.ndarray | None
    # (E,) of the replayed episodes, NaN if it went astray: how many times as large as at the start
    # an error of a first position becomes, in any reading of a place, both relative to the usual
    # noise
    growth: np.ndarray
    left_out: tuple[str, ...] = ()  # sentences on what there was no time for

    @property
    def main(self) -> np.ndarray:
        """(N,) the reading that changes most, relative to its noise."""
        return (self.rms / self.noise).argmax(1)

    @property
    def changes(self) -> np.ndarray:
        """(N,) bool: whether any reading shows the parameter at all."""
        return self.largest.max(1) > 1e-9


class ReplayedReadings:
    """A few episodes, replayed open loop with one parameter changed at a time."""

    def __init__(
        self,
        simulator: Simulator,
        observation: ObservationModel,
        nominal: np.ndarray,
        actions: np.ndarray,
        readings: Readings | None = None,
        seed: int = 0,
        budget: Budget = NO_LIMIT,
    ):
        """At (N,) parameters; of recordings with `readings`, else of (E, T, A) actions.

        `budget`: for what readings tell; 40 % of it at most to look how far episodes can be
        followed. Raises RuntimeError if every episode diverges.
        """
        self._budget, self._left_out = budget, list[str]()
        self._more = 1.0  # times as much is told as by what was looked at
        self._labels = observation.reading_labels
        self._may_be_late = observation.unknown_latency_steps(simulator) > 0
        episodes, num_steps = actions.shape[:2]
        given = np.ones((episodes, num_steps + 1, 1)) if readings is None else readings.values
        self._all_frames = np.isfinite(given).any(-1).sum()
        steps, observe = round(LONGEST_S / simulator.step_s), observation.observe_beside()
        actions = actions[:MOST_REPLAYED, :steps].astype(float)
        played = simulator.roll_out(
            np.tile(nominal, (len(actions), 1)),
            actions,
            stream(seed, Purpose.READING_CHANGES),
            observe,
        )
        if not len(played):
            raise RuntimeError(_diverged(simulator.action_mapping, actions))
        self._unit = simulator.space.to_unit(nominal)
        if readings is None:
            physics = Physics(simulator, observe, played.states[0, 0])
            measured = MeasuredStates(physics, observation.sensors)
            self._loop = OpenLoopReplay(measured, np.arange(len(nominal)))
            starts, each = played.states[:, 0], np.arange(len(played))
            states = physics.states(starts)
            self._stretches = Stretches(played.actions, played.observed, states, starts, each)
            self._followed = None
        else:
            loop = recorded_loop(simulator, observation, nominal, readings)
            self._loop = replace(loop, fitted=np.arange(len(nominal)))
            self._stretches, self._followed = self._follow(readings.first(steps, MOST_REPLAYED))

    def _follow(self, few: Readings) -> tuple[Stretches, Stretches]:
        """Whole episodes from where readings have them, and parts that can be followed."""
        read = self._loop.states_of(few, self._unit)
        looking = self._budget.share(_FOLLOWING_SHARE, (0.0, 0.4))
        followed, share = follow(self._loop, read, self._unit, looking)
        if share < 1:
            self._left_out.append(_NOT_FOLLOWED.format(share))
        self._more = 1 / share if share else 1.0
        parts = self._loop.cut_read(read, self._unit, followed.or_whole(few), goes_on=True)
        return read.cut(Segments.evenly(few)), parts

    def changes(
        self, changed: np.ndarray, noise: np.ndarray, at_best: np.ndarray | None = None
    ) -> ReadingChanges:
        """For (N, N) parameters, one changed in each row; noise (D,) of independent readings.

        `at_best`: (D,) the least that it may be. Raises RuntimeError if all episodes go astray.
        """
        worlds = np.vstack([self._unit, self._loop.physics.parameters.to_unit(changed)])
        starts = np.repeat(self._stretches.states[None], len(worlds), 0)
        self._budget.report("changing one parameter after the other", 0.4)
        play_s, (predicted, _) = timed(lambda: self._loop.play(self._stretches, starts, worlds))
        played = len(worlds) * self._stretches.actions.shape[1] * len(self._stretches.states)
        kept = _endure(predicted, self._stretches.travel)
        if not kept.any():
            raise RuntimeError(_ASTRAY)
        away, whole = (predicted[1:] - predicted[0])[:, kept], self._stretches.of(kept)
        told = counted = whole
        if self._followed is not None:  # of episodes that go astray, what can be followed
            told, counted = self._followed, self._stretches
        asked, left_out = affordable(self._loop, told, play_s / played, self._budget)
        more = self._more * num_frames(told) / num_frames(asked)
        more *= self._all_frames / num_frames(counted)
        noises = [noise] if at_best is None else [noise, at_best]
        loop, unit = self._loop, self._unit
        if self._may_be_late:  # as in a fit
            loop, unit = loop.with_lateness(), np.append(unit, late_unit(0.0))
        known, *best_known = more * information(loop, unit, asked, noises)
        grown = np.full(len(kept), np.nan)
        growing = self._budget.part(self._budget.seconds_left, (0.9, 1.0))
        grows, share = growth(self._loop, whole, self._unit, growing)
        grown[kept] = grows.max(1)
        if share < 1:
            left_out.append(_NOT_ERRING.format(share))
        return ReadingChanges(
            labels=self._labels,
            units=units_of(self._loop.sensors),
            rms=np.sqrt(np.square(away).mean((1, 2))),
            largest=np.abs(away).max((1, 2)),
            noise=noise,
            information=known,
            information_at_best=best_known[0] if best_known else None,
            growth=grown,
            left_out=(*self._left_out, *left_out),
        )


def _endure(predicted: np.ndarray, travel: np.ndarray) -> np.ndarray:
    """(W,) bool: whether no world goes astray in (G, W, K + 1, D); readings travel by (W, D)."""
    moved = np.abs(predicted - predicted[:, :, :1])
    too_far = np.maximum(_DIVERGED_DISTANCE, _DIVERGED_TRAVELS * travel.max(0))
    return np.asarray((moved < too_far).all((0, 2, 3)) & ~is_lost(predicted).any(0))


def _diverged(mapping: ActionMapping, actions: np.ndarray) -> str:
    """A message on (E, T, A) actions that no world endures: a wrong unit shows in their size."""
    if not actions.any():
        return _OF_ITSELF
    sizes = np.abs(actions).max((0, 1))
    largest = [
        f"{mapping.names[i]} {sizes[i]:.4g}"
        + " (the model's range is {:g} to {:g})".format(*mapping.range[i])
        * bool(mapping.is_limited[i])
        for i in np.argsort(-sizes, kind="stable")
        if sizes[i] >= _LARGE_SHARE * sizes.max()
    ]
    return (
        f"every episode diverged. The largest actions are {cut(largest, _MOST_NAMED)}: are they in "
        "the model's unit? Else the timestep may be too long"
    )
