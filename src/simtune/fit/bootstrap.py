"""Parametric bootstrap: measures how far a fit can be trusted.

Simulated worlds near the estimate are filmed and fitted exactly as the real one (Efron 1979). These
refits show how large errors are relative to the standard deviations that fits claim, and how large
a misfit is when the simulator is right.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import ndtr, ndtri, stdtrit

from simtune.budget import Budget, OutOfTime
from simtune.fit.observed import Observed
from simtune.fit.replay_fit import ReplayFit
from simtune.fit.result import FitResult, Misfit, PointEstimate

_UNKNOWN_INFLATION = 3.0  # factor on standard deviations if there are no refits
# Prior of the standard deviation a fit claims for a moving parameter: this, in unit coordinates, or
# this share of the fit's initial one if that is less. It counts like two refits.
_USUAL_STD, _USUAL_SHARE, _USUAL_COUNT = 0.005, 0.4, 2.0
_POOLED_COUNT = 3.0  # the pooled variance of a kind counts like three refits of each parameter
# Prior of the ratio of errors to claimed standard deviations. It counts like two refits, since the
# first few refits may all be lucky.
_EXPECTED, _EXPECTED_COUNT = {"moving": 1.0, "appearance": 1.0}, 2.0
_USUAL = 0.85  # quantile of the errors that gives their scale: outliers lie above
_FEWEST_FOR_BIAS = 3  # refits
_FARTHEST = 3.0  # standard deviations at which errors are clipped: an outlier proves no bias
_SMALLEST_STD = 0.01  # of the refitted worlds around the estimate, in unit coordinates
FEW_EPISODES = 3  # of a refit at least: enough to compare errors with claimed std
MANY_EPISODES = 5  # at most: a fit uses no more windows if there are more episodes
# A refit whose misfit is larger than the real fit's by this factor has failed to converge.
_ASTRAY = 1.5
_MARGIN = 0.002  # distance of true parameters from the bounds, in unit coordinates

# Maps (N,) parameters and the latency of actions, in steps, to observations of that world; to None
# if its physics diverges
Synthesize = Callable[[np.ndarray, int], Observed | None]


@dataclass(frozen=True)
class Bootstrap:
    """Results of K refits of known worlds."""

    errors: np.ndarray  # (K, N) divided by the standard deviations that each fit claims
    is_moving: np.ndarray  # (N,) bool; the others are appearance, which is easier to find
    misfits: list[Misfit] = field(default_factory=list)  # failed fits included
    # (N,) standard deviations that fits like these usually claim; None: use those asked about
    usual_std: np.ndarray | None = None
    # (K,) indices of parameters that are known or held: their errors say nothing of these fits
    unfitted: np.ndarray = field(default_factory=lambda: np.zeros(0, int))

    @classmethod
    def none(cls, fit: FitResult) -> "Bootstrap":
        """For a fit without refits."""
        nothing = np.zeros((0, len(fit.std)))
        usual_std = _usual_std(nothing, fit, fit.rough_std[None])
        return cls(nothing, fit.is_moving, [], usual_std, fit.unfitted)

    def believed(self, std: np.ndarray) -> np.ndarray:
        """(N,) standard deviations for those that a fit claims, before `inflation`.

        A claim depends mostly on how far apart the fit's two sides end, which is a single draw: two
        wrong sides may meet, and two good ones differ if one has not converged. So the result is
        the geometric mean of the claim and of what fits like these usually claim; without refits,
        the larger.
        """
        return std if self.usual_std is None else _believed(std, self.usual_std, len(self.errors))

    def bias(self) -> np.ndarray:
        """(N,) bias of fits like these, in units of the standard deviations they claim.

        Subtract it from the estimate (Efron 1979). It is the mean error of the refits, shrunk by
        how much of it may be chance.
        """
        return _bias_and_inflation(self.errors, self._kinds)[0]

    def inflation(self) -> np.ndarray:
        """(N,) factors on standard deviations, to be applied once `bias` is subtracted."""
        return _bias_and_inflation(self.errors, self._kinds)[1]

    @property
    def _kinds(self) -> dict[str, np.ndarray]:
        """(N,) bool for each kind of fitted parameter; refits of one kind are pooled."""
        is_fitted = ~np.isin(np.arange(len(self.is_moving)), self.unfitted)
        return {"moving": self.is_moving & is_fitted, "appearance": ~self.is_moving & is_fitted}

    def ranks(self) -> np.ndarray:
        """(K, N) probability, by each refit, of being below its truth: uniform if intervals hold.

        These are the ranks of simulation-based calibration (Talts et al. 2018, arXiv:1804.06788).
        Each refit is judged by the others (leave one out); few refits show gross errors only.
        """
        others = [np.delete(self.errors, i, axis=0) for i in range(len(self.errors))]
        left_out = [_bias_and_inflation(remaining, self._kinds) for remaining in others]
        bias, factors = np.reshape(left_out, (-1, 2, self.errors.shape[1])).swapaxes(0, 1)
        return ndtr((bias - self.errors) / factors)

    def motion_ratios(self, misfit: Misfit) -> list[float]:
        """Each sensor's misfit divided by the largest one among the refits; see `_ratio`."""
        return _ratios(misfit.motion, [known.motion for known in self.misfits])

    def picture_ratios(self, misfit: Misfit) -> list[float]:
        """The same for the pixels that show each visible parameter."""
        return _ratios(misfit.picture, [known.picture for known in self.misfits])


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
    # If all failed to converge, the real fit may have as well: keep them.
    kept = ~np.array(astray, bool) | np.all(astray)
    shape = (-1, len(unit))
    off, std = np.array(errors).reshape(shape)[kept], np.array(stds).reshape(shape)[kept]
    usual_std = _usual_std(std, fit, np.array(rough))
    claimed = np.hypot(_believed(std, usual_std, len(std)), fit.discrepancy_std)
    return Bootstrap(off / claimed, fit.is_moving, misfits, usual_std, fit.unfitted)


def _usual_std(std: np.ndarray, fit: FitResult, rough: np.ndarray) -> np.ndarray:
    """(N,) geometric mean of the claims of (K, N) refits and the real fit, robust to large ones.

    Moving parameters have a prior, which counts more the fewer refits there are. `rough`:
    (K + 1, N) standard deviations with which the fits began.
    """
    expected = np.minimum(_USUAL_STD, _USUAL_SHARE * np.sqrt(np.square(rough).mean(0)))
    expected = np.maximum(expected, 1e-9)
    if not len(std):
        return np.where(fit.is_moving, expected, fit.std)
    logs = np.log(np.vstack([std, fit.std]))
    count = np.where(fit.is_moving, _USUAL_COUNT, 0.0)
    return np.exp((logs.sum(0) + count * np.log(expected)) / (len(logs) + count))


def _believed(std: np.ndarray, usual_std: np.ndarray, num_refits: int) -> np.ndarray:
    """See `Bootstrap.believed`."""
    return np.sqrt(std * usual_std) if num_refits else np.maximum(std, usual_std)


def _ratios(values: Sequence[float], known: Sequence[Sequence[float]]) -> list[float]:
    """`_ratio` of each; all 0 if nothing is known."""
    each = zip(*known, strict=True) if known else [()] * len(values)
    return [_ratio(value, of_known) for value, of_known in zip(values, each, strict=True)]


def _ratio(value: float, known: Sequence[float]) -> float:
    """A misfit divided by the largest of the known ones; infinite if it is NaN.

    0 if all known ones are NaN or there are none: then nothing can be compared.
    """
    finite = [k for k in known if not np.isnan(k)]
    if not finite:
        return 0.0
    return float("inf") if np.isnan(value) else value / max(*finite, 1e-9)


def _bias(errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) mean of (K, N) errors, shrunk towards 0 by its uncertainty, and its variance.

    With mean m and its variance v: m (1 − v / m²), or 0 if that is negative (James and Stein 1961).
    v has a prior, errors as large as claimed, which counts like two of them.
    """
    count = len(errors)
    if count < _FEWEST_FOR_BIAS:
        return np.zeros(errors.shape[1]), np.zeros(errors.shape[1])
    near = np.clip(errors, -_FARTHEST, _FARTHEST)
    mean, squares = near.mean(0), count * near.var(0)
    variance = (squares + _EXPECTED_COUNT) / (count - 1 + _EXPECTED_COUNT) / count
    share = np.clip(1 - variance / np.maximum(mean**2, 1e-12), 0, 1)
    return share * mean, share**2 * variance


def _bias_and_inflation(
    errors: np.ndarray, kinds: Mapping[str, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """(N,) each, for (K, N) errors divided by the standard deviations claimed.

    `kinds`: (N,) bool of each kind.

    Few refits say little about a single parameter, so its variance is pooled with that of its kind.
    This variance is uncertain itself, so 90 % intervals are as wide as Student's t.
    """
    factors, count = np.full(errors.shape[1], _UNKNOWN_INFLATION), len(errors)
    bias, variance = _bias(errors)
    if not count:
        return bias, factors
    errors = errors - bias
    for kind, of_kind in kinds.items():
        if not of_kind.any():
            continue
        sizes = np.abs(errors[:, of_kind])  # (K, G)
        # A quantile: one failed refit must not widen all intervals.
        usual = float(np.quantile(sizes, _USUAL)) / ndtri((1 + _USUAL) / 2)
        pooled = count * usual**2 + _EXPECTED_COUNT * _EXPECTED[kind] ** 2
        pooled /= count + _EXPECTED_COUNT
        square = np.square(np.minimum(sizes, 3 * np.sqrt(pooled))).sum(0) + _POOLED_COUNT * pooled
        unsure = stdtrit(count + _POOLED_COUNT, 0.95) / ndtri(0.95)
        spread = square / (count + _POOLED_COUNT) + variance[of_kind]
        factors[of_kind] = unsure * np.sqrt(spread)
    return bias, factors
