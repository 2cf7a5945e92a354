"""A camera's radiometric response: what it makes of the light that reaches it.

With x what is drawn, of the full scale, channel by channel,

    seen = offset + exposure · gain · x ^ gamma        at most 1, at least 0

The channels' gains are the camera's usual exposure and white balance. All pictures of a camera
share one response; each picture has an exposure of its own around 1, which may drift. The response
is unknown, and gains can be separated from colours only where an object's colour is known; the
prior is what cameras usually do.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from simtune.vision.image_noise import ImageNoise

# Per camera: the logarithms of three gains and of gamma, and the offset
NUM_CHANNELS, NUM_UNKNOWN = 3, 5
_GAMMA, _OFFSET = NUM_CHANNELS, 4
_LOG_FLOOR = 1e-3  # of the full scale
_UNUSUAL_STDS = 3.0  # of what cameras usually do
_LOG_GAIN_STD = 0.5  # prior, where known colours inform it
# Shadows, highlights and textures are drawn wrongly in all pictures alike. So all pixels of known
# colours together count as _COUNTED_PIXELS, each with a relative and an absolute error.
_COUNTED_PIXELS, _RELATIVE_ERROR, _ABSOLUTE_ERROR = 10, 0.02, 0.01


@dataclass(frozen=True)
class CameraResponse:
    """Response of one camera."""

    unknown: np.ndarray  # (5,) see NUM_UNKNOWN; all 0: the identity

    @property
    def gain(self) -> np.ndarray:
        """(3,) of R, G and B."""
        return np.exp(self.unknown[:_GAMMA])

    @property
    def gamma(self) -> float:
        return float(np.exp(self.unknown[_GAMMA]))

    @property
    def offset(self) -> float:
        """Of the full scale."""
        return float(self.unknown[_OFFSET])

    def __call__(self, drawn: np.ndarray, exposure: np.ndarray | float = 1.0) -> np.ndarray:
        """(M, ..., 3) of the full scale as the camera sees them; `exposure`: (M,) of each."""
        return self._unclipped(drawn, exposure).clip(0, 1)

    def derive(self, drawn: np.ndarray, exposure: np.ndarray | float = 1.0) -> np.ndarray:
        """(5, M, ..., 3) derivatives of what is seen by the unknowns; 0 where it is clipped."""
        seen = self._unclipped(drawn, exposure)
        slopes = np.zeros((NUM_UNKNOWN, *drawn.shape), np.float32)
        light = seen - self.offset
        for channel in range(_GAMMA):
            slopes[channel, ..., channel] = light[..., channel]
        slopes[_GAMMA] = light * self.gamma * np.log(np.maximum(drawn, _LOG_FLOOR))
        slopes[_OFFSET] = 1
        return slopes * ((seen > 0) & (seen < 1))

    def _unclipped(self, drawn: np.ndarray, exposure: np.ndarray | float) -> np.ndarray:
        each = np.reshape(exposure, (-1, *[1] * (drawn.ndim - 1)))
        gain = (each * self.gain).astype(np.float32)
        return np.float32(self.offset) + gain * drawn.clip(0) ** np.float32(self.gamma)

    def is_usual(self, usual: ImageNoise) -> bool:
        """Whether gamma and offset are a camera's; a gain may be any."""
        shape = np.abs(self.unknown[_GAMMA:]) / (usual.gamma, usual.offset)
        return bool(shape.max() < _UNUSUAL_STDS)

    def to_json(self) -> dict[str, Any]:
        return {"gain": self.gain.tolist(), "gamma": self.gamma, "offset": self.offset}


class Photometry(NamedTuple):
    """Prior knowledge of colours and of the cameras that see them."""

    camera_noise: ImageNoise | None  # prior of the cameras; None: the simulator's own
    known: np.ndarray  # (N,) values of known parameters, NaN for all others

    @property
    def is_known(self) -> np.ndarray:
        """(N,) bool."""
        return np.isfinite(self.known)

    def unusual(self, responses: Sequence[CameraResponse]) -> CameraResponse | None:
        """The first of these that is no usual camera's."""
        usual = self.camera_noise
        return next((its for its in responses if usual and not its.is_usual(usual)), None)


class ResponseStep(NamedTuple):
    """Estimate of C cameras' responses from known colours and the prior."""

    step: np.ndarray  # (5 C,) from the current unknowns
    covariance: np.ndarray  # (5 C, 5 C)


def step_by_known_colours(
    slopes: np.ndarray,
    trust: np.ndarray,
    residual: np.ndarray,
    drawn: np.ndarray,
    usual: ImageNoise,
    at: np.ndarray,
) -> ResponseStep:
    """From (5 C, M, pixels) slopes; `trust`: (M, pixels) 0 to 1, 0 where no known colour shows.

    `residual`: (M, pixels) drawn − real; `at`: (5 C,) current unknowns.
    """
    step, covariance = np.zeros_like(at), np.zeros((len(at),) * 2)
    for camera in range(0, len(at), NUM_UNKNOWN):
        own = slice(camera, camera + NUM_UNKNOWN)
        seen = trust * (slopes[camera + _OFFSET] > 0)
        channels = seen.reshape(-1, _GAMMA).sum(0)  # each with about as much information
        per_value = _COUNTED_PIXELS / np.maximum(channels, 1e-9)
        weight = seen * np.tile(per_value, seen.shape[1] // _GAMMA)
        weight /= np.square(_RELATIVE_ERROR * drawn) + _ABSOLUTE_ERROR**2
        prior = _prior(usual, gains_are_usual=not seen.any())
        weighted = slopes[own] * weight
        information = prior + np.einsum("amp,bmp->ab", weighted, slopes[own])
        slope = prior @ at[own] + np.einsum("amp,mp->a", weighted, residual)
        covariance[own, own] = np.linalg.inv(information)
        step[own] = -covariance[own, own] @ slope
    return ResponseStep(step, covariance)


def _prior(usual: ImageNoise, gains_are_usual: bool) -> np.ndarray:
    """(5, 5) inverse covariance of a camera's unknowns, normal around 0.

    If known colours inform the gains, their prior is wide.
    """
    covariance = np.diag(np.square([*[usual.tint] * 3, usual.gamma, usual.offset]))
    covariance[:_GAMMA, :_GAMMA] += usual.gain**2  # exposure is common to all channels
    if not gains_are_usual:
        covariance[:_GAMMA, :_GAMMA] = _LOG_GAIN_STD**2 * np.eye(3)
    return np.linalg.inv(covariance)
