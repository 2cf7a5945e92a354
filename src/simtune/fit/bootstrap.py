"""Parametric bootstrap: how far a fit can be trusted is measured, not assumed.

Simulated worlds near the estimate are filmed and fitted just as the real one (Efron 1979). Such
refits say how large errors are in terms of what a fit thinks of itself, and how well videos fit
that the simulator did make.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.special import ndtr, ndtri, stdtrit

from simtune.budget import Budget, OutOfTime
from simtune.fit.observed import Observed
from simtune.fit.replay_fit import ReplayFit
from simtune.fit.result import FitResult, Misfit, PointEstimate

_UNKNOWN_INFLATION = 3.0  # of standard deviations, where there are no refits
# Before any refit, a fit of what moves is taken to be off by so much, in unit coordinates, or by
# so large a share of what it began with, if that is less; and that counts like two refits.
_USUAL_STD, _USUAL_SHARE, _USUAL_COUNT = 0.005, 0.4, 2.0
_POOLED_COUNT = 3.0  # all parameters of a kind count like three refits of each
# Before any refit errors are taken to be so many times what fits claim, and that counts like two
# of them: the first few may all be lucky.
_EXPECTED, _EXPECTED_COUNT = {"moving": 1.0, "appearance": 1.0}, 2.0
_USUAL = 0.85  # share of errors that are taken to be no accident
_FEWEST_FOR_BIAS = 3  # refits
_FARTHEST = 3.0  # standard deviations: one that went astray says nothing of all
_SMALLEST_STD = 0.01  # of known worlds around the estimate, in unit coordinates
FEW_EPISODES = 3  # of a refit, at least: enough to compare errors with what a fit thinks of itself
MANY_EPISODES = 5  # at most: windows are no more for more of them
# A refit that is worse by this factor went astray where the real world's fit did not.
_ASTRAY = 1.5
_MARGIN = 0.002  # truths keep this far from the bounds

# (N,) parameters and the actions' latency, steps, to what would be observed of that world; None
# where its physics diverges
Synthesize = Callable[[np.ndarray, int], Observed | None]


@dataclass(frozen=True)
class Bootstrap:
    """What K refits of known worlds showed."""

    errors: np.ndarray  # (K, N) in terms of each fit's own standard deviations
    is_moving: np.ndarray  # (N,) bool: the others are appearance, which is easier to find
    misfits: list[Misfit] = field(default_factory=list)  # also of fits whose errors say nothing
    # (N,) standard deviations that fits like these claim; None: as the one that is asked about
    usual_std: np.ndarray | None = None
    # (K,) indices of parameters that are known: that refits do not miss these says nothing
    known: np.ndarray = field(default_factory=lambda: np.zeros(0, int))

    @classmethod
    def none(cls, fit: FitResult) -> "Bootstrap":
        """Of a fit that no refit has judged."""
        nothing = np.zeros((0, len(fit.std)))
        usual_std = _usual_std(nothing, fit, fit.rough_std[None])
        return cls(nothing, fit.is_moving, [], usual_std, fit.known)

    def believed(self, std: np.ndarray) -> np.ndarray:
        """(N,) standard deviations for those that a fit claims, before `inflation`.

        How far apart a fit's two sides end says most of what it claims, and that is a single draw:
        sides that are both off may well meet, and sides that are both right end apart where one
        did not arrive. So it counts half, and half what such fits usually claim. Where there
        are no others, the larger one.
        """
        return std if self.usual_std is None else _believed(std, self.usual_std, len(self.errors))

    def bias(self) -> np.ndarray:
        """(N,) by how much fits like these are too high, in terms of what they claim.

        It is to be taken off the estimate (Efron 1979): the mean error of the refits, as far as
        that stands out from chance.
        """
        return _bias_and_inflation(self.errors, self._kinds)[0]

    def inflation(self) -> np.ndarray:
        """(N,) factors by which standard deviations have to be multiplied, once `bias` is off."""
        return _bias_and_inflation(self.errors, self._kinds)[1]

    @property
    def _kinds(self) -> dict[str, np.ndarray]:
        """(N,) bool of those that are alike in how much refits can tell."""
        is_fitted = ~np.isin(np.arange(len(self.is_moving)), self.known)
        return {"moving": self.is_moving & is_fitted, "appearance": ~self.is_moving & is_fitted}

    def ranks(self) -> np.ndarray:
        """(K, N) probability, by each refit, of being below its truth: uniform if intervals hold.

        These are the ranks of simulation-based calibration (Talts et al. 2018, arXiv:1804.06788).
        Each is judged by what the others alone say; so few show gross errors only.
        """
        others = [np.delete(self.errors, i, axis=0) for i in range(len(self.errors))]
        each = [_bias_and_inflation(its, self._kinds) for its in others]
        bias, factors = np.reshape(each, (-1, 2, self.errors.shape[1])).swapaxes(0, 1)
        return ndtr((bias - self.errors) / factors)

    def motion_ratios(self, misfit: Misfit) -> list[float]:
        """Of each sensor, a misfit over the largest of the refits'; see `_ratio`."""
        known = zip(*(m.motion for m in self.misfits), strict=True)
        ratios = [_ratio(v, its) for v, its in zip(misfit.motion, known, strict=False)]
        return ratios or [0.0] * len(misfit.motion)

    def picture_ratio(self, misfit: Misfit) -> float:
        return _ratio(misfit.picture, [m.picture for m in self.misfits])


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
    """Fit `num` worlds near `fit` as the real one was fitted; fewer where `budget` is over before.

    One that raises OutOfTime is left out, and is the last.
    `start` is where the real one's fit began; `extend_horizon`: see `ReplayFit.fit`.
    """
    budget = budget or Budget()
    space = replay_fit.space
    unit, smallest = space.to_unit(fit.parameters), np.maximum(start.std, _SMALLEST_STD)
    # Not farther away than was known before: what the fit leaves open may fill the whole space.
    std = np.clip(2 * fit.std, _SMALLEST_STD, smallest)
    # As far as the real one's fit had to go: what begins near the truth ends there easily.
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
        astray.append(any(its > _ASTRAY * real for its, real in pairs))
    # Where all of them went astray, the real one may well have: then they do count.
    kept = ~np.array(astray, bool) | np.all(astray)
    shape = (-1, len(unit))
    off, std = np.array(errors).reshape(shape)[kept], np.array(stds).reshape(shape)[kept]
    usual_std = _usual_std(std, fit, np.array(rough))
    claimed = np.hypot(_believed(std, usual_std, len(std)), fit.discrepancy_std)
    return Bootstrap(off / claimed, fit.is_moving, misfits, usual_std, fit.known)


def _usual_std(std: np.ndarray, fit: FitResult, rough: np.ndarray) -> np.ndarray:
    """(N,) geometric mean of what (K, N) refits and the real fit claim: a few claim far too much.

    The fewer they are the more counts, of what moves, what is known without them: `rough`,
    (K + 1, N) of where they began.
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


def _ratio(value: float, known) -> float:
    """A misfit over the largest of the known ones; an unknown one (NaN) is infinite.

    Unless all known ones are likewise, or there are none: then nothing can be compared.
    """
    finite = [k for k in known if not np.isnan(k)]
    if not finite:
        return 0.0
    return float("inf") if np.isnan(value) else value / max(*finite, 1e-9)


def _bias(errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N,) mean of (K, N) errors, shrunk towards none by how unsure it is, and its variance.

    With the mean m and its variance v, m (1 − v / m²) where that is no less than none (James and
    Stein 1961). That errors scatter by as much as is claimed counts like two of them.
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
    """(N,) each, for (K, N) errors in terms of their standard deviations.

    `kinds`: (N,) bool of each kind.

    Few refits say little of a single parameter: it leans on all of its kind. What they say is
    not sure itself, so 90 % intervals are as wide as Student's.
    """
    factors, count = np.full(errors.shape[1], _UNKNOWN_INFLATION), len(errors)
    bias, variance = _bias(errors)
    if not count:
        return bias, factors
    errors = errors - bias
    for kind, of_kind in kinds.items():
        if not of_kind.any():
            continue
        its = np.abs(errors[:, of_kind])  # (K, G)
        # A single refit that went astray is no reason to widen everything.
        usual = float(np.quantile(its, _USUAL)) / ndtri((1 + _USUAL) / 2)
        pooled = count * usual**2 + _EXPECTED_COUNT * _EXPECTED[kind] ** 2
        pooled /= count + _EXPECTED_COUNT
        square = np.square(np.minimum(its, 3 * np.sqrt(pooled))).sum(0) + _POOLED_COUNT * pooled
        unsure = stdtrit(count + _POOLED_COUNT, 0.95) / ndtri(0.95)
        spread = square / (count + _POOLED_COUNT) + variance[of_kind]
        factors[of_kind] = unsure * np.sqrt(spread)
    return bias, factors
