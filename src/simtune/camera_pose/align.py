"""The camera before which the drawn robot lies on the filmed one, pixel by pixel."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from simtune.camera_pose.scene import camera_parameters, surfaces
from simtune.simulation import Simulator

# Pixels by which both are blurred: a far start sees where to go, a near one what is exact.
COARSE = (3.0, 3.0, 3.0, 3.0, 2.0, 2.0, 2.0, 2.0, 1.5, 1.5, 1.0, 1.0, 1.0)
FINE = (2.0, 2.0, 1.5, 1.5, 1.0, 1.0, 1.0)
_MOVED, _RECOLOURED = 0.5, 0.1  # of the range: a pixel of blur at this height; a colour
_ROBUST, _LEAST_NOISE = 3.0, 1.5 / 255
_LARGEST_STEP = 0.1
_FARTHEST = 0.08  # of the range, by which to derive where little changes
_COLOUR, _GAIN, _OFFSET = 0.35, 0.1, 0.03  # how far off they may be, of the full scale
_SHOWN = 0.3  # of the full scale over the range, that a pixel has to change to count for the noise
_SQUARE_PX = 4  # neighbouring pixels tell the same: 4 × 4 of them count as one


@dataclass(frozen=True)
class Camera:
    """In unit coordinates of the P parameters of the camera."""

    unit: np.ndarray  # (P,)
    covariance: np.ndarray  # (P, P)
    cost: float  # lower is better, among fits of the same frames


class Alignment:
    """Frames of known states; Gauss and Newton's steps on pixels, each less blurred."""

    def __init__(
        self,
        simulator: Simulator,
        frames: np.ndarray,
        states: np.ndarray,
        blurs: tuple[float, ...],
    ):
        """(M, H, W, 3) frames of (M, S) states."""
        self._simulator, self._states, self._blurs = simulator, states, blurs
        self._real = frames.astype(np.float32) / 255
        self._camera = camera_parameters(simulator.space)
        self._surfaces = surfaces(simulator.space)

    def fit(
        self, start: np.ndarray, colours: np.ndarray | None = None
    ) -> tuple[Camera, np.ndarray]:
        """From a camera (P,) in unit coordinates; and the (N,) unit coordinates of everything.

        With drawn pixels d(u), real ones y, weights W (Geman and McClure 1985) and A = ∂d/∂u:

            u ← u − (AᵀWA + prior)⁻¹ AᵀW (d(u) − y)

        Pictures are rough: derivatives are taken along the eigenvectors of the last AᵀWA, farther
        where less changes, or what is rough in them would hide where a camera can hardly be told.
        A surface's three colours are derived at once, since each changes a channel of its own. What
        is filmed may also be brighter or darker than what is drawn, by channel, all over.
        """
        space, num = self._simulator.space, len(self._camera)
        unit = space.to_unit(space.nominal) if colours is None else colours.copy()
        unit[self._camera] = start
        every = np.concatenate([self._camera, *self._surfaces]).astype(int)
        spread = [1.0] * num + [_COLOUR] * (len(every) - num) + [_GAIN] * 3 + [_OFFSET] * 3
        prior, tone = np.diag(np.array(spread) ** -2), np.zeros((2, 3))
        best, best_cost, covariance = unit, np.inf, np.eye(num)
        ways = np.eye(num)  # rows
        for blur in self._blurs:
            drawn, real = self._draw(unit, blur), _blurred(self._real, blur)
            seen = drawn * (1 + tone[0]) + tone[1]
            shortest = _MOVED * blur / len(self._real[0])
            slopes = self._slopes(unit, ways * shortest, drawn, blur)
            slopes = np.concatenate([slopes, _of_tone(drawn)])
            information, slope, cost = _equations(slopes, seen - real)
            slope[len(every) :] += tone.ravel() * np.diag(prior)[len(every) :]
            step = -np.linalg.solve(information + prior, slope)
            step *= min(1.0, _LARGEST_STEP / np.abs(step[:num]).max())
            if blur == self._blurs[-1] and cost < best_cost:
                best, best_cost = unit.copy(), cost
                covariance = np.linalg.inv(information + prior)[:num, :num]
            ways = _ways(information[:num, :num], _FARTHEST / shortest)
            unit = unit.copy()
            unit[every] = np.clip(unit[every] + step[: len(every)], 0, 1)
            tone = tone + step[len(every) :].reshape(2, 3)
        return Camera(best[self._camera], covariance, best_cost), best

    def _draw(self, unit: np.ndarray, blur: float) -> np.ndarray:
        """(M, H, W, 3) of the full scale."""
        parameters = np.repeat(self._simulator.space.from_unit(unit)[None], len(self._states), 0)
        drawn = self._simulator.render(self._states, parameters)
        return _blurred(drawn.astype(np.float32) / 255, blur)

    def _slopes(
        self, unit: np.ndarray, ways: np.ndarray, drawn: np.ndarray, blur: float
    ) -> np.ndarray:
        """(P + 3 · surfaces, M, H, W, 3), of the camera's P by changes (P, P), one a row."""
        changes = []
        for way in ways:
            changed = unit.copy()
            changed[self._camera] += way
            changes.append(self._draw(changed, blur) - drawn)
        slopes = np.tensordot(np.linalg.inv(ways), np.stack(changes), 1)
        of_colours = []
        for channels in self._surfaces:
            changed, delta = unit.copy(), np.where(unit[channels] > 0.5, -_RECOLOURED, _RECOLOURED)
            changed[channels] += delta
            change = (self._draw(changed, blur) - drawn) / delta
            of_colours += list(change * np.eye(3)[:, None, None, None])
        return np.concatenate([slopes, of_colours]) if of_colours else slopes


def _of_tone(drawn: np.ndarray) -> np.ndarray:
    """(6, M, H, W, 3): of the gain of each channel, and of what is added to it."""
    channels = np.eye(3)[:, None, None, None]
    return np.concatenate([drawn * channels, np.broadcast_to(channels, (3, *drawn.shape))])


def _ways(information: np.ndarray, farthest: float) -> np.ndarray:
    """(P, P) eigenvectors, longer where less is told, from 1 to `farthest`."""
    values, vectors = np.linalg.eigh(information)
    lengths = np.sqrt(values.max() / np.maximum(values, 1e-9 * values.max()))
    return (vectors * np.minimum(lengths, farthest)).T


def _blurred(pictures: np.ndarray, blur: float) -> np.ndarray:
    return gaussian_filter(pictures, (0, blur, blur, 0), mode="nearest")


def _equations(slopes: np.ndarray, residuals: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """(Q, Q) information, (Q,) slope and the mean robust cost, of (Q, …) slopes."""
    slopes, r = slopes.reshape(len(slopes), -1), residuals.ravel()
    shown = np.abs(slopes).max(0) > _SHOWN
    if not shown.any():
        return np.eye(len(slopes)), np.zeros(len(slopes)), np.inf
    noise = max(_LEAST_NOISE, 1.48 * float(np.median(np.abs(r[shown]))))
    weight = shown / (1 + np.square(r / (_ROBUST * noise))) ** 2 / noise**2 / _SQUARE_PX**2
    weighted = slopes * weight
    squared = np.square(r[shown] / (_ROBUST * _LEAST_NOISE * 4))
    return weighted @ slopes.T, weighted @ r, float(np.mean(squared / (1 + squared)))
