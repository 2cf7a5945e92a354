"""The search for a camera: where things move, then pixel by pixel; known cameras found again."""

from typing import NamedTuple

import numpy as np

from simtune.budget import Budget
from simtune.camera_pose.align import COARSE, FINE, Alignment, Camera
from simtune.camera_pose.robot import Robot
from simtune.camera_pose.scene import camera_parameters, surfaces
from simtune.camera_pose.silhouettes import likely_cameras

_STARTS = 4  # that are looked at pixel by pixel
_KNOWN, _FEWEST_KNOWN = 8, 4  # cameras that are found again, to see how wrong that goes
_FEWEST_PICTURES, _MOST_PICTURES = 5, 16  # that are compared
_COMPARING = 0.6  # of the time
_NEAR = 0.04  # of the range: how far off known cameras are begun
_MOST = 0.5  # of the time, for the fits


class Film(NamedTuple):
    """The same frames in some size."""

    robot: Robot
    frames: np.ndarray  # (F, H, W, 3)


class CameraSearch:
    """In unit coordinates of the P parameters of a camera."""

    def __init__(self, coarse: Film, fine: Film, states: np.ndarray, seed: int):
        """Films of recordings, in which the robot was in (F, S) `states`."""
        self._coarse, self._fine, self._states = coarse, fine, states
        self._space, self._rng = coarse.robot.space, np.random.default_rng((seed, 1))
        self._camera = camera_parameters(self._space)

    def run(self, budget: Budget) -> tuple[Camera, np.ndarray]:
        """The camera, and (K, P) errors with which known ones near it are found."""
        self._choose(budget.seconds)
        budget.report("looking where things move")
        frames, num = self._coarse.frames, len(self._camera)
        likely = likely_cameras(self._project, frames, num, self._rng)
        near = self._alignment(self._coarse.robot, self._seen[0], COARSE)
        fits: list[tuple[Camera, np.ndarray]] = []
        while len(fits) < _STARTS and not (fits and budget.spent > _MOST):
            budget.report("laying the robot on the film", 0.2 + 0.3 * len(fits) / _STARTS)
            start = likely[0] if not fits else likely[self._rng.integers(len(likely))]
            fits.append(near.fit(start))
        best, colours = min(fits, key=lambda fit: fit[0].cost)
        exact = self._alignment(self._fine.robot, self._seen[1], FINE)
        found, everything = exact.fit(best.unit, colours)
        return found, self._errors(everything, budget)

    def _choose(self, seconds: float) -> None:
        """As many pictures as can be compared in the time."""
        num_slopes = 1 + len(self._camera) + len(surfaces(self._space))
        coarse_s, fine_s = (film.robot.seconds_a_picture for film in (self._coarse, self._fine))
        coarse_s, fine_s = coarse_s * len(COARSE) * num_slopes, fine_s * len(FINE) * num_slopes
        each_s = _STARTS * coarse_s + fine_s + _FEWEST_KNOWN * (coarse_s + fine_s)
        num = int(np.clip(_COMPARING * seconds / each_s, _FEWEST_PICTURES, _MOST_PICTURES))
        few = np.linspace(0, len(self._states) - 1, min(len(self._states), num)).astype(int)
        self._few = self._states[few]
        self._seen = [film.frames[few] for film in (self._coarse, self._fine)]

    def _alignment(self, robot: Robot, frames: np.ndarray, blurs: tuple[float, ...]) -> Alignment:
        return Alignment(robot.simulator, frames, self._few, blurs)

    def _errors(self, everything: np.ndarray, budget: Budget) -> np.ndarray:
        """Of known cameras and colours near those that were found, filmed as recordings are."""
        errors, rng, num = [], self._rng, len(self._camera)
        while len(errors) < _KNOWN and (len(errors) < _FEWEST_KNOWN or not budget.is_over):
            share = 0.5 + 0.5 * len(errors) / _KNOWN
            budget.report("finding known cameras for comparison", share)
            truth = everything.copy()
            truth[self._camera] += _NEAR * rng.uniform(-1, 1, num)
            truth = truth.clip(0.02, 0.98)
            start = truth[self._camera] + _NEAR * rng.uniform(-1, 1, num)
            small, large = (f.robot.film(truth, self._few) for f in (self._coarse, self._fine))
            coarse, colours = self._alignment(self._coarse.robot, small, COARSE).fit(
                start, everything
            )
            fine, _ = self._alignment(self._fine.robot, large, FINE).fit(coarse.unit, colours)
            errors.append(fine.unit - truth[self._camera])
        return np.array(errors)

    def _project(self, units: np.ndarray, frames: np.ndarray) -> np.ndarray:
        """(n, P) cameras to (n, K, L, 2) pixels of points of the robot in some frames."""
        every = np.tile(self._space.to_unit(self._space.nominal), (len(units), 1))
        every[:, self._camera] = units
        return self._coarse.robot.project(every, self._states[frames])
