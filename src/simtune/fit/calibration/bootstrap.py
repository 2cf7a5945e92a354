"""Parametric bootstrap: fits of known worlds (Efron 1979).

Simulated worlds near the estimate are filmed and fitted exactly as the real one.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from simtune.budget import NO_LIMIT, Budget, OutOfTime
from simtune.fit.calibration.refits import Refits, believed_std, usual_std
from simtune.fit.observed import Observed
from simtune.fit.replay_fit import ReplayFit
from simtune.fit.result import FitResult, PointEstimate
from simtune.parameters import ParameterSpace

_SMALLEST_STD = 0.01  # of the refitted worlds around the estimate, in unit coordinates
FEW_EPISODES = 3  # of a refit at least: enough to compare errors with claimed std
MANY_EPISODES = 5  # at most: a fit uses no more windows if there are more episodes
# A refit whose misfit is larger than the real fit's by this factor has failed to converge.
_FAILED_MISFIT_RATIO = 1.5
_MAX_TRIES = 3  # of a known world that does not diverge
_BOUND_MARGIN = 0.002  # distance of true parameters from the bounds, in unit coordinates

# Maps (N,) parameters and the latency of actions, in steps, to observations of that world; to None
# if its physics diverges
Synthesize = Callable[[np.ndarray, int], Observed | None]


class _Refit(NamedTuple):
    """Of a known world."""

    fit: FitResult
    error: np.ndarray  # (N,) in unit coordinates


def run_bootstrap(
    replay_fit: ReplayFit,
    synthesize: Synthesize,
    fit: FitResult,
    start: PointEstimate,
    num: int,
    rng: np.random.Generator,
    budget: Budget = NO_LIMIT,
) -> Refits:
    """Fit `num` worlds near `fit` as the real one was fitted; fewer if `budget` runs out.

    A refit that raises OutOfTime is dropped and ends the bootstrap. `start`: where the real world's
    fit began.
    """
    space = replay_fit.space
    unit, start_unit = space.to_unit(fit.parameters), space.to_unit(start.parameters)
    # At least as far as the real fit moved: a fit that starts near the truth converges easily.
    away = np.maximum(start.std, np.abs(unit - start_unit))
    refits, num_diverged = list[_Refit](), 0
    for number, offset in zip(range(num), _in_opposite_pairs(rng, len(unit)), strict=False):
        if number and not budget.allows_another(number):
            break
        budget.report("fitting known worlds for comparison", number / num)
        known = _film_known(space, synthesize, fit, start, rng)
        if known is None:
            num_diverged += 1
            continue
        truth, observed = known
        begin = PointEstimate(space.from_unit(truth + away * offset), start.std)
        try:
            refit = replay_fit.fit(observed, begin, (fit.latency_steps,))
        except OutOfTime:
            break
        refits.append(_Refit(refit, space.to_unit(refit.parameters) - truth))
    return replace(_compared(fit, refits), num_diverged=num_diverged)


def _in_opposite_pairs(rng: np.random.Generator, size: int) -> Iterator[np.ndarray]:
    """(size,) normal numbers without end, each followed by its opposite (antithetic variates).

    A refit that does not converge errs towards its start. A few independent starts may all lie on
    one side by chance, which would look like a bias.
    """
    while True:
        offset = rng.normal(size=size)
        yield offset
        yield -offset


def _film_known(
    space: ParameterSpace,
    synthesize: Synthesize,
    fit: FitResult,
    start: PointEstimate,
    rng: np.random.Generator,
) -> tuple[np.ndarray, Observed] | None:
    """(N,) true parameters of a world near the `fit`'s, in unit coordinates, and its observations.

    Another one where a world diverges, so that opposite starts stay pairs; None if several do.
    """
    unit = space.to_unit(fit.parameters)
    for _ in range(_MAX_TRIES):
        truth = _world_near(fit, unit, start, rng)
        if observed := synthesize(space.from_unit(truth), fit.latency_steps):
            return truth, observed
    return None


def _world_near(
    fit: FitResult, unit: np.ndarray, start: PointEstimate, rng: np.random.Generator
) -> np.ndarray:
    """(N,) true parameters of a world near the `fit`'s, `unit`, all in unit coordinates."""
    # At most the prior's std: where the fit says nothing, worlds would fill the whole space.
    std = np.clip(2 * fit.std, _SMALLEST_STD, np.maximum(start.std, _SMALLEST_STD))
    truth = np.clip(unit + std * rng.normal(size=len(unit)), _BOUND_MARGIN, 1 - _BOUND_MARGIN)
    truth[fit.known] = unit[fit.known]
    return truth


def _compared(fit: FitResult, refits: list[_Refit]) -> Refits:
    """What the `refits` say about the `fit`.

    If all failed to converge, the real fit may have as well: keep them. Else neither errors nor
    misfits of those that failed count: beside theirs, any misfit would look usual.
    """
    rough = np.array([fit.rough_std, *(refit.fit.rough_std for refit in refits)])
    refits = [refit for refit in refits if not _is_astray(refit.fit, fit)] or refits
    shape = (-1, len(fit.std))
    errors = np.array([refit.error for refit in refits]).reshape(shape)
    std = np.array([refit.fit.std for refit in refits]).reshape(shape)
    usual = usual_std(std, fit, rough)
    claimed = np.hypot(believed_std(std, usual, len(std)), fit.refitted_discrepancy_std)
    misfits = [refit.fit.misfit for refit in refits]
    return Refits(errors / claimed, fit.is_moving, misfits, usual, fit.unfitted)


def _is_astray(refit: FitResult, fit: FitResult) -> bool:
    pairs = zip(refit.misfit.motion, fit.misfit.motion, strict=True)  # either may be NaN
    return any(refitted > _FAILED_MISFIT_RATIO * real for refitted, real in pairs)
