"""Sensitivity of joint readings to parameters, and how well they could identify these at best."""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from simtune.budget import Budget
from simtune.columns import cut
from simtune.fit.lateness import Lateness
from simtune.fit.physics import Physics, is_lost
from simtune.fit.readings.differences import DifferencePoint, differentiate
from simtune.fit.readings.growth import follow_within, growth_within
from simtune.fit.readings.measured_states import MeasuredStates
from simtune.fit.readings.normal_equations import by_shared, normal_equations
from simtune.fit.readings.open_loop import OpenLoopReplay
from simtune.fit.readings.segments import Segments
from simtune.fit.readings.slopes import StretchSlopes
from simtune.fit.readings.stretches import Readings, Stretches
from simtune.fit.readings.weak_directions import MOST_WORLDS, sharpened
from simtune.observation import (
    ObservationModel,
    assumed_noise,
    finds_offset,
    joints_of,
    units_of,
)
from simtune.random_streams import Purpose, stream
from simtune.simulation import ActionMapping, Simulator

_MOST_NAMED, _LARGE_SHARE = 3, 0.1  # actions, of the largest one's size
MOST_EPISODES, LONGEST_S = 4, 8.0  # replayed; any others are assumed to tell as much
# From the start, more than joints move, and many times as far as readings do: such a world has
# diverged. A motor that turns on and on moves far
_DIVERGED_DISTANCE, _DIVERGED_TRAVELS = 1e3, 10.0
_LONG_S = 5.0
_FOLLOWING_SHARE = 0.4  # of all time
_ASKING_SHARE = 0.6  # of the time that is left, before it is asked how errors grow
_NOT_ERRING = "there was time for {:.0%} of the errors of first readings: others may grow more"
_ASKING = "asking how well the best fit could tell"
_NOT_FOLLOWED = (
    "the time for it was over after {:.0%} of the episodes: how far they can be followed open loop "
    "was not looked at in the rest, which is assumed to tell as much"
)
_NOT_ASKED = (
    "there was time to ask {} of {} parts of episodes how well the best fit to readings could "
    "tell; the others are assumed to tell as much"
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
        budget: Budget | None = None,
    ):
        """At (N,) parameters; of recordings with `readings`, else of (E, T, A) actions.

        `budget`: for what readings tell; 40 % of it at most to look how far episodes can be
        followed. Raises RuntimeError if every episode diverges.
        """
        self._budget, self._left_out = budget or Budget(), list[str]()
        self._more = 1.0  # times as much is told as by what was looked at
        self._labels = observation.reading_labels
        self._may_be_late = observation.unknown_latency_steps(simulator) > 0
        episodes, num_steps = actions.shape[:2]
        given = np.ones((episodes, num_steps + 1, 1)) if readings is None else readings.values
        self._num_frames = np.isfinite(given).any(-1).sum()
        steps, observe = round(LONGEST_S / simulator.step_s), observation.observe_beside()
        actions = actions[:MOST_EPISODES, :steps].astype(float)
        played = simulator.roll_out(
            np.tile(nominal, (len(actions), 1)),
            actions,
            stream(seed, Purpose.READING_CHANGES),
            observe,
        )
        if not len(played):
            raise RuntimeError(_diverged(simulator.action_mapping, actions))
        physics = Physics(simulator, observe, played.states[0, 0])
        measured = MeasuredStates(physics, joints_of(observation.sensors))
        self._loop = OpenLoopReplay(measured, np.arange(len(nominal)))
        self._unit = simulator.space.to_unit(nominal)
        if readings is None:
            starts = played.states[:, 0]
            states = physics.states(starts)
            each = np.arange(len(starts))
            self._stretches = Stretches(played.actions, played.observed, states, starts, each)
            self._followed = None
            return
        few = Readings(
            readings.actions[:MOST_EPISODES, :steps], readings.values[:MOST_EPISODES, : steps + 1]
        )
        no_offsets = np.zeros(few.values.shape[-1])
        read = self._loop.states_of(few, self._unit, no_offsets)
        self._stretches = read.cut(Segments.evenly(few))
        looking = self._budget.share(_FOLLOWING_SHARE, (0.0, 0.4))
        followed, share = follow_within(looking, self._loop, read, self._unit)
        if share < 1:
            self._left_out.append(_NOT_FOLLOWED.format(share))
        self._more = 1 / share if share else 1.0
        followed = followed.or_whole(few)
        self._followed = self._loop.cut_read(read, self._unit, followed, goes_on=True)

    def changes(
        self, changed: np.ndarray, noise: np.ndarray, at_best: np.ndarray | None = None
    ) -> ReadingChanges:
        """For (N, N) parameters, one changed in each row; noise (D,) of independent readings.

        `at_best`: (D,) the least that it may be. Raises RuntimeError if all episodes go astray.
        """
        worlds = np.vstack([self._unit, self._loop.physics.parameters.to_unit(changed)])
        starts = np.repeat(self._stretches.states[None], len(worlds), 0)
        self._budget.report("changing one parameter after the other", 0.4)
        began_s = time.monotonic()
        predicted, _ = self._loop.play(self._stretches, starts, worlds)
        played = len(worlds) * self._stretches.actions.shape[1] * len(self._stretches.states)
        step_s = (time.monotonic() - began_s) / played
        moved = np.abs(predicted - predicted[:, :, :1])
        too_far = np.maximum(_DIVERGED_DISTANCE, _DIVERGED_TRAVELS * self._stretches.travel.max(0))
        kept = np.asarray((moved < too_far).all((0, 2, 3)) & ~is_lost(predicted).any(0))
        if not kept.any():
            raise RuntimeError(_ASTRAY)
        away, whole = (predicted[1:] - predicted[0])[:, kept], self._stretches.of(kept)
        told = counted = whole
        if self._followed is not None:  # of episodes that go astray, what can be followed
            told, counted = self._followed, self._stretches
        asked, left_out = self._affordable(told, step_s)
        more = self._more * _num_frames(told) / _num_frames(asked)
        noises = [noise] if at_best is None else [noise, at_best]
        information, *least = more * self._share(counted) * self._information(asked, noises)
        grown = np.full(len(kept), np.nan)
        growing = self._budget.part(self._budget.seconds_left, (0.9, 1.0))
        its, share = growth_within(growing, self._loop, whole, self._unit)
        grown[kept] = its.max(1)
        if share < 1:
            left_out.append(_NOT_ERRING.format(share))
        return ReadingChanges(
            labels=self._labels,
            units=units_of(self._loop.sensors),
            rms=np.sqrt(np.square(away).mean((1, 2))),
            largest=np.abs(away).max((1, 2)),
            noise=noise,
            information=information,
            information_at_best=least[0] if least else None,
            growth=grown,
            left_out=(*self._left_out, *left_out),
        )

    def _affordable(self, told: Stretches, step_s: float) -> tuple[Stretches, list[str]]:
        """Of stretches to derive in, as many as there is time for, one at least; what is said then.

        `step_s`: seconds of a step of one world.
        """
        num, worlds = len(told.states), 1 + 2 * len(self._unit) + MOST_WORLDS
        worlds += len(self._loop.measured.start_tangents)
        needed_s = worlds * _num_frames(told) * step_s
        fits = _ASKING_SHARE * self._budget.seconds_left / max(needed_s, 1e-9)
        few = num if fits >= 1 else max(1, math.floor(fits * num))
        self._budget.report(f"{_ASKING}{_about(needed_s * few / num)}", 0.5)
        if few == num:
            return told, []
        # What one leads to is where the next one of its episode begins
        chosen = np.arange(num) < few
        if not told.goes_on:
            chosen = np.isin(np.arange(num), np.linspace(0, num - 1, few).astype(int))
        return told.of(chosen), [_NOT_ASKED.format(few, num)]

    def _share(self, stretches: Stretches) -> float:
        """How many times as many frames there are in all as in these."""
        return float(self._num_frames / _num_frames(stretches))

    def _information(self, stretches: Stretches, noises: Sequence[np.ndarray]) -> np.ndarray:
        """(K, N, N) Fisher information for K noises (D,).

        Offsets, lateness and initial states are marginalised.
        """
        loop, unit, num = self._loop, self._unit, len(self._unit)
        if self._may_be_late:  # as in a fit
            loop, unit = loop.with_lateness(), np.append(unit, Lateness.unit(0.0))
        start_std = loop.measured.start_std(assumed_noise(loop.sensors), stretches)
        at = DifferencePoint(stretches, stretches.states, unit, start_std)
        nothing_left = 0 * stretches.values  # NaN where nothing was read
        offsets = finds_offset(loop.sensors)
        by_start = loop.starts_by_shared(stretches, offsets) / start_std

        def told(slopes: StretchSlopes, noise: np.ndarray) -> np.ndarray:
            shared = by_shared(slopes, offsets, by_start)
            equations = normal_equations(slopes.by_start, shared, nothing_left, noise)
            return equations.information.sum(0)

        slopes = differentiate(loop, at)
        slopes = sharpened(loop, at, slopes, told(slopes, noises[-1]))
        found = []
        for noise in noises:
            total = told(slopes, noise)
            mixed, others = total[:num, num:], total[num:, num:]
            found.append(total[:num, :num] - mixed @ np.linalg.pinv(others) @ mixed.T)
        return np.stack(found)


def _num_frames(stretches: Stretches) -> int:
    """With a reading, at least 1; nearly as many steps are played in one world."""
    return max(1, int(np.isfinite(stretches.values).any(-1).sum()))


def _about(seconds: float) -> str:
    """Said in advance of what takes long."""
    return f", about {seconds:.0f} s" * (seconds > _LONG_S)


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
