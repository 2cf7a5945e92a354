"""What a descent on readings found, and how sure that is."""

from dataclasses import dataclass

import numpy as np

from simtune.budget import Budget
from simtune.fit.elimination import NormalEquations
from simtune.fit.lateness import steps_late_and_std
from simtune.fit.readings.descent import Descent
from simtune.fit.readings.normal_equations import explained_by_starts, jackknife, jackknife_std
from simtune.fit.readings.residuals import correlation_times
from simtune.fit.readings.slopes import StretchSlopes
from simtune.fit.readings.timestep import change_by_timestep
from simtune.observation import assumed_noise

_MIN_OBSERVATIONS = 2.0  # effective ones per reading
_NUM_PARTS = 5  # of a single stretch, each left out in turn


@dataclass(frozen=True)
class OutputErrorFit:
    """Estimate and uncertainty; P parameters, D readings."""

    unit: np.ndarray  # (N,) parameters in unit coordinates; those not fitted are unchanged
    covariance: np.ndarray  # (P, P) in unit coordinates
    offsets: np.ndarray  # (D,) measured − simulated
    noise: np.ndarray  # (D,) root mean square of the residuals
    start: np.ndarray | None  # (S,) full state where the first episode begins, if it was replayed
    late_steps: tuple[float, float]  # lateness of readings, and its standard deviation
    # (N,) in unit coordinates: how the estimate would change if physics had no timestep; see
    # `change_by_timestep`
    by_timestep: np.ndarray
    timestep_s: float
    # (P, D) shares of readings in what each parameter changes, at usual noise; rows sum to 1
    shares: np.ndarray


def judge(ended: Descent, slopes: StretchSlopes, budget: Budget) -> OutputErrorFit:
    """Estimate with its covariance, each residual counting as 1/τ of a measurement.

    `budget`: for `change_by_timestep`.
    """
    objective, point, loop = ended.objective, ended.point, ended.objective.loop
    num = len(loop.fitted)
    residuals = objective.residuals(point, slopes.predicted)
    noise, times = objective.noise(residuals), correlation_times(residuals)
    count = np.maximum(np.isfinite(residuals).sum((0, 1)) / times, _MIN_OBSERVATIONS)
    # Degrees of freedom of each column: its own offset, its share of the parameters, and what
    # initial states explain of it
    spent = objective.finds_offset + num / len(noise)
    spent += explained_by_starts(slopes.by_start, residuals, noise * np.sqrt(times))
    unsure = np.sqrt(times * count / np.maximum(count - spent, count / 4))
    equations = objective.equations(point, slopes, noise * unsure)
    information, _ = objective.with_prior(equations, point)
    covariance = np.linalg.inv(information)
    scattered = _scatter(ended, slopes, noise * unsure, equations)[:num]
    std = np.sqrt(np.diag(covariance))[:num]
    wider = np.maximum(scattered / std, 1.0)
    covariance = covariance[:num, :num] * np.outer(wider, wider)
    changed = change_by_timestep(ended, slopes, budget)
    own, size = num - (loop.lateness is not None), len(loop.physics.parameters)
    by_timestep = np.zeros(size)
    by_timestep[loop.fitted[:own]] = changed[:own]
    is_known = np.isfinite(residuals)[:, None]
    # Not at `noise`: a reading that the model explains badly would seem to show little
    seen = slopes.by_parameter[:, :own] * is_known / assumed_noise(loop.sensors)
    shown = np.square(seen).sum((0, 2))  # (P, D)
    return OutputErrorFit(
        unit=point.unit[:size],
        covariance=covariance[:own, :own],
        offsets=point.offsets,
        noise=noise,
        start=objective.play(point)[1][0] if objective.begins_at_first else None,
        late_steps=steps_late_and_std(
            point.unit[size:], covariance[own:, own:] + np.square(changed[own:])
        ),
        by_timestep=by_timestep,
        timestep_s=loop.physics.simulator.model.opt.timestep,
        shares=shown / np.maximum(shown.sum(1, keepdims=True), 1e-300),
    )


def _scatter(
    ended: Descent, slopes: StretchSlopes, noise: np.ndarray, equations: NormalEquations
) -> np.ndarray:
    """(P + offsets,) standard deviations by leaving out episodes, or stretches of a single one.

    Or parts of a single stretch.
    """
    objective, point, episode = ended.objective, ended.point, ended.objective.stretches.episode
    if len(episode) > 1:
        alone = np.arange(len(episode)) if (episode == episode[0]).all() else episode
        return jackknife(*equations.by_group(alone), objective.with_prior(equations, point)[0])
    moved = []
    for part in np.array_split(np.arange(slopes.predicted.shape[1]), _NUM_PARTS):
        left = objective.equations(point, slopes, noise, part)
        moved.append(-np.linalg.solve(*objective.with_prior(left, point)))
    return jackknife_std(np.array(moved))
