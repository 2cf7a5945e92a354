"""Colours and light fitted to the pixels themselves, once it is known where everything is.

The detector's estimates are good to a few hundredths. Drawing the fitted states and comparing
pixels is good to a few thousandths, where the simulator draws as the real world looks. A state that
is a fifth of a pixel off shades what is round otherwise, by a hundredth or so in all colours alike;
so each picture's pose is unknown as well, as far as the motion leaves it open.
"""

from dataclasses import dataclass

import numpy as np

from simtune.fit.combine import FIRST_VARIANCE, combine, robust_weights
from simtune.simulation import Simulator

_DELTA = 0.03  # of a parameter, to derive by: several of a pixel's 256 levels
_ROBUST = 3.0  # noise levels from which a pixel counts less: edges, what is not modelled
_SMALLEST_NOISE = 1.0 / 255
_FIRST_NOISE = 0.1  # at least, then half as much each time: a colour far off is no outlier yet
_LARGEST_STEP = 0.2
_LARGEST_MOVE = 4.0  # standard deviations, of a pose
_ROUNDING = 1 / 255 / 12**0.5  # standard deviation
_WHITE = 254.5 / 255
_SHOWN = 0.05  # of the full scale, that a pixel changes over a parameter's whole range
_SQUARE_PX = 4  # neighbouring pixels tell the same: 4 × 4 of them count as one
_DERIVED_EVERY = 2  # iterations: derivatives cost most, and change slowly


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
    poses: np.ndarray | None = None,
    iterations: int = 12,
) -> PictureFit:
    """Fit parameters `fitted` (indices) to (M, H, W, 3) frames of (M, S) states.

    `parameters`: (N,) to start from; the others keep their values. `poses`: (M, D, 2 nv) changes
    of each picture's state, of one standard deviation, that may be wrong with it.

    With residuals r of the pixels, weights W, A = ∂r/∂u by the parameters and P = ∂r/∂x by the
    poses in their standard deviations, each picture says of u, with x eliminated,

        information = AᵀWA − AᵀWP (PᵀWP + 1)⁻¹ PᵀWA     slope = AᵀWr − AᵀWP (PᵀWP + 1)⁻¹ (PᵀWr + x)
    """
    scene = _Scene(simulator, full_states, fitted, poses)
    slopes = of_pose = np.zeros((0, len(frames), 0))
    unit, variance = simulator.space.to_unit(parameters), FIRST_VARIANCE
    covariance = np.zeros((len(fitted),) * 2)
    real = frames.astype(np.float32).reshape(len(frames), -1) / 255
    for iteration in range(iterations):
        drawn = scene.draw(unit)
        if iteration % _DERIVED_EVERY == 0:
            slopes, of_pose = scene.derive(unit, drawn)
        residual = drawn - real
        noise = _noise(residual, slopes, max(_SMALLEST_NOISE, _FIRST_NOISE / 2**iteration))
        weight = 1 / (1 + np.square(residual / (_ROBUST * noise))) ** 2 / noise**2 / _SQUARE_PX**2
        weight[_is_overexposed(drawn, real, noise)] = 0
        information, slope = _products(slopes, weight, slopes), _project(slopes, weight, residual)
        cross = _products(of_pose, weight, slopes)  # (M, D, V)
        of_poses = _products(of_pose, weight, of_pose) + np.eye(of_pose.shape[0])
        pull = _project(of_pose, weight, residual) + scene.moved  # (M, D)
        follow = np.linalg.solve(of_poses, np.concatenate([cross, pull[..., None]], -1))
        information -= cross.swapaxes(1, 2) @ follow[..., :-1]
        slope -= (cross.swapaxes(1, 2) @ follow[..., -1:])[..., 0]
        cost = np.minimum(np.square(residual / noise), 9).mean(1)
        combined = combine(information, slope, variance, robust_weights(cost))
        covariance, variance = combined.covariance, combined.variance
        before = unit[fitted].copy()
        unit[fitted] = np.clip(before + combined.step(before, _LARGEST_STEP), 0, 1)
        scene.move(-follow[..., -1] - follow[..., :-1] @ (unit[fitted] - before))
    drawn = scene.draw(unit)
    noise = _noise(drawn - real, slopes, _SMALLEST_NOISE)
    covariance += np.diag(np.square([rounding_std(its, drawn) for its in slopes]))
    return PictureFit(unit[fitted], covariance, float(np.median(noise)))


class _Scene:
    """M pictures that are drawn with other parameters, and from slightly other states."""

    def __init__(self, simulator: Simulator, full_states, fitted, poses: np.ndarray | None):
        self._simulator, self._full_states, self._fitted = simulator, full_states, fitted
        self._space = simulator.state_space
        shape = (len(full_states), 0, self._space.num_tangent)
        self._poses = np.zeros(shape) if poses is None else poses
        self.moved = np.zeros(self._poses.shape[:2])  # (M, D) standard deviations

    def move(self, change: np.ndarray) -> None:
        self.moved = np.clip(self.moved + change, -_LARGEST_MOVE, _LARGEST_MOVE)

    def draw(self, unit: np.ndarray) -> np.ndarray:
        """(M, pixels) as they are with (N,) parameters."""
        return self._render(self._states(self.moved), unit)

    def derive(self, unit: np.ndarray, drawn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(V, M, pixels) and (D, M, pixels): by how much each changes what was `drawn`.

        Of a parameter by its unit coordinate, of a pose by its standard deviation.
        """
        num_poses, states = self.moved.shape[1], self._states(self.moved)
        slopes = np.empty((len(self._fitted), *drawn.shape), np.float32)
        for i, fitted in enumerate(self._fitted):
            # Darker, where there is room: what is brighter than white looks all the same.
            units, delta = unit.copy(), _DELTA if unit[fitted] < _DELTA else -_DELTA
            units[fitted] += delta
            slopes[i] = (self._render(states, units) - drawn) / delta
        of_pose = np.empty((num_poses, *drawn.shape), np.float32)
        for i, one in enumerate(np.eye(num_poses)):
            of_pose[i] = self._render(self._states(self.moved + one), unit) - drawn
        return slopes, of_pose

    def _states(self, moved: np.ndarray) -> np.ndarray:
        """(M, S) states moved by (M, D) standard deviations."""
        if not moved.shape[1]:
            return self._full_states
        tangent = np.einsum("md,mdt->mt", moved, self._poses)
        states = self._space.positions_and_velocities(self._full_states)
        changed = self._space.move(states, tangent)
        return self._space.with_positions_and_velocities(self._full_states, changed)

    def _render(self, full_states: np.ndarray, unit: np.ndarray) -> np.ndarray:
        """(M, pixels) of the full scale."""
        parameters = np.repeat(self._simulator.space.from_unit(unit)[None], len(full_states), 0)
        drawn = self._simulator.render(full_states, parameters)
        return drawn.reshape(len(full_states), -1).astype(np.float32) / 255


def _products(a: np.ndarray, weight: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(M, A, B) for (A, M, pixels), (M, pixels), (B, M, pixels)."""
    weighted = (a * weight).swapaxes(0, 1)
    return (weighted @ b.transpose(1, 2, 0)).astype(float)


def _project(a: np.ndarray, weight: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """(M, A) for (A, M, pixels), (M, pixels), (M, pixels)."""
    return np.einsum("amp,mp->ma", a, weight * residual).astype(float)


def rounding_std(slope: np.ndarray, drawn: np.ndarray) -> float:
    """Standard deviation of a parameter that (M, pixels) show, for they have but 256 levels.

    Pixels of one level are all rounded alike: of that, many tell no more than one. Each other
    level is rounded at another place.
    """
    shown = np.abs(slope) > _SHOWN
    if not shown.any():
        return _ROUNDING / _SHOWN
    square, level = np.square(slope[shown]), np.round(255 * drawn[shown]).astype(int)
    told = np.bincount(level, square)
    num_levels = told.sum() ** 2 / np.square(told).sum()
    return _ROUNDING / np.sqrt(num_levels * square.mean())


def _is_overexposed(drawn: np.ndarray, real: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """(M, pixels) bool: as bright as can be in both. How much brighter it would be, nothing tells.

    So such a pixel holds no colour back that others say is brighter.
    """
    return (drawn >= _WHITE) & (real >= _WHITE - noise)


def _noise(residual: np.ndarray, slopes: np.ndarray, at_least: float) -> np.ndarray:
    """(M, pixels) robust standard deviation of (M, pixels), where (V, M, pixels) show a parameter.

    Of each parameter by itself: that the ground fits tells nothing of a thin pole.
    """
    noise, shown = np.full_like(residual, at_least), np.abs(slopes) > _SHOWN
    for where in shown[shown.any((1, 2))]:
        own = 1.48 * float(np.median(np.abs(residual[where])))
        noise = np.where(where, np.maximum(noise, own), noise)
    return noise
