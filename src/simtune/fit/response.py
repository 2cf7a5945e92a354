"""What a camera makes of the light that reaches it (its radiometric response).

With x what is drawn, of the full scale, channel by channel,

    seen = offset + gain · x ^ gamma        at most 1, at least 0

The gains of the channels are the camera's exposure and its white balance. All pictures of a camera
share one response. Nobody knows it, so gains and colours are told apart only where an object's
colour is known; what cameras usually do is the prior.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from simtune.vision.image_noise import ImageNoise

NUM_UNKNOWN = 5  # of a camera: the logarithms of three gains and of gamma, and the offset
_GAMMA, _OFFSET = 3, 4
_DARK = 1e-3  # of the full scale: no logarithm of less
_ANY_GAIN = 0.5  # standard deviation of its logarithm
# Shadows, highlights and textures are drawn otherwise than they are, in all pictures alike. So all
# pixels of known colours tell no more than so many would, which are wrong by such shares each, or
# of the full scale.
_FEW, _WRONG, _WRONG_IN_THE_DARK = 10, 0.02, 0.01


@dataclass(frozen=True)
class CameraResponse:
    """Of one camera."""

    unknown: np.ndarray  # (5,) see NUM_UNKNOWN: all 0 where pictures are as drawn

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

    def __call__(self, drawn: np.ndarray) -> np.ndarray:
        """(..., 3) of the full scale as they are seen."""
        return self._unclipped(drawn).clip(0, 1)

    def derive(self, drawn: np.ndarray) -> np.ndarray:
        """(5, ..., 3) derivatives of what is seen by the unknowns; 0 where it is clipped."""
        seen, slopes = self._unclipped(drawn), np.zeros((NUM_UNKNOWN, *drawn.shape), np.float32)
        light = seen - self.offset
        for channel in range(_GAMMA):
            slopes[channel, ..., channel] = light[..., channel]
        slopes[_GAMMA] = light * self.gamma * np.log(np.maximum(drawn, _DARK))
        slopes[_OFFSET] = 1
        return slopes * ((seen > 0) & (seen < 1))

    def _unclipped(self, drawn: np.ndarray) -> np.ndarray:
        gain = self.gain.astype(np.float32)
        return np.float32(self.offset) + gain * drawn.clip(0) ** np.float32(self.gamma)

    def to_json(self) -> dict[str, Any]:
        return {"gain": self.gain.tolist(), "gamma": self.gamma, "offset": self.offset}


class Photometry(NamedTuple):
    """What is known of colours and of the cameras that see them."""

    camera_noise: ImageNoise | None  # what is usual of cameras; None: the simulator's own
    known: np.ndarray  # (N,) values of the parameters that are known, NaN of all others

    @property
    def is_known(self) -> np.ndarray:
        """(N,) bool."""
        return np.isfinite(self.known)


class Told(NamedTuple):
    """What known colours say of C cameras, beside what is usual."""

    step: np.ndarray  # (5 C,) from where the unknowns are
    covariance: np.ndarray  # (5 C, 5 C)


def told_by_known(
    slopes: np.ndarray,
    trust: np.ndarray,
    residual: np.ndarray,
    drawn: np.ndarray,
    usual: ImageNoise,
    at: np.ndarray,
) -> Told:
    """By (5 C, M, pixels) slopes; `trust`: (M, pixels), 0 where no known colour shows, 1 at most.

    `residual`: (M, pixels) of what was `drawn`, drawn − real; `at`: (5 C,) where unknowns are.
    """
    step, covariance = np.zeros_like(at), np.zeros((len(at),) * 2)
    for camera in range(0, len(at), NUM_UNKNOWN):
        its = slice(camera, camera + NUM_UNKNOWN)
        seen = trust * (slopes[camera + _OFFSET] > 0)
        channels = seen.reshape(-1, _GAMMA).sum(0)  # each tells as much
        each = _FEW / np.maximum(channels, 1e-9)
        weight = seen * np.tile(each, seen.shape[1] // _GAMMA)
        weight /= np.square(_WRONG * drawn) + _WRONG_IN_THE_DARK**2
        prior = _prior(usual, gains_are_usual=not seen.any())
        weighted = slopes[its] * weight
        information = prior + np.einsum("amp,bmp->ab", weighted, slopes[its])
        slope = prior @ at[its] + np.einsum("amp,mp->a", weighted, residual)
        covariance[its, its] = np.linalg.inv(information)
        step[its] = -covariance[its, its] @ slope
    return Told(step, covariance)


def _prior(usual: ImageNoise, gains_are_usual: bool) -> np.ndarray:
    """(5, 5) inverse covariance of a camera's unknowns, which are normal around 0.

    Where a known colour tells the gains, cameras may be as unusual as it says.
    """
    covariance = np.diag(np.square([*[usual.tint] * 3, usual.gamma, usual.offset]))
    covariance[:_GAMMA, :_GAMMA] += usual.gain**2  # exposure is one for all channels
    if not gains_are_usual:
        covariance[:_GAMMA, :_GAMMA] = _ANY_GAIN**2 * np.eye(3)
    return np.linalg.inv(covariance)
