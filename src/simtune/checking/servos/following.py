"""How readings follow commands, in any unit and with either sign."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from simtune.checking.servos.fit import Episodes, ServoResponse, delay_of, delayed_by

_MIN_CORRELATION = 0.8  # of a joint that follows its command
_MIN_ONE_WAY_CORRELATION = 0.6  # ... if with the other sign none is half as large, at any delay
HARDLY = 0.4  # correlation below which a joint hardly does
_MAX_LEFT_SHARE = 0.25  # of a joint's variance, by its own command, if it follows another's
# Of a pair, in shares of variance, by exchanging two columns: legs that step together gain little
_MIN_PAIR_GAIN = 0.4
_SAME_COLUMN_TOLD = 0.9  # by another's command: its column, whatever that one reads
_NUM_DELAYS = 30  # at which readings are compared with commands


class Following(NamedTuple):
    correlation: float  # the largest in magnitude over all delays
    slope: float  # of readings against commands, at that delay
    opposite: float  # the largest magnitude with the other sign

    @property
    def is_clear(self) -> bool:
        """Whether its sign and about its slope are certain."""
        size = abs(self.correlation)
        return size >= _MIN_CORRELATION or (
            size >= _MIN_ONE_WAY_CORRELATION and self.opposite < size / 2
        )

    @property
    def told(self) -> float:
        """Share of a joint's variance that the command explains."""
        return min(1.0, self.correlation**2)

    def leaves_less_than(self, other: "Following") -> bool:
        """Whether it is clear, and much better."""
        return self.is_clear and 1 - self.told < _MAX_LEFT_SHARE * (1 - other.told)


class Watched(NamedTuple):
    """A joint's (T,) commands and (T + 1,) readings in each of the episodes, in `unit`.

    Speeds where its servo's commands are speeds, with the `positions` that were read, if any.
    """

    name: str
    unit: str
    commands: Episodes
    measured: Episodes
    step_s: float
    episodes: Sequence[str] = ()  # their names
    positions: Episodes | None = None  # (T + 1,) of which `measured` are the speeds

    @property
    def is_speed(self) -> bool:
        return self.unit.endswith("/s")


def follows(joint: Watched, servo: ServoResponse) -> Following:
    """Correlation of readings with commands, for any unit and sign; 0 where they tell nothing."""
    commands, measured = joint.commands, joint.measured
    y = np.concatenate([read[: len(c)] for c, read in zip(commands, measured, strict=True)])
    known, found = np.isfinite(y), [(0.0, 0.0)]
    if not servo.commanded > 0 or known.sum() < 2:
        return Following(0.0, 0.0, 0.0)
    longest = 2 * servo.lag_steps + 0.5 * _NUM_DELAYS
    # Of a sine, half a period more looks reversed: each sign is compared where it fits best.
    reversed_ = delay_of(commands, [-read for read in measured], joint.step_s)
    for lag in (servo.lag_steps, reversed_, *np.linspace(0, longest, _NUM_DELAYS)):
        x = np.concatenate([delayed_by(c, lag) for c in commands])[known]
        (xx, xy), (_, yy) = np.cov(x, y[known])
        if xx > 0 and yy > 0:
            found.append((float(xy / np.sqrt(xx * yy)), float(xy / xx)))
    correlation, slope = max(found, key=lambda one: abs(one[0]))
    opposite = max(0.0, *(-other * np.sign(correlation) for other, _ in found))
    return Following(correlation, slope, float(opposite))


def followed_instead(
    joint: Watched, servo: ServoResponse, own: Following, others: Sequence[Watched]
) -> str | None:
    """The joint whose command is clearly followed instead.

    Where it follows its `own` somewhat, as wheels of a robot that drives ahead do, that joint has
    to follow its command in turn, and either leaves much less so. Of several, as legs that step
    together, the one with which a pair explains most, both ways, beside each one's own command.
    """
    found = []
    for other in others:
        if other.name == joint.name or other.unit != joint.unit:
            continue
        crossed = follows(joint._replace(commands=other.commands), servo)
        is_instead = crossed.is_clear and abs(own.correlation) < HARDLY
        if is_instead or crossed.leaves_less_than(own):
            back = _follows(other._replace(commands=joint.commands), servo)
            theirs = _follows(other, servo)
            if is_instead or back.leaves_less_than(theirs):
                gain = crossed.told + back.told - own.told - theirs.told
                if gain > _MIN_PAIR_GAIN or crossed.told > _SAME_COLUMN_TOLD:
                    found.append((gain, other.name))
    return max(found)[1] if found else None


def _follows(joint: Watched, servo: ServoResponse) -> Following:
    """At this joint's own delay, which the `servo`, another one's, may not have."""
    lag = delay_of(joint.commands, joint.measured, joint.step_s)
    return follows(joint, replace(servo, lag_steps=lag))


def better_column(
    joint: Watched, servo: ServoResponse, own: Following, others: Sequence[Watched]
) -> str | None:
    """The joint in whose column this one's command is clearly followed, and not that one's own."""
    found = []
    for other in others:
        if other.name == joint.name or other.unit != joint.unit:
            continue
        crossed = follows(joint._replace(measured=other.measured), servo)
        if crossed.leaves_less_than(own) and crossed.leaves_less_than(follows(other, servo)):
            found.append((crossed.told, other.name))
    return max(found)[1] if found else None
