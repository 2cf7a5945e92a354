"""Features of a joint's readings that no servo in a model can explain, a sentence each."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from simtune.checking.servos.fit import Episodes, Servo, delay_of, delayed_by, predict
from simtune.columns import episode_in_words

_MOVED = 0.05  # of what is commanded: a joint that moves less stands still
_STUCK_S = 0.7  # with exactly the same reading
_STUCK_COMMANDED = 0.15  # of the commanded travel, in the meantime
_FOLLOWS = 0.8  # correlation from which a joint follows its command
_FOLLOWS_ONE_WAY = 0.6  # ... if with the other sign none is half as large, at any delay
_HARDLY = 0.4
_SCALE = 1.25  # factor within which two slopes may be the same
_LESS = 2.0  # ... if contacts, which only shorten a joint's way, made one smaller
_FAR = (0.5, 0.75)  # of the way to the farthest command: near below, far above
_SHORT, _CLEARLY = 0.1, 4.0  # of that way; factor on the residuals near by
_FEWEST = 20  # frames far out
_WAYS = 30  # delays at which readings are compared with commands
_DEGREES = 180 / np.pi
_UNITS = {"rad": (_DEGREES, "degrees", "deg"), "m": (1000.0, "mm", "mm")}


class Following(NamedTuple):
    correlation: float  # the largest in magnitude over all delays
    slope: float  # of readings against commands, at that delay
    opposite: float  # the largest magnitude with the other sign

    @property
    def is_clear(self) -> bool:
        """Whether its sign and about its slope are certain."""
        size = abs(self.correlation)
        return size >= _FOLLOWS or (size >= _FOLLOWS_ONE_WAY and self.opposite < size / 2)


class Watched(NamedTuple):
    """A joint's (T,) commands and (T + 1,) readings in each of the episodes, in `unit`."""

    name: str
    unit: str
    commands: Episodes
    measured: Episodes
    servo: Servo
    step_s: float
    episodes: Sequence[str] = ()  # their names


def doubts(joint: Watched) -> list[str]:
    """On a joint's readings beside its commands."""
    name, unit, commands, measured, servo, step_s, _ = joint
    if not servo.commanded > 0 or not np.isfinite(servo.travel):
        return []
    values = np.concatenate(list(measured))
    if (value := np.nanmin(values)) == np.nanmax(values):
        return [
            f"{name} reads {value:.4g} {unit} all the time, while it is commanded over "
            f"{servo.commanded:.3g} {unit}: is the sensor stuck, or another column meant?"
        ]
    following = follows(commands, measured, servo, step_s)
    if odd := _other_scale(name, unit, following):
        return [odd]
    if servo.travel < _MOVED * servo.commanded:
        factor, other, _ = _UNITS.get(unit, (np.nan, "", ""))
        is_alike = servo.commanded / _SCALE < servo.travel * factor < servo.commanded * _SCALE
        also = f" Or are these {unit}, and the sensor says {other}?" * is_alike
        return [
            f"{name} does not move, though commanded over {servo.commanded:.3g} {unit}: it reads "
            f"within {servo.travel:.2g} {unit}; is it switched on, and this its column?{also}"
        ]
    found = _stuck(joint)
    if abs(following.correlation) < _HARDLY:
        return [
            *found,
            f"{name} hardly follows its command (correlation {following.correlation:.2f}): is it "
            "another joint's column?",
        ]
    return found + _falls_short(joint)


def follows(commands: Episodes, measured: Episodes, servo: Servo, step_s: float) -> Following:
    """Correlation of readings with commands, for any unit and sign."""
    longest = 2 * servo.lag_steps + 0.5 * _WAYS
    y = np.concatenate([read[: len(c)] for c, read in zip(commands, measured, strict=True)])
    known, found = np.isfinite(y), [(0.0, 0.0)]
    # Of a sine, half a period more looks reversed: each sign is compared where it fits best.
    reversed_ = delay_of(commands, [-read for read in measured], step_s)
    for lag in (servo.lag_steps, reversed_, *np.linspace(0, longest, _WAYS)):
        x = np.concatenate([delayed_by(c, lag) for c in commands])[known]
        (xx, xy), (_, yy) = np.cov(x, y[known])
        if xx > 0 and yy > 0:
            found.append((float(xy / np.sqrt(xx * yy)), float(xy / xx)))
    correlation, slope = max(found, key=lambda its: abs(its[0]))
    opposite = max(0.0, *(-its * np.sign(correlation) for its, _ in found))
    return Following(correlation, slope, float(opposite))


def _other_scale(name: str, unit: str, following: Following) -> str | None:
    if not following.is_clear:
        return None
    size, sign = abs(following.slope), "the sign is reversed, too" if following.slope < 0 else ""
    factor, other, key = _UNITS.get(unit, (np.nan, "", ""))
    also = f"; {sign}" * bool(sign)
    times = f"{name} moves {following.slope:.3g} times as far as its command"
    if factor / _LESS < size < factor * _SCALE:
        return f'{times}: are its readings {other}? give the sensor unit = "{key}"{also}'
    if factor / _SCALE < 1 / size < factor * _LESS:
        where = f"{unit} already, or are the actions {other}?"
        return f"{times}: are its readings {where} see unit and [actions]{also}"
    if following.slope < 0:
        return (
            f"{times}: the sign of its readings, or of its actions, is reversed; a sensor's "
            "gain = -1 turns readings (docs/tuning-file.md)"
        )
    return None


def _stuck(joint: Watched) -> list[str]:
    """The longest time with exactly the same reading, while the command changes."""
    name, unit, commands, measured, servo, step_s, episodes = joint
    longest = (0, 0.0, 0)  # steps, the reading, the episode
    for episode, (command, read) in enumerate(zip(commands, measured, strict=True)):
        late = delayed_by(command, servo.lag_steps)
        ends = np.flatnonzero(np.append(np.diff(read[: len(late)]) != 0, True)) + 1
        for start, end in zip([0, *ends[:-1]], ends, strict=True):
            meanwhile = np.ptp(late[start:end])
            if meanwhile > _STUCK_COMMANDED * servo.commanded and end - start > longest[0]:
                longest = int(end - start), float(read[start]), episode
    steps, value, episode = longest
    if steps * step_s < _STUCK_S:
        return []
    return [
        f"{name} reads {value:.4g} {unit} for {steps * step_s:.2g} s of "
        f"{episode_in_words(episodes, episode)} while it is commanded elsewhere: does its sensor "
        "get stuck, or the joint?"
    ]


def _falls_short(joint: Watched) -> list[str]:
    """Readings that fall short of the farthest commands, compared with nearer ones."""
    name, unit, commands, measured, servo, step_s, _ = joint
    x = np.concatenate(predict(servo, commands, step_s))
    y = np.concatenate([read[: len(c)] for c, read in zip(commands, measured, strict=True)])
    x, y = x[np.isfinite(y)], y[np.isfinite(y)]
    middle = float(np.median(x))
    for end in np.percentile(x, (1, 99)):
        way = (x - middle) / (end - middle) if end != middle else np.zeros(len(x))
        near, far = way < _FAR[0], way > _FAR[1]
        if min(near.sum(), far.sum()) < _FEWEST or np.ptp(x[near]) == 0:
            continue
        line = np.polynomial.Polynomial.fit(x[near], y[near], 1)
        usual = np.std(y[near] - line(x[near]))
        short = float(np.mean(line(x[far]) - y[far]) * np.sign(end - middle))
        if short > max(_SHORT * abs(end - middle), _CLEARLY * usual):
            return [
                f"{name} stays {short:.2g} {unit} behind where it is commanded to about "
                f"{end:.3g} {unit}, and follows elsewhere: a torque limit, or a stop?"
            ]
    return []
