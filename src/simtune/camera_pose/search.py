"""The search for a camera: silhouettes, then edges, from several starts; a lens at the end."""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from simtune.budget import Budget, timed
from simtune.camera_pose.edges import EdgeFilm
from simtune.camera_pose.found import FoundCamera
from simtune.camera_pose.geometry import CameraGeometry
from simtune.camera_pose.lens_check import with_lens
from simtune.camera_pose.robot import Robot
from simtune.camera_pose.silhouettes import likely_camera, moving_masks
from simtune.camera_pose.tracking import FAR, FINE, MIDDLE, NEAR, Agreement, CameraFit, Tracker
from simtune.cameras.lens import Lens
from simtune.cameras.pictures import resize
from simtune.errors import InputError
from simtune.random_streams import Purpose, stream

_NUM_STARTS, _MIN_STARTS = 3, 2  # the given camera, and by silhouettes; the latter if time is short
_STARTS_TIME_SHARE = 0.5  # within which more starts are tried if no end is sure
_SURE_BEYOND_CHANCE = 0.4  # share of outlines on edges in excess of chance
_SIDESTEP_STD = 0.05  # of the range
_REFINED_ENDS = 2
_NUM_FINE_FITS = _REFINED_ENDS + 1  # the last with a lens
_RIVAL_SCORE_RATIO = 0.8  # to the best score: such an end may be right, too
_SILHOUETTE_FRAMES, _SILHOUETTE_HEIGHT_PX = 12, 64
_ROUGH_PICTURES, _FEWEST_PICTURES, _MOST_PICTURES = 16, 8, 48
_TIMED_PICTURES = 4
_FINE_TIME_SHARE = 0.7  # of the time left


class End(NamedTuple):
    """Of a fit from one start."""

    agreement: Agreement
    fit: CameraFit

    @property
    def score(self) -> float:
        return self.agreement.score


class CameraSearch:
    """In unit coordinates of the P parameters of a camera."""

    def __init__(
        self,
        frames: np.ndarray,
        plate: np.ndarray | None,
        robot: Robot,
        geometry: CameraGeometry,
        seed: int,
        lens: Lens | None = None,
    ):
        """(F, H, W, 3) frames in which the robot was in its F states; `plate`: see `EdgeFilm`;
        `lens`: of which the frames are rid.
        """
        self._frames, self._plate, self._robot, self._geometry = frames, plate, robot, geometry
        self._rng, self._lens = stream(seed, Purpose.CAMERA_POSE), lens

    def run(self, budget: Budget) -> FoundCamera:
        """The camera with which the robot explains the film best.

        Raises InputError if the robot is never in sight.
        """
        kept, fine = self._ends(budget), []
        if not kept:
            raise InputError(
                "from nowhere within the range does the robot show where the film moves: give a "
                "nearer guess, or a wider range (--within-m, --within-deg)"
            )
        tracker = self._tracker(self._choose(kept[-1].fit.unit, budget.seconds_left))
        for number, end in enumerate(kept):
            budget.report("laying the robot on the film", 0.7 + 0.3 * number / _REFINED_ENDS)
            fine += _ended(tracker, end.fit.unit, FINE)
        fine = fine or kept
        return with_lens(best_end(fine), tracker, self._robot, self._geometry, self._lens)

    def _ends(self, budget: Budget) -> list[End]:
        """The best ends of rough fits, the best last."""
        budget.report("looking where things move")
        ends: list[End] = []
        tries = self._tries(ends, self._silhouettes())
        rough = self._tracker(self._spread(_ROUGH_PICTURES))
        for number in itertools.count():
            is_over = number >= _MIN_STARTS and budget.spent > _STARTS_TIME_SHARE
            if is_over or (number >= _NUM_STARTS and _is_sure(ends)):
                break
            budget.report("laying the robot on the film", min(0.6, 0.1 + 0.1 * number))
            start, schedules = next(tries)
            for off_px in schedules:
                ends += _ended(rough, start, off_px)
                if _is_sure(ends[-1:]) or (number and budget.spent > _STARTS_TIME_SHARE):
                    break
        return sorted(ends, key=lambda end: end.score)[-_REFINED_ENDS:]

    def _tries(
        self, ends: list[End], guess: Callable[[], np.ndarray]
    ) -> Iterator[tuple[np.ndarray, tuple[tuple[float, ...], ...]]]:
        """Starts, and schedules of how far to look from there, the shortest first.

        Starts are the given camera, some by silhouettes, and some beside the best of `ends`.
        """
        given = np.full(len(self._geometry.space), 0.5)
        yield given, (NEAR, MIDDLE)
        yield guess(), (NEAR, MIDDLE, FAR)
        yield guess(), (NEAR, MIDDLE, FAR)
        yield given, (FAR,)
        while True:
            best = max(ends, key=lambda end: end.score).fit.unit if ends else given
            yield best + _SIDESTEP_STD * self._rng.normal(size=len(best)), (NEAR, MIDDLE)
            yield guess(), (NEAR, MIDDLE, FAR)

    def _silhouettes(self) -> Callable[[], np.ndarray]:
        """A function that gives likely cameras (P,), another one each time."""
        height, width = self._geometry.size
        small = (_SILHOUETTE_HEIGHT_PX, max(1, round(width * _SILHOUETTE_HEIGHT_PX / height)))
        geometry = replace(self._geometry, size=small)
        frames = np.stack([resize(frame, small) for frame in self._frames])
        at = self._spread(_SILHOUETTE_FRAMES)
        masks, points = moving_masks(frames)[at], self._robot.surface_points(at, self._rng)

        def project(units: np.ndarray) -> np.ndarray:
            return np.stack([geometry.project(unit, points) for unit in units])

        return lambda: likely_camera(project, masks, len(geometry.space), self._rng)

    def _choose(self, near: np.ndarray, seconds: float) -> np.ndarray:
        """(M,) frames, evenly spread, as many as can be compared in the time."""
        few = self._tracker(self._spread(_TIMED_PICTURES))
        few.fit(near, FINE[-1:])  # the first call is slower
        fit_s, _ = timed(lambda: few.fit(near, FINE[-1:]))
        each_s = fit_s / _TIMED_PICTURES * len(FINE) * _NUM_FINE_FITS
        most = int(np.clip(_FINE_TIME_SHARE * seconds / each_s, _FEWEST_PICTURES, _MOST_PICTURES))
        return self._spread(most)

    def _spread(self, num: int) -> np.ndarray:
        count = len(self._frames)
        return np.linspace(0, count - 1, min(count, num)).astype(int)

    def _tracker(self, at: np.ndarray) -> Tracker:
        film = EdgeFilm(self._frames[at], self._plate)
        return Tracker(film, self._robot, self._geometry, at)


def best_end(ends: list[End]) -> FoundCamera:
    """The best, with all that are about as good."""
    best = max(ends, key=lambda end: end.score)
    as_good = [end.fit.unit for end in ends if end.score > _RIVAL_SCORE_RATIO * best.score]
    as_good = np.array(as_good or [best.fit.unit])  # none if all have no score
    return FoundCamera(best.fit, best.agreement, as_good)


def _is_sure(ends: list[End]) -> bool:
    return any(end.agreement.beyond_chance > _SURE_BEYOND_CHANCE for end in ends)


def _ended(tracker: Tracker, start: np.ndarray, off_px: tuple[float, ...]) -> list[End]:
    """One, or none if the robot is out of sight."""
    fit = tracker.fit(start, off_px)
    return [End(tracker.agreement(fit.unit), fit)] if fit else []
