"""Colours and light fitted to the pixels themselves, once it is known where everything is.

The detector's estimates are good to a few hundredths. Drawing the fitted states and comparing
pixels is good to a few thousandths, where the simulator draws as the real world looks.
"""

from dataclasses import dataclass

import numpy as np

from simtune.fit.combine import FIRST_VARIANCE, combine, robust_weights
from simtune.simulation import Simulator
from simtune.simulation.states import StateSpace

_DELTA = 0.03  # of a parameter, to derive by: several of a pixel's 256 levels
_ROBUST = 3.0  # noise levels from which a pixel counts less: edges, what is not modelled
_SMALLEST_NOISE = 1.0 / 255
_FIRST_NOISE = 0.1  # at least, then half as much each time: a colour far off is no outlier yet
_LARGEST_STEP = 0.2
_ROUNDING = 1 / 255 / 12**0.5  # standard deviation
_SHOWN = 0.05  # of the full scale, that a pixel changes over a parameter's whole range
_PLACES = 25  # tried for each picture
_SQUARE_PX = 4  # neighbouring pixels tell the same: 4 × 4 of them count as one


@dataclass(frozen=True)
class PictureFit:
    """What a fit found, in unit coordinates of the fitted parameters."""

    unit: np.ndarray  # (V,)
    covariance: np.ndarray  # (V, V)
    noise: float  # of a pixel, robustly, of the full scale


def fit_pictures(
    simulator: Simulator,
    frames: np.ndarray,
    full_states: np.ndarray,
    parameters: np.ndarray,
    fitted: np.ndarray,
    iterations: int = 8,
) -> PictureFit:
    """Fit parameters `fitted` (indices) to (M, H, W, 3) frames of (M, S) states.

    `parameters`: (N,) to start from; the others keep their values.
    """
    space = simulator.space
    unit, variance = space.to_unit(parameters), FIRST_VARIANCE
    covariance = np.zeros((len(fitted),) * 2)
    real = frames.astype(np.float32).reshape(len(frames), -1) / 255
    drawn, slopes = _draw(simulator, full_states, unit, fitted)
    for iteration in range(iterations):
        residual = drawn - real
        noise = _noise(residual, slopes, max(_SMALLEST_NOISE, _FIRST_NOISE / 2**iteration))
        weight = 1 / (1 + np.square(residual / (_ROBUST * noise))) ** 2 / noise**2 / _SQUARE_PX**2
        information = np.einsum("vmp,mp,ump->mvu", slopes, weight, slopes, optimize=True)
        slope = np.einsum("vmp,mp,mp->mv", slopes, weight, residual, optimize=True)
        cost = np.minimum(np.square(residual / noise), 9).mean(1)
        combined = combine(
            information.astype(float), slope.astype(float), variance, robust_weights(cost)
        )
        covariance, variance = combined.covariance, combined.variance
        unit[fitted] = np.clip(unit[fitted] + combined.step(unit[fitted], _LARGEST_STEP), 0, 1)
        drawn, slopes = _draw(simulator, full_states, unit, fitted)
    residual = drawn - real
    noise = _noise(residual, slopes, _SMALLEST_NOISE)
    rounding = _ROUNDING / np.maximum(np.abs(slopes).max((1, 2), initial=0), _SHOWN)
    # Pixels of one colour are all rounded alike: of that, many pictures tell no more than one.
    covariance += np.diag(rounding**2)
    return PictureFit(unit[fitted], covariance, float(np.median(noise)))


def _noise(residual: np.ndarray, slopes: np.ndarray, at_least: float) -> np.ndarray:
    """(M, pixels) robust standard deviation of (M, pixels), where (V, M, pixels) show a parameter.

    Of each parameter by itself: that the ground fits tells nothing of a thin pole.
    """
    noise, shown = np.full_like(residual, at_least), np.abs(slopes) > _SHOWN
    for where in shown[shown.any((1, 2))]:
        own = 1.48 * float(np.median(np.abs(residual[where])))
        noise = np.where(where, np.maximum(noise, own), noise)
    return noise


def align_to_images(
    simulator: Simulator,
    frames: np.ndarray,
    full_states: np.ndarray,
    parameters: np.ndarray,
    space: StateSpace,
    tangent: np.ndarray,
) -> np.ndarray:
    """(M, S) states, each moved along a (2 nv,) tangent to where it looks most like its frame."""
    shifts = np.linspace(-1, 1, _PLACES)[:, None, None] * tangent
    states = space.positions_and_velocities(full_states)
    moved = space.move(states, shifts + np.zeros((_PLACES, len(full_states), 1)))
    candidates = space.with_positions_and_velocities(full_states, moved)
    worlds = np.repeat(parameters[None], _PLACES * len(full_states), 0)
    drawn = simulator.render(candidates.reshape(-1, full_states.shape[-1]), worlds)
    drawn = drawn.reshape(_PLACES, len(full_states), -1)
    real = frames.reshape(len(frames), -1).astype(np.float32)
    # What looks alike may be of another brightness so far: compare the patterns.
    alike = [[np.corrcoef(d, r)[0, 1] for d, r in zip(place, real, strict=True)] for place in drawn]
    return candidates[np.argmax(alike, 0), np.arange(len(full_states))]


def _draw(simulator: Simulator, full_states: np.ndarray, unit: np.ndarray, fitted: np.ndarray):
    """(M, pixels) as drawn now, and (V, M, pixels) by how much each parameter changes them."""
    units = np.repeat(unit[None], 1 + len(fitted), 0)
    change = np.where(unit[fitted] > 0.5, -_DELTA, _DELTA)
    units[1 + np.arange(len(fitted)), fitted] += change
    parameters = np.repeat(simulator.space.from_unit(units), len(full_states), 0)
    drawn = simulator.render(np.tile(full_states, (len(units), 1)), parameters)
    drawn = drawn.reshape(len(units), len(full_states), -1).astype(np.float32) / 255
    return drawn[0], (drawn[1:] - drawn[0]) / change[:, None, None]
