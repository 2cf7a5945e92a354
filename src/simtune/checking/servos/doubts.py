"""Features of a joint's readings that no servo in a model can explain."""

from collections.abc import Sequence

import numpy as np

from simtune.checking.doubt import Doubt
from simtune.checking.servos.fit import ServoResponse, delayed_by, predict, usual_travel
from simtune.checking.servos.following import (
    HARDLY,
    Following,
    Watched,
    better_column,
    followed_instead,
)
from simtune.checking.servos.velocities import are_velocities
from simtune.columns import episode_in_words
from simtune.units import OTHER_UNITS

EXCHANGED = "are columns exchanged?"  # kind of a doubt

_MIN_TRAVEL_SHARE = 0.05  # of what is commanded: a joint that moves less stands still
_STUCK_S = 0.7  # with exactly the same reading
_STUCK_TRAVEL_SHARE = 0.15  # of the commanded travel, in the meantime
_SLOPE_FACTOR = 1.25  # within which two slopes may be the same
_MAX_SHORTENING = 2.0  # the same, towards smaller slopes: contacts shorten a joint's way
_NEAR_FAR_SHARES = (0.5, 0.75)  # of the way to the farthest command: near below, far above
_SHORT_SHARE, _SHORT_RESIDUALS = 0.1, 4.0  # of that way; factor on the residuals near by
_MIN_FAR_FRAMES = 20
_IMPOSSIBLE_SPEED_RATIO = 3.0  # to what is commanded: no motor is so fast
_OTHER_COLUMN = "{}'s column does, though not its own: is that one meant?"
WEAK = (
    "no other joint's column does so better. Is its servo weak beside what it carries, is there "
    "something in its way, or is this no joint's column?"
)
_RPM_PER_RAD_S = 30 / np.pi


def doubts(
    joint: Watched, servo: ServoResponse, following: Following, others: Sequence[Watched] = ()
) -> list[Doubt]:
    """On a joint's readings beside its commands, and those of `others`."""
    name, unit = joint.name, joint.unit
    if not servo.commanded > 0 or not np.isfinite(servo.travel):
        return []
    values = np.concatenate(list(joint.measured))
    if (value := np.nanmin(values)) == np.nanmax(values):
        says = f"reads {value:.4g} {unit} all the time, while it is commanded over"
        asks = "is the sensor stuck, or another column meant?"
        return [_doubt(joint, f"{says} {servo.commanded:.3g} {unit}", asks)]
    if odd := are_velocities(joint, servo, following):
        return [odd]
    if other := followed_instead(joint, servo, following, others):  # may look like another sign
        own = f"its own with a correlation of {following.correlation:.2f}"
        doubt = _doubt(joint, f"follows {other}'s command, {own}", EXCHANGED)
        return [*_stuck(joint, servo), doubt._replace(likewise=f"{name} {other}'s", partner=other)]
    if odd := _other_scale(joint, following):
        return [odd]
    if servo.travel < _MIN_TRAVEL_SHARE * servo.commanded:
        asks = "is it switched on, and this its column?" + _in_other_unit(unit, servo)
        says = f"does not move, though commanded over {servo.commanded:.3g} {unit}: it reads within"
        return [_doubt(joint, f"{says} {servo.travel:.2g} {unit}", asks, "; ")]
    found = _stuck(joint, servo)
    if abs(following.correlation) < HARDLY:
        says = f"hardly follows its command (correlation {following.correlation:.2f})"
        column = better_column(joint, servo, following, others)
        asks = _OTHER_COLUMN.format(column) if column else WEAK
        return [*found, _doubt(joint, says, asks)]
    return found + _falls_short(joint, servo)


def _doubt(joint: Watched, says: str, asks: str, between: str = ": ") -> Doubt:
    """What a joint does, and what to ask of all that do so."""
    return Doubt(f"{joint.name} {says}{between}{asks}", asks, joint.name)


def misread_by(unit: str, following: Following) -> float | None:
    """What readings in `unit` are multiplied by: another unit's factor, −1, or both; else 1.

    None where it is not clear how they follow their commands.
    """
    if not following.is_clear:
        return None
    factor = OTHER_UNITS[unit][0] if unit in OTHER_UNITS else np.nan
    size = abs(following.slope)
    if factor / _SLOPE_FACTOR < 1 / size < factor * _MAX_SHORTENING:
        return 1.0  # or actions are
    if size > _IMPOSSIBLE_SPEED_RATIO and unit.endswith("/s") and not _is_in_unit(size, factor):
        return None
    return np.sign(following.slope) * (factor if _is_in_unit(size, factor) else 1.0)


def of_common_scale(joint: Watched, scale: float) -> Doubt:
    """On a joint whose sensor's readings are all so many times too large."""
    factor, other, key = OTHER_UNITS[joint.unit]
    moved = usual_travel(joint.measured) / usual_travel(joint.commands)
    says = f"moves {moved:.3g} times as far as its command, and so do this sensor's other joints"
    if scale == factor:
        return _doubt(joint, says, _in_unit(other, key))
    return _doubt(joint, says, _unit_already(joint, other))


def _in_unit(other: str, key: str) -> str:
    return f'are its readings {other}? give the sensor unit = "{key}"'


def _unit_already(joint: Watched, other: str) -> str:
    own = joint.unit.removesuffix("/s" if joint.positions else "")
    return f"are its readings {own} already, or are the actions {other}? see unit and [actions]"


def _in_other_unit(unit: str, servo: ServoResponse) -> str:
    """Asked if a joint that seems to rest moves as far as commanded, were commands of `unit`."""
    if unit not in OTHER_UNITS:
        return ""
    factor, other, _ = OTHER_UNITS[unit]
    is_alike = (
        servo.commanded / _SLOPE_FACTOR < servo.travel * factor < servo.commanded * _SLOPE_FACTOR
    )
    return f" Or are these {unit}, and the sensor says {other}?" * is_alike


def _other_scale(joint: Watched, following: Following) -> Doubt | None:
    if not following.is_clear:
        return None
    size = abs(following.slope)
    also = "; the sign is reversed, too" * (following.slope < 0)
    far = "fast" if joint.is_speed else "far"
    says = f"moves {following.slope:.3g} times as {far} as its command"
    if joint.unit in OTHER_UNITS:
        factor, other, key = OTHER_UNITS[joint.unit]
        if _is_in_unit(size, factor):
            return _doubt(joint, says, f"{_in_unit(other, key)}{also}")
        if factor / _SLOPE_FACTOR < 1 / size < factor * _MAX_SHORTENING:
            return _doubt(joint, says, f"{_unit_already(joint, other)}{also}")
    if joint.is_speed and (asks := _other_speed(joint, size)):
        return _doubt(joint, says, f"{asks}{also}")
    if following.slope < 0:
        return _doubt(joint, says, "the sign of its readings, or of its actions, is reversed")
    return None


def _other_speed(joint: Watched, size: float) -> str | None:
    """Asked of speeds that are so many times as large as commanded ones."""
    if joint.unit == "rad/s" and _is_in_unit(1 / size, _RPM_PER_RAD_S):
        return f"are the actions turns a minute? give [actions] gain = {1 / _RPM_PER_RAD_S:.4f}"
    if joint.unit == "rad/s" and not joint.positions and _is_in_unit(size, _RPM_PER_RAD_S):
        return f"are its readings turns a minute? give the sensor gain = {1 / _RPM_PER_RAD_S:.4f}"
    if size > _IMPOSSIBLE_SPEED_RATIO:
        return "are its readings an encoder's counts? give the sensor a gain, rad or m of one count"
    return None


def _is_in_unit(slope: float, factor: float) -> bool:
    """Whether readings move as far beside their commands as in a unit so much smaller."""
    return factor / _MAX_SHORTENING < slope < factor * _SLOPE_FACTOR


def _stuck(joint: Watched, servo: ServoResponse) -> list[Doubt]:
    """The longest time with exactly the same reading, while the command changes.

    Not of speeds that are told by counts: a slow wheel is counted seldom.
    """
    if joint.positions:
        return []
    longest = (0, 0.0, 0)  # steps, the reading, the episode
    for episode, (command, read) in enumerate(zip(joint.commands, joint.measured, strict=True)):
        late = delayed_by(command, servo.lag_steps)
        ends = np.flatnonzero(np.append(np.diff(read[: len(late)]) != 0, True)) + 1
        for start, end in zip([0, *ends[:-1]], ends, strict=True):
            meanwhile = np.ptp(late[start:end])
            if meanwhile > _STUCK_TRAVEL_SHARE * servo.commanded and end - start > longest[0]:
                longest = int(end - start), float(read[start]), episode
    steps, value, episode = longest
    seconds = steps * joint.step_s
    if seconds < _STUCK_S:
        return []
    says = (
        f"reads {value:.4g} {joint.unit} for {seconds:.2g} s of "
        f"{episode_in_words(joint.episodes, episode)} while it is commanded elsewhere"
    )
    return [_doubt(joint, says, "does its sensor get stuck, or the joint?")]


def _falls_short(joint: Watched, servo: ServoResponse) -> list[Doubt]:
    """Readings that fall short of the farthest commands, compared with nearer ones."""
    unit, commands, measured = joint.unit, joint.commands, joint.measured
    x = np.concatenate(predict(servo, commands, joint.step_s))
    y = np.concatenate([read[: len(c)] for c, read in zip(commands, measured, strict=True)])
    x, y = x[np.isfinite(y)], y[np.isfinite(y)]
    middle = float(np.median(x))
    for end in np.percentile(x, (1, 99)):
        way = (x - middle) / (end - middle) if end != middle else np.zeros(len(x))
        near, far = way < _NEAR_FAR_SHARES[0], way > _NEAR_FAR_SHARES[1]
        if min(near.sum(), far.sum()) < _MIN_FAR_FRAMES or np.ptp(x[near]) == 0:
            continue
        line = np.polynomial.Polynomial.fit(x[near], y[near], 1)
        usual = np.std(y[near] - line(x[near]))
        short = float(np.mean(line(x[far]) - y[far]) * np.sign(end - middle))
        if short > max(_SHORT_SHARE * abs(end - middle), _SHORT_RESIDUALS * usual):
            says = (
                f"stays {short:.2g} {unit} behind where it is commanded to about {end:.3g} {unit}, "
                "and follows elsewhere"
            )
            return [_doubt(joint, says, "a torque limit, a stop, or something that it holds?")]
    return []
