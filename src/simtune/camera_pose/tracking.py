"""Aligns the robot's outlines with the film's edges: model-based edge tracking.

(Harris 1992; Drummond and Cipolla 2002): the robot is drawn, and each point of its outlines looks
along its normal for edges of the film.
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_edt

from simtune.camera_pose.bending import BentGeometry, BentRobot
from simtune.camera_pose.edges import EdgeFilm
from simtune.camera_pose.geometry import CameraGeometry
from simtune.camera_pose.robot import Outlines, Robot
from simtune.fit.combine import newton_within

# Expected offset of outlines in pixels, for each iteration; the robot is drawn in each.
NEAR = (5.0, 5.0, 5.0, 3.0, 3.0, 3.0)
MIDDLE = (8.0, 8.0, 8.0, *NEAR)
FAR = (16.0, 16.0, 16.0, *MIDDLE)
FINE = (2.0, 2.0, 1.5, 1.5, 1.0, 1.0, 1.0, 1.0)
_OVERSHOOT_SHARE = 0.3  # of the range, by which a fit may leave it on its way
_SEARCH_REACH_FACTOR = 2.5  # on the expected offset, within which edges are searched
_FAINT_CONTRAST = 0.02  # of the full scale per pixel: such an edge has half the weight
_NO_EDGE_WEIGHT = 0.15
_SEARCHES_PER_DRAWING = 3  # for edges, with the robot drawn once
_MAX_MOTION_FACTOR = 1.5  # on the expected offset, for a step
_DELTA = 1e-5  # of a unit coordinate: to 1e-8 of a derivative
_RIDGE = 1e-5  # of the mean information
_MAX_POINTS, _MAX_ROUGH_POINTS = 8000, 2000
_FEWEST_POINTS = 50
_MAX_OFF_EDGE_PX, _MAX_OFF_OUTLINE_PX = 2.0, 3.0  # between an edge and an outline


class CameraFit(NamedTuple):
    """A camera of P parameters, and N points of outlines before it."""

    unit: np.ndarray  # (P,)
    frames: np.ndarray  # (N,) each point's frame
    weights: np.ndarray  # (N,) 0 to 1: certainty of its edge
    off_px: np.ndarray  # (N,) distance to its edge along the normal, into the robot
    slopes: np.ndarray  # (N, P) derivatives of the point along the normal


class Agreement(NamedTuple):
    """Shares, 0 to 1, of what agrees."""

    on_edges: float  # of outlines, on edges of their frame
    by_chance: float  # of outlines, on edges of another frame
    explained: float  # of the film's motion, on outlines

    @property
    def beyond_chance(self) -> float:
        return max(0.0, self.on_edges - self.by_chance)

    @property
    def score(self) -> float:
        """A robot out of sight explains nothing; a wrong one is on edges only by chance."""
        return self.beyond_chance * self.explained


class Tracker:
    """For frames of a film with the robot in known states."""

    def __init__(
        self,
        film: EdgeFilm,
        robot: Robot | BentRobot,
        geometry: CameraGeometry | BentGeometry,
        which: np.ndarray,
    ):
        """`which`: (M,) states of the robot, for the film's M frames."""
        self._film, self._robot, self._geometry, self._which = film, robot, geometry, which

    def before(self, robot: BentRobot, geometry: BentGeometry) -> "Tracker":
        """The same film, for a robot before another kind of camera."""
        return Tracker(self._film, robot, geometry, self._which)

    def fit(self, start: np.ndarray, off_px: tuple[float, ...]) -> CameraFit | None:
        """From a camera (P,), an iteration per `off_px`; None if the robot is out of sight."""
        unit, found = start, None
        for expected_px in off_px:
            is_rough = expected_px > FINE[0]
            beyond = _OVERSHOOT_SHARE if is_rough else 0.0
            unit = np.clip(unit, -beyond, 1 + beyond)
            most = _MAX_ROUGH_POINTS if is_rough else _MAX_POINTS
            outlines = self._robot.outlines(unit, self._which, most, is_rough)
            if len(outlines.frames) < _FEWEST_POINTS:
                return None
            for _ in range(_SEARCHES_PER_DRAWING):
                found = self._look(unit, outlines, expected_px)
                step = _step(found, _MAX_MOTION_FACTOR * expected_px, beyond)
                unit = np.clip(unit + step, -beyond, 1 + beyond)
        return found and found._replace(unit=unit)

    def agreement(self, unit: np.ndarray) -> Agreement:
        """How well a camera (P,) explains the film."""
        outlines = self._robot.outlines(unit, self._which, _MAX_POINTS)
        if len(outlines.frames) < _FEWEST_POINTS:
            return Agreement(0, 0, 0)
        num = self._film.num
        later = outlines._replace(frames=(outlines.frames + num // 2) % num)
        on_edges, by_chance = (self._on_edges(lines) for lines in (outlines, later))
        drawn = np.zeros((num, *self._film.size), bool)
        column, row = np.rint(outlines.pixels).astype(int).T
        drawn[outlines.frames, row, column] = True
        explained = [
            (np.asarray(distance_transform_edt(~outline))[edges] < _MAX_OFF_OUTLINE_PX).mean()
            for outline, edges in zip(drawn, self._film.moving(), strict=True)
            if outline.any() and edges.any()
        ]
        return Agreement(on_edges, by_chance, float(np.sum(explained)) / num)

    def _on_edges(self, outlines: Outlines) -> float:
        """Share of moving outlines that lie on edges."""
        places, clear = self._edges(outlines.pixels, outlines, _MAX_OFF_EDGE_PX)
        found, moves = (clear * (np.abs(places) < _MAX_OFF_EDGE_PX)).max(1), 1 - outlines.still
        return float((found * moves).sum() / max(moves.sum(), 1e-9))

    def _look(self, unit: np.ndarray, outlines: Outlines, off_px: float) -> CameraFit:
        pixels = self._geometry.project(unit, outlines.points)
        places, clear = self._edges(pixels, outlines, _SEARCH_REACH_FACTOR * off_px)
        likely = clear * np.exp(-0.5 * (places / off_px) ** 2)
        total = likely.sum(1)
        mean = (likely * places).sum(1) / np.maximum(total, 1e-9)
        moved = _derivatives(self._geometry, unit, outlines.points)
        slopes = np.einsum("nip,ni->np", moved, outlines.normals)
        return CameraFit(unit, outlines.frames, total / (total + _NO_EDGE_WEIGHT), mean, slopes)

    def _edges(
        self, pixels: np.ndarray, outlines: Outlines, reach_px: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """(N, S) places along normals, px, and the clarity of an edge there, 0 to 1.

        Edges are local maxima of the slope, interpolated within a step.
        """
        step_px = min(1.0, max(0.5, reach_px / 8))
        num = int(np.ceil(reach_px / step_px)) + 1
        steps = step_px * np.arange(-num, num + 1)
        strength, direction_match = self._film.across(outlines, pixels, steps)
        before, here, after = strength[:, :-2], strength[:, 1:-1], strength[:, 2:]
        is_peak = (here >= before) & (here > after)
        bend = np.maximum(2 * here - before - after, 1e-9)
        beside = np.where(is_peak, np.clip((after - before) / (2 * bend), -0.5, 0.5), 0)
        clear = is_peak * here**2 / (here**2 + _FAINT_CONTRAST**2) * direction_match[:, 1:-1] ** 2
        return steps[1:-1] + step_px * beside, clear


def _derivatives(
    geometry: CameraGeometry | BentGeometry, unit: np.ndarray, points: np.ndarray
) -> np.ndarray:
    """(n, 2, P) derivatives of the pixels of (n, 3) points by (P,) unit coordinates."""
    changes = [
        geometry.project(unit + step, points) - geometry.project(unit - step, points)
        for step in _DELTA * np.eye(len(unit))
    ]
    return np.stack(changes, -1) / (2 * _DELTA)


def _step(found: CameraFit, farthest_px: float, beyond: float) -> np.ndarray:
    """(P,) Gauss-Newton step, shortened so that hardly any point moves by more."""
    weighted = found.slopes.T * found.weights
    information, pull = weighted @ found.slopes, weighted @ found.off_px
    num = len(pull)
    information += (_RIDGE * np.trace(information) / num + 1e-9) * np.eye(num)
    step = newton_within(information, -pull, found.unit, (-beyond, 1 + beyond))
    moved_px = np.percentile(np.abs(found.slopes @ step), 95)
    return step * min(1.0, farthest_px / max(float(moved_px), 1e-9))
