"""Parametric bootstrap: fits of known worlds (Efron 1979).

Simulated worlds near the estimate are filmed and fitted exactly as the real one.
"""

from collections.abc import Callable

import numpy as np

from simtune.budget import Budget, OutOfTime
from simtune.fit.bootstrap import Bootstrap, believed_std, usual_std
from simtune.fit.observed import Observed
from simtune.fit.replay_fit import ReplayFit
from simtune.fit.result import FitResult, PointEstimate

_SMALLEST_STD = 0.01  # of the refitted worlds around the estimate, in unit coordinates
FEW_EPISODES = 3  # of a refit at least: enough to compare errors with claimed std
MANY_EPISODES = 5  # at most: a fit uses no more windows if there are more episodes
# A refit whose misfit is larger than the real fit's by this factor has failed to converge.
_ASTRAY = 1.5
_MARGIN = 0.002  # distance of true parameters from the bounds, in unit coordinates

# Maps (N,) parameters and the latency of actions, in steps, to observations of that world; to None
# if its physics diverges
Synthesize = Callable[[np.ndarray, int], Observed | None]


def run_bootstrap(
    replay_fit: ReplayFit,
    synthesize: Synthesize,
    fit: FitResult,
    start: PointEstimate,
    num: int,
    rng: np.random.Generator,
    extend_horizon: bool = True,
    budget: Budget | None = None,
) -> Bootstrap:
    """Fit `num` worlds near `fit` as the real one was fitted; fewer if `budget` runs out.

    A refit that raises OutOfTime is dropped and ends the bootstrap. `start`: where the real world's
    fit began; `extend_horizon`: see `ReplayFit.fit`.
    """
    budget = budget or Budget()
    space = replay_fit.space
    unit, smallest = space.to_unit(fit.parameters), np.maximum(start.std, _SMALLEST_STD)
    # At most the prior's std: where the fit says nothing, worlds would fill the whole space.
    std = np.clip(2 * fit.std, _SMALLEST_STD, smallest)
    # At least as far as the real fit moved: a fit that starts near the truth converges easily.
    away = np.maximum(start.std, np.abs(unit - space.to_unit(start.parameters)))
    errors, stds, misfits, astray, rough = [], [], [], [], [fit.rough_std]
    for number in range(num):
        if number and not budget.allows_another(number):
            break
        budget.report("fitting known worlds for comparison", number / num)
        truth = np.clip(unit + std * rng.normal(size=len(unit)), _MARGIN, 1 - _MARGIN)
        truth[fit.known] = unit[fit.known]
        observed = synthesize(space.from_unit(truth), fit.latency_steps)
        if observed is None:
            continue
        begin = space.from_unit(truth + away * rng.normal(size=len(unit)))
        begun = PointEstimate(begin, start.std)
        try:
            refit = replay_fit.fit(observed, begun, (fit.latency_steps,), extend_horizon)
        except OutOfTime:
            break
        misfits.append(refit.misfit)
        errors.append(space.to_unit(refit.parameters) - truth)
        stds.append(refit.std)
        rough.append(refit.rough_std)
        # Either may be NaN.
        pairs = zip(refit.misfit.motion, fit.misfit.motion, strict=True)
        astray.append(any(refitted > _ASTRAY * real for refitted, real in pairs))
    # If all failed to converge, the real fit may have as well: keep them. Else neither errors nor
    # misfits of those that failed count: beside theirs, any misfit would look usual.
    kept = ~np.array(astray, bool) | np.all(astray)
    shape = (-1, len(unit))
    off, std = np.array(errors).reshape(shape)[kept], np.array(stds).reshape(shape)[kept]
    usual = usual_std(std, fit, np.array(rough))
    claimed = np.hypot(believed_std(std, usual, len(std)), fit.refitted_discrepancy_std)
    compared = [misfit for misfit, is_kept in zip(misfits, kept, strict=True) if is_kept]
    return Bootstrap(off / claimed, fit.is_moving, compared, usual, fit.unfitted)
