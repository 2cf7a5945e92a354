"""Sensitivity of joint readings to parameters, and how well they could identify these at best."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from simtune.columns import cut
from simtune.fit.lateness import Lateness
from simtune.fit.physics import Physics, is_lost
from simtune.fit.readings.differences import DifferencePoint, differentiate
from simtune.fit.readings.growth import follow, growth
from simtune.fit.readings.measured_states import MeasuredStates
from simtune.fit.readings.normal_equations import by_shared, normal_equations
from simtune.fit.readings.open_loop import OpenLoopReplay
from simtune.fit.readings.segments import Segments
from simtune.fit.readings.slopes import StretchSlopes
from simtune.fit.readings.stretches import Readings, Stretches
from simtune.fit.readings.weak_directions import sharpened
from simtune.observation import (
    ObservationModel,
    assumed_noise,
    finds_offset,
    joints_of,
    units_of,
)
from simtune.random_streams import Purpose, stream
from simtune.simulation import ActionMapping, Simulator

_MOST_NAMED, _LARGE = 3, 0.1  # actions, of the largest one's size
MOST_EPISODES, LONGEST_S = 4, 8.0  # replayed; any others are assumed to tell as much
# From the start, more than joints move, and many times as far as readings do: such a world has
# diverged. A motor that turns on and on moves far
_TOO_FAR, _MUCH_FARTHER = 1e3, 10.0
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
    ):
        """At (N,) parameters; of recordings with `readings`, else of (E, T, A) actions.

        Raises RuntimeError if every episode diverges.
        """
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
        followed = follow(self._loop, read, self._unit).or_whole(few)
        self._followed = self._loop.cut_read(read, self._unit, followed, goes_on=True)

    def changes(
        self, changed: np.ndarray, noise: np.ndarray, at_best: np.ndarray | None = None
    ) -> ReadingChanges:
        """For (N, N) parameters, one changed in each row; noise (D,) of independent readings.

        `at_best`: (D,) the least that it may be. Raises RuntimeError if all episodes go astray.
        """
        worlds = np.vstack([self._unit, self._loop.physics.parameters.to_unit(changed)])
        starts = np.repeat(self._stretches.states[None], len(worlds), 0)
        predicted, _ = self._loop.play(self._stretches, starts, worlds)
        moved = np.abs(predicted - predicted[:, :, :1])
        too_far = np.maximum(_TOO_FAR, _MUCH_FARTHER * self._stretches.travel.max(0))
        kept = np.asarray((moved < too_far).all((0, 2, 3)) & ~is_lost(predicted).any(0))
        if not kept.any():
            raise RuntimeError(_ASTRAY)
        away, whole = (predicted[1:] - predicted[0])[:, kept], self._stretches.of(kept)
        told = counted = whole
        if self._followed is not None:  # of episodes that go astray, what can be followed
            told, counted = self._followed, self._stretches
        noises = [noise] if at_best is None else [noise, at_best]
        information, *least = self._share(counted) * self._information(told, noises)
        grown = np.full(len(kept), np.nan)
        grown[kept] = growth(self._loop, whole, self._unit).max(1)
        return ReadingChanges(
            labels=self._labels,
            units=units_of(self._loop.sensors),
            rms=np.sqrt(np.square(away).mean((1, 2))),
            largest=np.abs(away).max((1, 2)),
            noise=noise,
            information=information,
            information_at_best=least[0] if least else None,
            growth=grown,
        )

    def _share(self, stretches: Stretches) -> float:
        """How many times as many frames there are in all as in these."""
        return self._num_frames / np.isfinite(stretches.values).any(-1).sum()

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
        if sizes[i] >= _LARGE * sizes.max()
    ]
    return (
        f"every episode diverged. The largest actions are {cut(largest, _MOST_NAMED)}: are they in "
        "the model's unit? Else the timestep may be too long"
    )
