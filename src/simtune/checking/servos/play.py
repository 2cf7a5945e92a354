"""Hysteresis of a joint, from play of gears or dry friction.

Both look the same: after a reversal the reading rests until its command has moved on by the play.
For a servo of stiffness kp with dry friction f that is 2 f / kp.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from simtune.checking.servos.fit import Episodes, ServoResponse, lowest, predict

_NUM_WIDTHS, _REFINEMENT, _NUM_REFINEMENTS = 8, 3, 3  # of a first grid; of finer ones
_LAG_SHARES = (1.0, 0.75, 0.5, 0.25, 0.0)  # of the lag's delay, that are tried
_MAX_WIDTH_SHARE = 0.25  # of the commanded travel
_MAX_RMS_RATIO = 0.85  # of residuals with to without a play, for it to be reported
_MIN_WIDTH_NOISES = 3.0  # of the readings: smaller plays are ignored


class Play(NamedTuple):
    """Between a lagging servo's motion and the reading; in the sensor's unit."""

    width: float  # from end to end
    rms: float  # of the residuals
    rms_without: float  # ... with a play of 0, all else equal

    def is_clear(self, noise: float) -> bool:
        """Whether it explains more than noise does."""
        return (
            self.width > _MIN_WIDTH_NOISES * noise and self.rms < _MAX_RMS_RATIO * self.rms_without
        )


def find_play(servo: ServoResponse, commands: Episodes, measured: Episodes, step_s: float) -> Play:
    """Of a joint's (T,) commands and (T + 1,) readings; NaN if its command tells nothing."""
    if not np.isfinite(servo.filtered_rms):
        return Play(np.nan, np.nan, np.nan)
    # A lag fitted alone is too long: it compensates for some of the play.
    lags = (replace(servo, filtered_lag_s=share * servo.filtered_lag_s) for share in _LAG_SHARES)
    plays = [_behind(predict(lag, commands, step_s), measured, servo.commanded) for lag in lags]
    best = min(plays, key=lambda play: play.rms)
    return best._replace(rms_without=min(play.rms_without for play in plays))


def _behind(followed: Episodes, measured: Episodes, commanded: float) -> Play:
    """Between the motion of a servo without play, and (T + 1,) readings."""
    speed = np.concatenate([np.gradient(x) for x in followed])
    read = np.concatenate([y[: len(x)] for x, y in zip(followed, measured, strict=True)])
    known = np.isfinite(read)

    def left(width: float) -> float:
        """Residuals; speed and scale are fitted as well, since lag and stiffness may differ."""
        moved = np.concatenate([through_play(x, width) for x in followed])
        columns = np.stack([np.ones_like(moved), moved, speed], 1)[known]
        best = np.linalg.lstsq(columns, read[known], rcond=None)[0]
        return float(np.std(read[known] - columns @ best))

    grid = {"num": _NUM_WIDTHS + 1, "times": _NUM_REFINEMENTS, "finer": _REFINEMENT}
    best = lowest(left, _MAX_WIDTH_SHARE * commanded, **grid, is_bound=False)
    return Play(best, left(best), left(0.0))


def through_play(motor: np.ndarray, width: float) -> np.ndarray:
    """(T,) what a motor at (T,) moves through a play; it begins in the middle of it."""
    moved, at = np.empty(len(motor)), float(motor[0])
    for t, angle in enumerate(motor.tolist()):
        at = min(max(at, angle - width / 2), angle + width / 2)
        moved[t] = at
    return moved
