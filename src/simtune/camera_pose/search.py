"""The search for a camera: where things move, then edge by edge; known cameras found again."""

import time
from typing import NamedTuple

import numpy as np

from simtune.budget import Budget
from simtune.camera_pose.align import FAR, FINE, NEAR, TRIED, Alignment, Camera
from simtune.camera_pose.robot import Robot
from simtune.camera_pose.silhouettes import likely_cameras

_STARTS = 6  # that are looked at edge by edge: the guess, the likeliest, others
_KEPT = 2  # of them, that are looked at longer
_KNOWN, _PLANNED_KNOWN = 8, 2  # cameras that are found again, to see how wrong that goes
_HALVES = 1  # fits' time, for the two halves of the pictures by themselves
_FEWEST_PICTURES, _MOST_PICTURES = 4, 24  # that are compared; half of them by themselves
_COMPARING = 0.75  # of the time left after the first guesses
_NEAR = 0.04  # of the range: how far off known cameras are begun


class Film(NamedTuple):
    """The same frames in some size."""

    robot: Robot
    frames: np.ndarray  # (F, H, W, 3)


class Found(NamedTuple):
    """A camera in unit coordinates of its P parameters, and what says how wrong it may be."""

    camera: Camera
    halves: np.ndarray  # (2, P) by the first half of the pictures, by the last
    errors: np.ndarray  # (K, P) with which known cameras near it are found


class CameraSearch:
    """In unit coordinates of the P parameters of a camera."""

    def __init__(self, small: Film, films: tuple[Film, Film], states: np.ndarray, seed: int):
        """Films of recordings, in which the robot was in (F, S) `states`; drawn roughly, and as
        well as it can be.
        """
        self._small, self._films, self._states = small, films, states
        self._rng = np.random.default_rng((seed, 1))

    def run(self, budget: Budget) -> Found:
        """The camera, with at least one known one found again."""
        budget.report("looking where things move")
        num = len(self._small.robot.space)
        likely = likely_cameras(self._project, self._small.frames, num, self._rng)
        at = self._choose(num, budget.seconds_left)
        begun = [np.full(num, 0.5), likely[0]]
        begun += list(self._rng.permutation(likely[1:])[: _STARTS - len(begun)])
        fits: list[Camera] = []
        for start in begun:
            budget.report("laying the robot on the film", 0.2 + 0.2 * len(fits) / _STARTS)
            fits.append(self._alignment(0, at, FAR).fit(start))
            if budget.spent > _COMPARING and fits[-1].cost < 0:
                break
        near = self._alignment(0, at, NEAR)
        fits = [near.fit(fit.unit) for fit in sorted(fits, key=_cost)[:_KEPT]]
        budget.report("laying the robot on the film", 0.4)
        camera = self._alignment(1, at, FINE).fit(min(fits, key=_cost).unit)
        half = len(at) // 2
        halves = [
            self._alignment(1, some, FINE).fit(camera.unit).unit for some in (at[:half], at[half:])
        ]
        return Found(camera, np.array(halves), self._errors(camera, at, budget))

    def _choose(self, num_parameters: int, seconds: float) -> np.ndarray:
        """(M,) frames, as many as can be compared in the time."""
        pictures = num_parameters + len(TRIED) + 1
        rough_s, good_s = (film.robot.seconds_a_picture * pictures for film in self._films)
        far_s, near_s, fine_s = len(FAR) * rough_s, len(NEAR) * rough_s, len(FINE) * good_s
        known_s = _PLANNED_KNOWN * (near_s + fine_s)
        each_s = _STARTS * far_s + _KEPT * near_s + (1 + _HALVES) * fine_s + known_s
        num = int(np.clip(_COMPARING * seconds / each_s, _FEWEST_PICTURES, _MOST_PICTURES))
        return np.linspace(0, len(self._states) - 1, min(len(self._states), num)).astype(int)

    def _alignment(self, which: int, at: np.ndarray, blurs: tuple[float, ...]) -> Alignment:
        film = self._films[which]
        return Alignment(film.robot, film.frames[at], self._states[at], blurs)

    def _errors(self, camera: Camera, at: np.ndarray, budget: Budget) -> np.ndarray:
        """Of known cameras near the one that was found, filmed as recordings are."""
        errors, rng, num, longest_s = [], self._rng, len(camera.unit), 0.0
        states, (rough, good) = self._states[at], (film.robot for film in self._films)
        while len(errors) < _KNOWN and (not errors or budget.seconds_left > longest_s):
            budget.report("finding known cameras for comparison", 0.6 + 0.4 * len(errors) / _KNOWN)
            began_s = time.monotonic()
            truth = (camera.unit + _NEAR * rng.uniform(-1, 1, num)).clip(0.02, 0.98)
            start = truth + _NEAR * rng.uniform(-1, 1, num)
            frames = good.film(truth, states)
            near = Alignment(rough, frames, states, NEAR).fit(start)
            errors.append(Alignment(good, frames, states, FINE).fit(near.unit).unit - truth)
            longest_s = max(longest_s, time.monotonic() - began_s)
        return np.array(errors)

    def _project(self, units: np.ndarray, frames: np.ndarray) -> np.ndarray:
        """(n, P) cameras to (n, K, L, 2) pixels of points of the robot in some frames."""
        return self._small.robot.project(units, self._states[frames])


def _cost(camera: Camera) -> float:
    return camera.cost
