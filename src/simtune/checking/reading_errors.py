"""What the best fit may leave of joint readings: their noise at best, or what simple lags leave."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from simtune.checking.servos.fit import ServoResponse
from simtune.checking.servos.roughness import roughness
from simtune.observation import JointSensor, assumed_noise, declared_noise

_CORRELATED_S = 0.5  # correlation time of a reading's residuals: model errors, not noise
_RESIDUAL_SHARE = 0.03  # of a reading's travel: assumed residuals of a fit if no servo gives them
_ASSUMED_OF_RECORDINGS = (
    f"as if what a lag and an offset leave of each reading, for {_CORRELATED_S:g} s at a "
    "time, were left by the best fit, too"
)
_ASSUMED = "as if readings had no errors but their sensors' noise"


class ReadingErrors(NamedTuple):
    """Standard deviations of D readings' errors, as if each were independent."""

    noise: np.ndarray  # (D,)
    assumed: str  # what that assumes, in words
    at_best: np.ndarray | None = None  # (D,) the least that it may be; None: that is the same


def of_simulated(sensors: Sequence[JointSensor]) -> ReadingErrors:
    """A simulator of the same kind leaves nothing but noise."""
    return ReadingErrors(assumed_noise(sensors), _ASSUMED)


def of_recorded(
    values: np.ndarray,
    servos: Mapping[str, ServoResponse],
    labels: Sequence[str],
    sensors: Sequence[JointSensor],
    step_s: float,
) -> ReadingErrors:
    """Of (E, T + 1, D) readings with these labels, some of which `servos` are known.

    How much a model lacks is seen only once it is fitted.
    """
    left = np.maximum(assumed_noise(sensors), _left(values, servos, labels))
    noise = left * np.sqrt(max(1.0, _CORRELATED_S / step_s))
    own = declared_noise(sensors)
    rough = np.array([roughness(list(read)) for read in np.moveaxis(values, -1, 0)])
    own = np.where(np.isfinite(own), own, np.where(np.isfinite(rough), rough, noise))
    return ReadingErrors(noise, _ASSUMED_OF_RECORDINGS, np.minimum(own, noise))


def _left(
    values: np.ndarray, servos: Mapping[str, ServoResponse], labels: Sequence[str]
) -> np.ndarray:
    """(D,) root mean square residuals that the best fit may leave of (E, T + 1, D) readings."""
    flat = values.reshape(-1, values.shape[-1])
    usual = _RESIDUAL_SHARE * np.ptp(np.nanpercentile(flat, (1, 99), axis=0), axis=0)
    known = np.array([servos[n].filtered_rms if n in servos else np.nan for n in labels])
    return np.where(np.isfinite(known), known, usual)
