"""Sensitivity of pictures, motion and readings to parameters, and Fisher information at best.

Nothing is learnt: the simulator is run with one parameter changed at a time.
"""

import math
from dataclasses import dataclass

import numpy as np

from simtune.budget import NO_LIMIT, Budget
from simtune.checking.sensitivity.pictures import STILL_PX, CameraChanges, camera_changes
from simtune.checking.sensitivity.reading_changes import ReadingChanges
from simtune.observation import ObservationModel
from simtune.parameters import ParameterSpace
from simtune.randomization import Distribution
from simtune.simulation import Simulator
from simtune.vision.image_noise import ImageNoise

_LOG_STEP_FACTOR, _LINEAR_STEP = 1.2, 0.1  # change of a parameter on a log scale, on a linear one


@dataclass(frozen=True)
class Sensitivity:
    """Of N parameters: what each one changes, and how well it could be known at best."""

    parameters: np.ndarray  # (N,) at which this holds
    changed: np.ndarray  # (N,) the changed value of each, one at a time
    pictures: CameraChanges  # nothing without a camera
    # Standard deviations, of the logarithm on a log scale, at most those of a uniform prior over
    # the first range of a search:
    motion_std: np.ndarray  # (N,)
    picture_std: np.ndarray  # (N,) from colours, as far as a camera shows them truly
    first_width: np.ndarray  # (N,) of that range
    correlation: np.ndarray  # (N, N) of errors in what motion tells; 0 with what it does not show
    sees_pictures: bool = True  # False without a camera
    readings: ReadingChanges | None = None  # of joints; they count as motion in `motion_std`
    # (N,) `motion_std` if a fit left as little of readings as it may at best; None: it is the same
    motion_std_at_best: np.ndarray | None = None

    @property
    def shows_nothing(self) -> np.ndarray:
        """(N,) bool."""
        unseen = (self.pictures.pixel_share == 0) & (self.pictures.largest_px <= STILL_PX)
        return unseen if self.readings is None else unseen & ~self.readings.changes


def analyze(
    simulator: Simulator,
    actions: np.ndarray,
    seed: int,
    observation: ObservationModel,
    readings: ReadingChanges | None = None,
    budget: Budget = NO_LIMIT,
) -> Sensitivity:
    """At the nominal parameters, in episodes of (E, T, A) actions; `readings`: those of joints.

    `budget`: for how well the best fit to motion could tell, see `CameraChanges`. Raises
    RuntimeError if all of them diverge.
    """
    space = simulator.space
    nominal = where_analyzed(space)
    first = Distribution.first(space, nominal)
    changed = one_by_one(space, nominal)
    scale = _along_scale(space, space.high) - _along_scale(space, space.low)
    width = scale * first.unit_width
    prior = width / np.sqrt(12)  # of a uniform distribution
    information, pictures = np.diag(prior**-2), CameraChanges.nothing(len(space))
    if simulator.views:
        pictures = camera_changes(simulator, first, actions, seed, nominal, changed, budget)
        information += pictures.information / np.outer(scale, scale)
    at_best = None
    if readings is not None:
        if readings.information_at_best is not None:
            at_best = information + readings.information_at_best / np.outer(scale, scale)
        information += readings.information / np.outer(scale, scale)
    covariance = np.linalg.inv(information)
    std = np.sqrt(np.diag(covariance))
    step = np.diag(_along_scale(space, changed) - _along_scale(space, nominal))
    by_picture = _std_by_colours(simulator, step, pictures, observation)
    return Sensitivity(
        parameters=nominal,
        changed=np.diag(changed),
        pictures=pictures,
        motion_std=std,
        picture_std=(by_picture**-2 + prior**-2) ** -0.5,
        first_width=width,
        correlation=covariance / np.outer(std, std),
        sees_pictures=bool(simulator.views),
        readings=readings,
        motion_std_at_best=None if at_best is None else np.sqrt(np.diag(np.linalg.inv(at_best))),
    )


def one_by_one(space: ParameterSpace, parameters: np.ndarray) -> np.ndarray:
    """(N, N) copies of the (N,) parameters, row i with parameter i changed, away from its bound.

    In a narrow range, at most to the farther bound.
    """
    scale = _along_scale(space, space.high) - _along_scale(space, space.low)
    step = np.where(space.is_log, np.log(_LOG_STEP_FACTOR) / scale, _LINEAR_STEP)
    unit = space.to_unit(parameters)
    moved = np.where(unit + step > 1, unit - step, unit + step)
    changed = np.repeat(unit[None], len(unit), 0)
    np.fill_diagonal(changed, np.where(moved < 0, unit < 0.5, moved))
    return space.from_unit(changed)


def _along_scale(space: ParameterSpace, parameters: np.ndarray) -> np.ndarray:
    """(..., N) logarithms on a log scale, else the values."""
    return np.where(space.is_log, np.log(np.where(space.is_log, parameters, 1.0)), parameters)


def _std_by_colours(
    simulator: Simulator, step: np.ndarray, pictures: CameraChanges, observation: ObservationModel
) -> np.ndarray:
    """(N,) standard deviations by mean colours; (N,) `step`: what was changed, along its scale.

    The error of a mean colour is at least one of 256 levels, by rounding.
    """
    if not simulator.views:
        return np.full(len(step), np.inf)
    num_pixels = pictures.pixel_share * math.prod(simulator.shape)
    added = observation.image_noise or ImageNoise(offset=0, noise=0)
    noise = added.noise / np.sqrt(np.maximum(num_pixels, 1))
    levels = np.hypot(1, 255 * np.hypot(added.offset, noise))
    return step * levels / np.maximum(pictures.levels, 1e-9)


def where_analyzed(space: ParameterSpace) -> np.ndarray:
    """(N,) nominal values, but a tenth of the longest delay for one of 0: motion jumps near 0."""
    return np.where(space.is_delay & (space.nominal == 0), _LINEAR_STEP * space.high, space.nominal)
