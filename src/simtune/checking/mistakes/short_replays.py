"""Short pieces of recordings, replayed from where readings say that they begin."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from simtune.checking.mistakes.changes import Change
from simtune.fit import OpenLoopReplay, Readings
from simtune.fit.readings.readings import filled, velocities
from simtune.fit.readings.segments import ReadStates, Segments, Stretches
from simtune.observation import assumed_noise

PIECE_S = 0.25
FEW_PIECES = 6
_FEWEST_STEPS, _NUM_PIECES = 4, 40
_NUM_CONTACT_PIECES = 20  # where contacts take time
_LEAD_IN_S = 0.2  # from which what no sensor measures goes along
# By which actions may be late: half a period more of what a controller shakes looks reversed
_LATE_S = (0.0, 0.02, 0.04, 0.06, 0.08)
_TRIED_SIZES = (1 / 3, 1 / 2, 2.0, 3.0)  # of what actions do, beside that of the first values
_NEARER_FACTORS = (1.3, 1.14, 1.07, 1.03)  # from the best of these to one nearer
SIZES_TRIED = len(_TRIED_SIZES) + 2 * len(_NEARER_FACTORS)
_LOST_DEVIATION = 1e6  # in a unit of readings, of a world that explodes
_MAX_LEFT = 10.0  # squared deviations, in those of uniform motion, that a reading counts as at most
_CLEAR_SPEED_NOISES = 3.0  # times what noise of the first readings makes of a speed
_RIVAL_LEFT_RATIO = 1.05  # times what the best change leaves: another one may be meant


class ShortReplays(NamedTuple):
    """Of readings, or of changed ones, in a world of these parameters."""

    loop: OpenLoopReplay
    unit: np.ndarray  # (N,)

    @property
    def num_pieces(self) -> int:
        return _NUM_CONTACT_PIECES if self.loop.may_touch else _NUM_PIECES

    def moves(self, readings: Readings) -> bool:
        """Whether any reading changes its speed by more than its noise lets it seem to."""
        pieces = self._pieces(readings, Segments.evenly(readings, self._steps, _NUM_PIECES))
        moved = np.nanmean(np.square(_uniform(pieces.values) - pieces.values), (0, 1))
        most = self._steps * assumed_noise(self.loop.sensors)
        return bool((np.sqrt(moved) > _CLEAR_SPEED_NOISES * most).any())

    def likely(self, readings: Readings, tried: Sequence[Change], num: int) -> list[Change]:
        """The changes that leave least of a few pieces."""
        return sorted(tried, key=lambda change: self.left(change.of(readings), FEW_PIECES))[:num]

    def best(self, readings: Readings, tried: Sequence[Change]) -> tuple[float, Change, list[str]]:
        """How much the change leaves that leaves least, itself, and what as good ones say."""
        each = [(self.left(change.of(readings)), change) for change in tried]
        least, best = min(each, key=lambda one: one[0])
        near = _RIVAL_LEFT_RATIO * least
        as_good = [change.says for left, change in each if left < near and not change.shift.any()]
        return least, best, [*dict.fromkeys([best.says, *as_good])]

    def left_at_best_size(self, readings: Readings, left: float) -> float:
        """The same at the best size of what actions do, which nobody has read; `left`: at 1.

        What hovers falls or rises unless that is right to a few percent.
        """

        def at(size: float) -> tuple[float, float]:
            return self.left(Readings(size * readings.actions, readings.values)), size

        best = min((left, 1.0), *map(at, _TRIED_SIZES))
        for nearer in _NEARER_FACTORS:
            best = min(best, at(best[1] * nearer), at(best[1] / nearer))
        return best[0]

    def left(self, readings: Readings, num_pieces: int | None = None) -> float:
        """Squared deviations of short replays, in those of uniform motion; at the best of a few
        delays. The mean over readings, none of which counts more than `_MAX_LEFT`.
        """
        num_pieces = num_pieces or self.num_pieces
        step_s = self.loop.physics.simulator.step_s
        delays = sorted({round(late_s / step_s) for late_s in _LATE_S})
        return min(self._left(readings.delayed(late), num_pieces) for late in delays)

    def _pieces(self, readings: Readings, segments: Segments) -> Stretches:
        """With what no sensor measures as it goes along with the joints read before: wheels that
        roll, under a base at rest, would skid.
        """
        read = self.loop.states_of(readings, self.unit)
        pieces = read.cut(segments)
        if not self.loop.measured.goes_on.any():
            return pieces
        num_rows = round(_LEAD_IN_S / self.loop.physics.simulator.step_s)
        rows = np.maximum(segments.begin[:, None] + np.arange(-num_rows, 1), 0)
        episode = segments.episode[:, None]
        actions = readings.actions[episode, rows[:, :-1]]
        before = Readings(actions, readings.values[episode, rows])
        states, left = read.states[episode, rows], read.actuator_states[episode, rows]
        led = self.loop.carried(
            ReadStates(before, states, left, None, self.loop.measured.of_actions),
            self.unit,
            num_rows,
        )
        is_later = segments.begin >= num_rows
        states = np.where(is_later[:, None], led.states[:, -1], pieces.states)
        return pieces._replace(states=states)

    @property
    def _steps(self) -> int:
        return max(_FEWEST_STEPS, round(PIECE_S / self.loop.physics.simulator.step_s))

    def _left(self, readings: Readings, num_pieces: int) -> float:
        pieces = self._pieces(readings, Segments.evenly(readings, self._steps, num_pieces))
        played = self.loop.play(pieces, pieces.states[None], self.unit[None])[0][0]
        moved, left = (
            np.nansum(np.square(np.minimum(np.abs(ends - pieces.values), _LOST_DEVIATION)), (0, 1))
            for ends in (_uniform(pieces.values), played)
        )
        shares = np.minimum(left[moved > 0] / moved[moved > 0], _MAX_LEFT)
        return float(shares.mean()) if len(shares) else 0.0


def _uniform(values: np.ndarray) -> np.ndarray:
    """(W, K + 1, D) uniform motion from where (W, K + 1, D) readings begin."""
    whole, times = filled(values), np.arange(values.shape[1])
    return whole[:, :1] + velocities(whole)[:, :1] * times[:, None]
