"""How readings follow commands, in any unit and with either sign."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from simtune.checking.servos.fit import Episodes, ServoResponse, delay_of, delayed_by

_FOLLOWS = 0.8  # correlation from which a joint follows its command
_FOLLOWS_ONE_WAY = 0.6  # ... if with the other sign none is half as large, at any delay
HARDLY = 0.4  # correlation below which a joint hardly does
_LEAVES = 0.25  # of the variance that its own command leaves of a joint, if it follows another's
_WAYS = 30  # delays at which readings are compared with commands


class Following(NamedTuple):
    correlation: float  # the largest in magnitude over all delays
    slope: float  # of readings against commands, at that delay
    opposite: float  # the largest magnitude with the other sign

    @property
    def is_clear(self) -> bool:
        """Whether its sign and about its slope are certain."""
        size = abs(self.correlation)
        return size >= _FOLLOWS or (size >= _FOLLOWS_ONE_WAY and self.opposite < size / 2)

    def leaves_less_than(self, other: "Following") -> bool:
        """Whether it is clear, and much better."""
        left, others = (1 - min(1, abs(its.correlation)) ** 2 for its in (self, other))
        return self.is_clear and left < _LEAVES * others


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
    longest = 2 * servo.lag_steps + 0.5 * _WAYS
    # Of a sine, half a period more looks reversed: each sign is compared where it fits best.
    reversed_ = delay_of(commands, [-read for read in measured], joint.step_s)
    for lag in (servo.lag_steps, reversed_, *np.linspace(0, longest, _WAYS)):
        x = np.concatenate([delayed_by(c, lag) for c in commands])[known]
        (xx, xy), (_, yy) = np.cov(x, y[known])
        if xx > 0 and yy > 0:
            found.append((float(xy / np.sqrt(xx * yy)), float(xy / xx)))
    correlation, slope = max(found, key=lambda its: abs(its[0]))
    opposite = max(0.0, *(-its * np.sign(correlation) for its, _ in found))
    return Following(correlation, slope, float(opposite))


def followed_instead(
    joint: Watched, servo: ServoResponse, own: Following, others: Sequence[Watched]
) -> str | None:
    """The joint whose command is clearly followed instead.

    Where it follows its `own` somewhat, as wheels of a robot that drives ahead do, that joint has
    to follow its command in turn, and either leaves much less so.
    """
    found = []
    for other in others:
        if other.name == joint.name or other.unit != joint.unit:
            continue
        crossed = follows(joint._replace(commands=other.commands), servo)
        is_instead = crossed.is_clear and abs(own.correlation) < HARDLY
        if is_instead or (crossed.leaves_less_than(own) and _is_mutual(joint, other, servo)):
            found.append((abs(crossed.correlation), other.name))
    return max(found)[1] if found else None


def _is_mutual(joint: Watched, other: Watched, servo: ServoResponse) -> bool:
    """Whether the other joint follows this one's command rather than its own."""
    theirs = follows(other._replace(commands=joint.commands), servo)
    return theirs.leaves_less_than(follows(other, servo))
