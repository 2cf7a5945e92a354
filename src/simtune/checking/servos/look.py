"""All that is looked at in one joint's readings beside its commands."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

from simtune.checking.doubt import Doubt
from simtune.checking.servos.common_units import common_scales
from simtune.checking.servos.doubts import (
    EXCHANGED,
    WEAK,
    doubts,
    misread_by,
    of_common_scale,
)
from simtune.checking.servos.fit import ServoResponse, fit_servo, predict
from simtune.checking.servos.following import Watched, follows
from simtune.checking.servos.picture import Curve
from simtune.checking.servos.play import find_play
from simtune.checking.servos.velocities import VELOCITIES
from simtune.fit import FEWEST_STEPS
from simtune.observation import JointSensor
from simtune.run.files import plain


class SeenJoint(NamedTuple):
    """How a joint follows its commands."""

    servo: ServoResponse
    play: float | None  # from end to end, if it is clear
    curve: Curve  # in the first episode that is long enough
    doubts: list[Doubt]
    misread_by: float | None  # factor on its readings that they should not have, if that is clear

    def facts(self) -> dict[str, Any]:
        """JSON."""
        return plain({"unit": self.curve.unit, **asdict(self.servo), "play": self.play})


def look_at_all(
    joints: Sequence[Watched | None], sensors: Sequence[JointSensor]
) -> list[SeenJoint | None]:
    """At D readings' joints; a wrong unit of a whole sensor comes before all else.

    Only what is odd in the right unit, too, is told beside it.
    """
    scales = common_scales(joints, sensors)
    right = [
        joint and joint._replace(measured=[read / (scale or 1) for read in joint.measured])
        for joint, scale in zip(joints, scales, strict=True)
    ]
    others, seen = [joint for joint in right if joint], list[SeenJoint | None]()
    for joint, mended, scale in zip(joints, right, scales, strict=True):
        if joint is None or mended is None:
            seen.append(None)
            continue
        look = look_at(mended, others)
        if scale:
            as_read, by = look_at(joint), look.misread_by
            told = [of_common_scale(joint, scale), *look.doubts]
            look = as_read._replace(doubts=told, misread_by=None if by is None else scale * by)
        seen.append(look)
    return _without_partners(joints, seen)


def _without_partners(
    joints: Sequence[Watched | None], seen: Sequence[SeenJoint | None]
) -> list[SeenJoint | None]:
    """Joints whose column another one seems to have are not said to be weak as well."""
    partners = {doubt.partner for look in seen if look for doubt in look.doubts}
    return [
        look._replace(doubts=[doubt for doubt in look.doubts if doubt.kind != WEAK])
        if look and joint and joint.name in partners
        else look
        for joint, look in zip(joints, seen, strict=True)
    ]


def look_at(joint: Watched, others: Sequence[Watched] = ()) -> SeenJoint:
    """`others`: joints whose column it may be. At least one episode is long enough."""
    long = [e for e, command in enumerate(joint.commands) if len(command) >= FEWEST_STEPS]
    asked, measured = [joint.commands[e] for e in long], [joint.measured[e] for e in long]
    servo = fit_servo(asked, measured, joint.step_s)
    play = None if joint.is_speed else find_play(servo, asked, measured, joint.step_s)
    (predicted,) = predict(servo, asked[:1], joint.step_s)
    following = follows(joint, servo)
    found = doubts(joint, servo, following, others)
    is_another = any(doubt.kind in (VELOCITIES, EXCHANGED) for doubt in found)
    return SeenJoint(
        servo,
        play.width if play and play.is_clear(servo.noise) else None,
        Curve(joint.unit, asked[0], measured[0], predicted, servo),
        found,
        misread_by=None if is_another else misread_by(joint.unit, following),
    )
