"""What fits of known worlds say about a fit: how far it can be trusted.

Such refits show how large errors are relative to the standard deviations that fits claim, and how
large a misfit is when the simulator is right.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.special import ndtr, ndtri, stdtrit

from simtune.fit.result import FitResult, Misfit

_UNKNOWN_INFLATION = 3.0  # factor on standard deviations if there are no refits
# Prior of the standard deviation a fit claims for a moving parameter: this, in unit coordinates, or
# this share of the fit's initial one if that is less. It counts like two refits.
_PRIOR_STD, _PRIOR_STD_SHARE, _PRIOR_COUNT = 0.005, 0.4, 2.0
_POOLED_COUNT = 3.0  # the pooled variance of a kind counts like three refits of each parameter
# Prior of the ratio of errors to claimed standard deviations: 1. It counts like two refits, since
# the first few refits may all be lucky.
_RATIO_PRIOR_COUNT = 2.0
_SCALE_QUANTILE = 0.85  # of the errors, for their scale: outliers lie above
_FEWEST_FOR_BIAS = 3  # refits
_BIAS_QUANTILES = 0.25, 0.75  # of the errors, between which 0 is no bias
_CLIPPING_STDS = 3.0  # of errors: an outlier proves no bias
# Pixels that show a parameter differ from a wrong place's by this share of the full scale, and by
# this factor more than in any refit. Of 40 whole runs, 39 had a factor of 2 at most.
_WRONG_PLACE_NOISE, _WRONG_PLACE_RATIO = 0.04, 6.0


@dataclass(frozen=True)
class Refits:
    """Results of K refits of known worlds that converged, or of all if none did."""

    errors: np.ndarray  # (K, N) divided by the standard deviations that each fit claims
    is_moving: np.ndarray  # (N,) bool; the others are appearance, which is easier to find
    misfits: list[Misfit]
    usual_std: np.ndarray  # (N,) standard deviations that fits like these usually claim
    # (K,) indices of parameters that are known or held: their errors say nothing of these fits
    unfitted: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    num_diverged: int = 0  # known worlds besides, whose physics diverged

    @classmethod
    def none(cls, fit: FitResult) -> "Refits":
        """For a fit without refits."""
        nothing = np.zeros((0, len(fit.std)))
        usual = usual_std(nothing, fit, fit.rough_std[None])
        return cls(nothing, fit.is_moving, [], usual, fit.unfitted)

    def to_json(self) -> dict[str, Any]:
        """As a checkpoint holds it."""
        return {
            "errors": self.errors.tolist(),
            "is_moving": self.is_moving.tolist(),
            "misfits": [[misfit.motion, misfit.picture] for misfit in self.misfits],
            "usual_std": self.usual_std.tolist(),
            "unfitted": self.unfitted.tolist(),
            "num_diverged": self.num_diverged,
        }

    @classmethod
    def from_json(cls, saved: Mapping[str, Any]) -> "Refits":
        """The inverse of `to_json`."""
        is_moving = np.array(saved["is_moving"], bool)
        return cls(
            errors=np.array(saved["errors"], float).reshape(-1, len(is_moving)),
            is_moving=is_moving,
            misfits=[Misfit(tuple(motion), tuple(picture)) for motion, picture in saved["misfits"]],
            usual_std=np.array(saved["usual_std"]),
            unfitted=np.array(saved["unfitted"], int),
            num_diverged=saved["num_diverged"],
        )

    def believed(self, std: np.ndarray) -> np.ndarray:
        """(N,) standard deviations for those that a fit claims, before `inflation`.

        A claim depends mostly on how far apart the fit's two sides end, which is a single draw: two
        wrong sides may meet, and two good ones differ if one has not converged. The same actions
        tell about as much in worlds alike, so a claim smaller than usual is luck: what fits like
        these usually claim counts. Of a larger one, the geometric mean of the two counts; without
        refits, all of it.
        """
        return believed_std(std, self.usual_std, len(self.errors))

    def bias(self) -> np.ndarray:
        """(N,) bias of fits like these, in units of the standard deviations they claim.

        Subtract it from the estimate (Efron 1979). It is what three refits of four share, shrunk by
        how much of it may be chance.
        """
        return _bias_and_inflation(self.errors, self._kinds)[0]

    def inflation(self) -> np.ndarray:
        """(N,) factors on standard deviations, to be applied once `bias` is subtracted."""
        return _bias_and_inflation(self.errors, self._kinds)[1]

    @property
    def _kinds(self) -> tuple[np.ndarray, ...]:
        """(N,) bool for each kind of fitted parameter; refits of one kind are pooled."""
        is_fitted = ~np.isin(np.arange(len(self.is_moving)), self.unfitted)
        return self.is_moving & is_fitted, ~self.is_moving & is_fitted

    def ranks(self, names: Sequence[str]) -> dict[str, list[float]]:
        """{name: K probabilities, by each refit, of being below its truth}; empty without refits.

        They are uniform if intervals hold.

        These are the ranks of simulation-based calibration (Talts et al. 2018, arXiv:1804.06788).
        Each refit is judged by the others (leave one out); few refits show gross errors only.
        """
        if not len(self.errors):
            return {}
        others = [np.delete(self.errors, i, axis=0) for i in range(len(self.errors))]
        left_out = [_bias_and_inflation(remaining, self._kinds) for remaining in others]
        bias, factors = np.reshape(left_out, (-1, 2, self.errors.shape[1])).swapaxes(0, 1)
        ranks = ndtr((bias - self.errors) / factors)  # (K, N)
        return dict(zip(names, ranks.T.round(4).tolist(), strict=True))

    def motion_ratios(self, misfit: Misfit) -> list[float]:
        """Each sensor's misfit divided by the largest one among the refits; see `_ratio`."""
        return _ratios(misfit.motion, [known.motion for known in self.misfits])

    def picture_ratios(self, misfit: Misfit) -> np.ndarray:
        """The same for the pixels that show each of V visible parameters, (V,)."""
        return np.array(_ratios(misfit.picture, [known.picture for known in self.misfits]))

    def is_elsewhere(self, misfit: Misfit) -> np.ndarray:
        """(V,) bool: whether what shows a visible parameter is not where the fit has it.

        Its pixels then are of something else. A fit of the motion can hide that, as a detector errs
        by as much in all pictures.
        """
        ratios = self.picture_ratios(misfit)
        is_far = np.isfinite(ratios) & (ratios > _WRONG_PLACE_RATIO)
        return is_far & (np.array(misfit.picture) > _WRONG_PLACE_NOISE)


def usual_std(std: np.ndarray, fit: FitResult, rough: np.ndarray) -> np.ndarray:
    """(N,) geometric mean of the claims of (K, N) refits and the real fit, robust to large ones.

    Moving parameters have a prior, which counts more the fewer refits there are. `rough`:
    (K + 1, N) standard deviations with which the fits began.
    """
    expected = np.minimum(_PRIOR_STD, _PRIOR_STD_SHARE * np.sqrt(np.square(rough).mean(0)))
    expected = np.maximum(expected, 1e-9)
    if not len(std):
        return np.where(fit.is_moving, expected, fit.std)
    logs = np.log(np.vstack([std, fit.std]))
    count = np.where(fit.is_moving, _PRIOR_COUNT, 0.0)
    return np.exp((logs.sum(0) + count * np.log(expected)) / (len(logs) + count))


def believed_std(std: np.ndarray, usual_std: np.ndarray, num_refits: int) -> np.ndarray:
    """See `Refits.believed`."""
    return np.maximum(usual_std, np.sqrt(std * usual_std) if num_refits else std)


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
    """(N,) what (K, N) errors share, shrunk towards 0 by its uncertainty, and its variance.

    Refits that do not converge may all stop on the same side. Their mean is then not the bias of
    one that converged, so the quartile nearest to 0 is used, or 0 if it lies between the two. With
    the mean m and its variance v it shrinks by 1 − v / m², or to 0 if that is negative (James and
    Stein 1961). v has a prior, errors as large as claimed, which counts like two of them.
    """
    count = len(errors)
    if count < _FEWEST_FOR_BIAS:
        return np.zeros(errors.shape[1]), np.zeros(errors.shape[1])
    near = np.clip(errors, -_CLIPPING_STDS, _CLIPPING_STDS)
    mean, squares = near.mean(0), count * near.var(0)
    variance = (squares + _RATIO_PRIOR_COUNT) / (count - 1 + _RATIO_PRIOR_COUNT) / count
    share = np.clip(1 - variance / np.maximum(mean**2, 1e-12), 0, 1)
    shared = np.clip(0.0, *np.quantile(near, _BIAS_QUANTILES, axis=0))
    return share * shared, share**2 * variance


def _bias_and_inflation(
    errors: np.ndarray, kinds: Sequence[np.ndarray]
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
    for of_kind in kinds:
        if not of_kind.any():
            continue
        sizes = np.abs(errors[:, of_kind])  # (K, G)
        # A quantile: one failed refit must not widen all intervals.
        usual = float(np.quantile(sizes, _SCALE_QUANTILE)) / ndtri((1 + _SCALE_QUANTILE) / 2)
        pooled = count * usual**2 + _RATIO_PRIOR_COUNT
        pooled /= count + _RATIO_PRIOR_COUNT
        square = np.square(np.minimum(sizes, 3 * np.sqrt(pooled))).sum(0) + _POOLED_COUNT * pooled
        unsure = stdtrit(count + _POOLED_COUNT, 0.95) / ndtri(0.95)
        spread = square / (count + _POOLED_COUNT) + variance[of_kind]
        factors[of_kind] = unsure * np.sqrt(spread)
    return bias, factors
