"""Whether other actions than the recorded ones explain a motion that no parameters explain."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from simtune.budget import Budget, OutOfTime
from simtune.fit.fit_setup import FitSetup
from simtune.fit.line_up import clearly_best, fit_quickly
from simtune.fit.motion.shooting import ShootingFit
from simtune.fit.observed import Observed
from simtune.simulation.other_actions import OtherActions, all_reversed, other_actions

_MOST_CHANGES, _MOST_S = 3, 12.0  # seconds for all together, beyond a budget that may be over
_MIN_GAIN = 1.0  # in −log likelihood per observation: a third of the distance
_SAID = (
    "This would explain the motion: {}. Then short parts of it end {:.1f} times as near to where "
    "they were seen. If it is so, correct the recorded actions, or what the model makes of them."
)
_MIRRORED = ", or the film is mirrored"


def misread_actions(
    setup: FitSetup, observed: Observed, parameters: np.ndarray, latencies: Sequence[int]
) -> list[str]:
    """A sentence on changes of the actions of E episodes that explain them far better, if any do.

    Those that `other_actions` and `all_reversed` list are tried as latencies are: short windows are
    fitted quickly, from (N,) `parameters`, and the best of the `latencies` counts. They are made
    one after the other, as long as any helps.
    """
    setup = replace(setup, physics=setup.physics.within(Budget(_MOST_S)))
    try:
        first = best = _fit(setup, observed, parameters, latencies)
    except OutOfTime:
        return []
    found, simulator = list[OtherActions](), setup.physics.simulator
    tried = [*other_actions(simulator), *all_reversed(simulator)]
    while len(found) < _MOST_CHANGES:
        fits = [best, *_fits_in_time(setup, observed, tried, parameters, latencies)]
        number = clearly_best(np.array([fit.misfit for fit in fits]))
        if _mean(best) - _mean(fits[number]) < _MIN_GAIN:
            break
        best, other = fits[number], tried[number - 1]
        observed = replace(observed, actions=other.of(observed.actions))
        found.append(other)
    nearer = np.divide(first.distances, best.distances)
    if not found or not np.isfinite(nearer).any():  # of nothing that is surely seen
        return []
    says = ", and ".join(other.says for other in found)
    is_mirrored = (np.prod([other.push for other in found], 0) < 0).all()
    return [_SAID.format(says + _MIRRORED * bool(is_mirrored), np.nanmax(nearer))]


def _fits_in_time(
    setup: FitSetup,
    observed: Observed,
    tried: Sequence[OtherActions],
    parameters: np.ndarray,
    latencies: Sequence[int],
) -> Iterator[ShootingFit]:
    """With each of the other actions in turn, until the time is over."""
    with suppress(OutOfTime):
        for other in tried:
            changed = replace(observed, actions=other.of(observed.actions))
            yield _fit(setup, changed, parameters, latencies)


def _fit(
    setup: FitSetup, observed: Observed, parameters: np.ndarray, latencies: Sequence[int]
) -> ShootingFit:
    """The best with any of the latencies."""
    late = [observed.delayed(steps) for steps in latencies]
    fits = [fit_quickly(setup, its, setup.estimator(its), parameters) for its in late]
    return min(fits, key=_mean)


def _mean(fit: ShootingFit) -> float:
    return float(fit.misfit.mean())
