"""The camera before which the drawn robot's edges lie on the filmed ones."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from simtune.camera_pose.edges import edges, unlike, weight
from simtune.camera_pose.robot import Robot

# Pixels by which edges are blurred: a far start sees where to go, a near one what is exact.
FAR = (4.0, 4.0, 3.0)
NEAR = (3.0, 3.0, 3.0, 2.0, 2.0, 2.0)
FINE = (1.5, 1.5, 1.5, 1.0, 1.0, 1.0, 1.0)
TRIED = (1.0, 3.0, 0.4)  # times a step: where little is alike, a step is too short
# Of the range, of which each pixel of the height is taken for an equal part:
_MOVED = 0.5  # pixels by which to derive, times the blur
_LARGEST_STEP_PX = 6.0
_FARTHEST = 5.0  # times that, by which to derive where little changes
_SHOWN = 0.3  # that an edge has to change over the range, to count
_OWN = 0.1  # by which an edge has to differ from what is there without the robot, to be its own
_SLACK = 1e-3  # of the mean information
_SQUARE_PX = 4  # neighbouring pixels tell the same: 4 × 4 of them, or of blurs, count as one


@dataclass(frozen=True)
class Camera:
    """In unit coordinates of the P parameters of the camera."""

    unit: np.ndarray  # (P,)
    covariance: np.ndarray  # (P, P)
    cost: float  # lower is better, among fits of the same frames; 0 of a robot that nobody sees


class _Drawn(NamedTuple):
    unit: np.ndarray
    edges: np.ndarray  # (M, H, W, 2)
    cost: float


class Alignment:
    """Frames of known states; Gauss and Newton's steps on their edges, each less blurred."""

    def __init__(
        self, robot: Robot, frames: np.ndarray, states: np.ndarray, blurs: tuple[float, ...]
    ):
        """(M, H, W, 3) frames of (M, S) states."""
        self._robot, self._frames, self._states, self._blurs = robot, frames, states, blurs
        self._px = 1 / frames.shape[1]

    def fit(self, start: np.ndarray) -> Camera:
        """From a camera (P,) in unit coordinates.

        With edges drawn d(u) and real y, weights W and A = ∂d/∂u:

            u ← u − λ (AᵀWA)⁻¹ AᵀW (d(u) − y),   λ the best of a few

        Pictures are rough: derivatives are taken along the eigenvectors of the last AᵀWA, farther
        where less changes, or what is rough in them would hide where a camera can hardly be told.
        """
        num, blur, real = len(start), 0.0, np.zeros(0)
        ways, covariance = np.eye(num), np.eye(num)  # ways are rows
        now = _Drawn(start, np.zeros(0), np.inf)
        for its in self._blurs:
            if its != blur:
                blur, real = its, edges(self._frames, its)
                now = self._draw(now.unit, real, blur)
            slopes = self._slopes(now, ways * (_MOVED * blur * self._px), blur)
            information, slope, noise = _equations(slopes, now.edges - real)
            if not information.any():
                return Camera(now.unit, np.eye(num), 0.0)  # nothing of it is seen
            slack = _SLACK * np.trace(information) / num * np.eye(num)
            step = -np.linalg.solve(information + slack, slope)
            step *= min(1.0, _LARGEST_STEP_PX * self._px / np.abs(step).max())
            there = [np.clip(now.unit + times * step, 0, 1) for times in TRIED]
            now = min([now, *(self._draw(u, real, blur) for u in there)], key=lambda at: at.cost)
            counted = noise**2 * (_SQUARE_PX * max(1.0, blur)) ** 2
            covariance = counted * np.linalg.inv(information + slack)
            ways = _ways(information)
        return Camera(now.unit, covariance, self._found(now, real, blur))

    def _draw(self, unit: np.ndarray, real: np.ndarray, blur: float) -> _Drawn:
        drawn = edges(self._robot.draw(unit, self._states), blur)
        return _Drawn(unit, drawn, float(np.mean(unlike(drawn - real))))

    def _found(self, now: _Drawn, real: np.ndarray, blur: float) -> float:
        """By how much the robot's own edges are more alike than if the film had none.

        A robot that hides costs nothing elsewhere: what stands still of it is in the background.
        """
        without = edges(self._robot.draw_without(now.unit, self._states), blur)
        own = (np.abs(now.edges - without) > _OWN).any(-1, keepdims=True)
        return float(np.mean(own * (unlike(now.edges - real) - unlike(now.edges))))

    def _slopes(self, now: _Drawn, ways: np.ndarray, blur: float) -> np.ndarray:
        """(P, M, H, W, 2), by changes (P, P) of the camera, one a row."""
        moved = (self._robot.draw(now.unit + way, self._states) for way in ways)
        changes = np.stack([edges(drawn, blur) - now.edges for drawn in moved])
        return np.tensordot(np.linalg.inv(ways), changes, 1)


def _ways(information: np.ndarray) -> np.ndarray:
    """(P, P) eigenvectors, longer where less is told."""
    values, vectors = np.linalg.eigh(information)
    lengths = np.sqrt(values.max() / np.maximum(values, 1e-9 * values.max()))
    return (vectors * np.minimum(lengths, _FARTHEST)).T


def _equations(slopes: np.ndarray, residuals: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """(P, P) information, (P,) slope and the residuals' typical size, of (P, …) slopes."""
    slopes, r = slopes.reshape(len(slopes), -1), residuals.ravel()
    shown = np.abs(slopes).max(0) > _SHOWN
    if not shown.any():
        return np.zeros((len(slopes), len(slopes))), np.zeros(len(slopes)), 1.0
    weighted = slopes * (shown * weight(r))
    return weighted @ slopes.T, weighted @ r, 1.48 * float(np.median(np.abs(r[shown])))
