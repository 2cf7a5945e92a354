"""Whether the film looks as if through another lens than the declared one, or none.

A lens that bends straight lines moves the camera that fits best, and so it is fitted with it.
"""

import numpy as np

from simtune.camera_pose.bending import BentGeometry, BentRobot
from simtune.camera_pose.found import Bend, FoundCamera
from simtune.camera_pose.geometry import CameraGeometry
from simtune.camera_pose.robot import Robot
from simtune.camera_pose.sureness import HALF_WIDTH, covariance, is_by_chance
from simtune.camera_pose.tracking import CameraFit, Tracker
from simtune.cameras.lens import Lens

_OFFSET_SCHEDULE_PX = (2.0, 2.0, 1.5, 1.0, 1.0, 1.0)  # from the camera without such a lens
# Of k1's standard deviation, which is rather large: k1 was up to 1.4 of them in films through the
# declared lens, also of robots whose readings were 2° off, 2.0 with a field of view 5 % too narrow;
# 1.9 to 3.8 through others with |k1| of 0.08, and at least 2.2 from 0.1 on.
_CLEAR_K1_STDS = 2.0
_MIN_K1_SHARE = 0.07  # of the largest k1: 2 % at the picture's corner
_MIN_KEPT_SHARE = 0.95  # of the outlines on edges beyond chance, with the lens as well
_UNDECLARED_K1_STD, _DECLARED_K1_STD = 0.1, 0.02


def with_lens(
    found: FoundCamera, tracker: Tracker, robot: Robot, pinhole: CameraGeometry, lens: Lens | None
) -> FoundCamera:
    """The same camera with its `bend`, or that of the fit with k1 if this is clearly better.

    Its ends have both. `tracker`: of the robot before the pinhole; `lens`: declared.
    """
    if is_by_chance(found.agreement):
        return found
    geometry = BentGeometry.of(pinhole, lens)
    bent = tracker.before(BentRobot(robot, geometry), geometry)
    fit = bent.fit(np.append(found.fit.unit, 0.5), _OFFSET_SCHEDULE_PX)
    if fit is None:
        return found
    bend = _bend(fit, geometry, lens)
    if abs(bend.k1) > max(_CLEAR_K1_STDS * bend.k1_std, _MIN_K1_SHARE * geometry.largest):
        agreement = bent.agreement(fit.unit)
        if agreement.beyond_chance > _MIN_KEPT_SHARE * found.agreement.beyond_chance:
            ends = np.append(found.ends, fit.unit[None, :-1], 0)
            return FoundCamera(bend.camera, agreement, ends, bend, is_bent=True)
    # As far towards the other camera as a usual lens would have it.
    share = bend.k1_usual**2 / (bend.k1_usual**2 + bend.k1_std**2)
    end = found.fit.unit + share * (fit.unit[:-1] - found.fit.unit)
    return found._replace(ends=np.append(found.ends, end[None], 0), bend=bend)


def _bend(fit: CameraFit, geometry: BentGeometry, lens: Lens | None) -> Bend:
    span = 2 * geometry.largest
    std = span * float(np.sqrt(covariance(fit)[-1, -1]))
    usual = _DECLARED_K1_STD if lens and lens.is_calibrated else _UNDECLARED_K1_STD
    return Bend(fit, geometry.k1(fit.unit), std, span, usual)


def lens_warnings(found: FoundCamera, lens: Lens | None) -> list[str]:
    """One if another lens explains the film clearly better."""
    if not found.is_bent:
        return []
    assert found.bend is not None
    is_declared = lens is not None and lens.is_calibrated
    declared = lens.distortion[0] if lens is not None else 0.0
    k1, half = declared + found.bend.k1, HALF_WIDTH * found.bend.k1_std
    looks = "the pictures look as if through a lens that bends straight lines"
    interval = f"k1 of about {k1:.2f} ({k1 - half:.2f} to {k1 + half:.2f})"
    if is_declared:
        looks += " otherwise than the declared one"
        than = f"the declared {declared:g}"
        do = "is the calibration this camera's, of pictures of this size, with its signs?"
    else:
        than = "none"
        do = (
            "calibrate the camera, and declare `calibration`, or `intrinsics` and `distortion` "
            "(docs/tuning-file.md), or undistort the film."
        )
    return [
        f"{looks}: {interval} explains them better than {than}; {do} The pose is one behind such "
        "a lens. It is not sure: its intervals reach to the pose without the lens"
    ]
