"""Combines many small experiments into one estimate: a random-effects meta-analysis.

Windows of a motion, or pictures, each inform about the same parameters, and disagree by more than
their noise explains: detector errors are correlated, contacts are not smooth. So each is weighted
by the variance of its own estimate plus the variance between experiments
(DerSimonian and Laird 1986). This also keeps a single chaotic window from outweighing all others.
"""

from dataclasses import dataclass

import numpy as np

_STUDENT_DOF = 4.0  # degrees of freedom: Student weights reduce outliers
_SMALLEST_VARIANCE, _LARGEST_VARIANCE = 4e-3**2, 0.08**2  # between experiments
FIRST_VARIANCE = 0.02**2
_VARIANCE_STEP, _FEWEST_INFORMATIVE = 1.5, 4  # factor of an update; experiments it needs
_CHI2_MEDIAN = 0.6  # approximate median of χ² / degrees of freedom, for a few of them
_CHI2_MEDIAN_OF_ONE = 0.455
_MIN_M = 0.3  # of `combine`: outliers alone would make it 0
_CLAIM_COUNT = 2.0  # experiments that the claimed variance counts like, beside the scatter
COMMON_STD = 0.1  # prior standard deviation of common errors, in their own scaled coordinates
_NO_COMMON = np.zeros(0)
_RIDGE = 1e-6  # of information: keeps it invertible where nothing is known
_DAMPING_STD = 0.1  # of parameters that are not linear: as if known within a tenth of their range


@dataclass(frozen=True)
class Combined:
    """Joint result of all experiments on P parameters' unit coordinates and Q common errors."""

    slope: np.ndarray  # (P + Q,) gradient of −log likelihood
    information: np.ndarray  # (P + Q, P + Q) its Hessian
    covariance: np.ndarray  # (P, P) of the parameters, with common errors marginalised
    variance: float  # between experiments

    def step(
        self, unit: np.ndarray, largest: float | np.ndarray, damping_std: float = _DAMPING_STD
    ) -> np.ndarray:
        """(P + Q,) damped Newton step from (P,) `unit`; see `step_within_bounds`.

        The damping (Levenberg 1944) is that of unknowns known to `damping_std` beforehand.
        """
        damped = self.information + damping_std**-2 * np.eye(len(self.slope))
        return step_within_bounds(damped, self.slope, unit, largest)


def step_within_bounds(
    damped: np.ndarray, slope: np.ndarray, unit: np.ndarray, largest: float | np.ndarray
) -> np.ndarray:
    """(P + Q,) `newton_within`, scaled so that no unit coordinate moves more than `largest`.

    That is a number for all of them, or (P,).
    """
    change = newton_within(damped, slope, unit, (0.0, 1.0))
    moves = np.maximum(np.abs(change[: len(unit)]), np.finfo(float).tiny)
    return change * (largest / moves).min(initial=1.0)


def newton_within(
    hessian: np.ndarray, slope: np.ndarray, unit: np.ndarray, bounds: tuple[float, float]
) -> np.ndarray:
    """(P + Q,) Newton step of P bounded unit coordinates, followed by Q unbounded unknowns.

    A coordinate at or beyond a bound that would move outwards is held, and the step is solved again
    for the free ones (active set). The result may still cross other bounds.
    """
    (low, high), num, free = bounds, len(unit), np.ones(len(slope), bool)
    while True:
        change = np.zeros(len(slope))
        change[free] = -np.linalg.solve(hessian[np.ix_(free, free)], slope[free])
        bounded = change[:num]
        beyond = (unit <= low) & (bounded < 0) | (unit >= high) & (bounded > 0)
        if not beyond.any():
            return change
        free[:num] &= ~beyond


def combine(
    information: np.ndarray,
    slope: np.ndarray,
    variance: float,
    trust: np.ndarray,
    common: np.ndarray = _NO_COMMON,
) -> Combined:
    """Combine W experiments on P parameters and on Q errors that are common to all of them.

    `information` I (W, P, P) and `slope` g (W, P) are the second and first derivatives of each
    experiment's −log likelihood, `variance` τ² is that between experiments, `trust` (W,) are
    weights. Experiment w alone would estimate −I_w⁻¹ g_w, with variance I_w⁻¹ + τ². So, with
    weights c_w = trust times Student's,

        information = Σ_w c_w I_w (1 + τ² I_w)⁻¹      slope = Σ_w c_w (1 + τ² I_w)⁻ᵀ g_w

    The covariance is the sandwich estimator A⁻¹ B A⁻¹ (Huber 1967), with the experiments' scatter
    B and with A the derivative of the sum of slopes. That is less than the information, since
    Student's weights fall as an estimate moves away: A = m information, where m averages
    1 − (2 / P) d_w / (ν + d_w) over experiments by what they tell; d_w is the squared distance per
    parameter, ν the degrees of freedom (Huber 1981, ch. 7, uses such a mean as well). Few hardly
    scatter, so what they claim, with τ², is added: `_corrections`, by how many experiments inform
    about each parameter. The variance returned is τ² after a step towards what they show.

    `common`: (Q,) common errors, whose slopes come last. Each has a normal prior with standard
    deviation COMMON_STD and is the same in all experiments (τ = 0); the prior is one more
    experiment.
    """
    num, size = slope.shape[1] - len(common), slope.shape[1]
    if not num:
        return Combined(np.zeros(size), np.eye(size), np.zeros((0, 0)), variance)
    is_parameter = np.arange(size) < num
    between = variance * is_parameter  # (P + Q,)
    prior = np.where(is_parameter, 0.0, COMMON_STD**-2)
    surprise = _surprise(information[:, :num, :num], slope[:, :num], variance)
    count = trust * (_STUDENT_DOF + 1) / (_STUDENT_DOF + surprise)  # (W,)
    shrink = np.linalg.inv(np.eye(size) + between[:, None] * information)  # (W, P + Q, P + Q)
    weighted = count[:, None, None] * (information @ shrink)
    slopes = count[:, None] * np.einsum("wqp,wq->wp", shrink, slope)
    total = slopes.sum(0) + prior * np.concatenate([np.zeros(num), common])
    return Combined(
        total,
        weighted.sum(0) + np.diag(prior),
        _covariance(weighted, slopes, total, prior, surprise),
        _next_variance(information[:, :num, :num], surprise, variance),
    )


def _covariance(
    weighted: np.ndarray,
    slopes: np.ndarray,
    total: np.ndarray,
    prior: np.ndarray,
    surprise: np.ndarray,
) -> np.ndarray:
    """(P, P) of the parameters, from (W, P + Q, P + Q) and (W, P + Q) terms of `combine`'s sums.

    `total`: (P + Q,) their slopes with the prior's; `prior`: (P + Q,) its information.
    """
    num, size = int((prior == 0).sum()), len(prior)
    by_data = weighted.sum(0)
    inverse = np.linalg.inv(by_data + np.diag(prior) + _RIDGE * np.eye(size))
    deviations = slopes - weighted @ (inverse @ total)
    # Degrees of freedom used by the fit; a common error uses the share that its data, not its
    # prior, determines.
    found = size - (prior * np.diag(inverse)).sum()
    shares = np.einsum("pq,wqr,rp->wp", inverse, weighted, inverse, optimize=True)
    few, claim = _corrections(shares, found)
    scatter = inverse @ (deviations.T @ deviations) @ inverse
    covariance = few * scatter / _softness(surprise, weighted[:, :num, :num]) ** 2
    covariance += claim * (inverse @ by_data @ inverse)
    covariance += inverse @ np.diag(prior + _RIDGE) @ inverse
    return covariance[:num, :num]


def _next_variance(information: np.ndarray, surprise: np.ndarray, variance: float) -> float:
    """τ² after a step towards what W experiments with (W, P, P) information show."""
    informative = np.trace(information, axis1=1, axis2=2) * variance > 1
    if informative.sum() >= _FEWEST_INFORMATIVE:
        usual = _CHI2_MEDIAN if information.shape[-1] > 1 else _CHI2_MEDIAN_OF_ONE
        too_small = np.median(surprise[informative]) > usual
        variance *= _VARIANCE_STEP if too_small else 1 / _VARIANCE_STEP
    return float(np.clip(variance, _SMALLEST_VARIANCE, _LARGEST_VARIANCE))


def _softness(surprise: np.ndarray, weighted: np.ndarray) -> float:
    """m of `combine`, of (W,) distances and (W, P, P) weighted information."""
    by_data = np.trace(weighted, axis1=1, axis2=2)
    bend = 1 - 2 / weighted.shape[-1] * surprise / (_STUDENT_DOF + surprise)
    return max(_MIN_M, float(bend @ by_data) / max(by_data.sum(), 1e-300))


def _corrections(shares: np.ndarray, found: float) -> tuple[np.ndarray, np.ndarray]:
    """Factors (P, P) on the covariance by scatter, and on the claimed one, which is added.

    `shares`: (W, P) of the variance that each experiment accounts for; `found`: unknowns found from
    all. Of a parameter that m = (Σ s)² / Σ s² experiments inform about, f = min(W − found, m − 1)
    degrees of freedom are left: by scatter m / f, and what is claimed counts like _CLAIM_COUNT of
    them.
    """
    count = np.square(shares.sum(0)) / np.maximum(np.square(shares).sum(0), 1e-300)  # (P,) m
    freedom = np.clip(np.minimum(len(shares) - found, count - 1), 0, None)
    few = np.maximum(count / np.maximum(freedom, 1), len(shares) / max(1, len(shares) - found))
    claim = _CLAIM_COUNT / (_CLAIM_COUNT + freedom)
    return np.sqrt(np.outer(few, few)), np.sqrt(np.outer(claim, claim))


def _surprise(information: np.ndarray, slope: np.ndarray, variance: float) -> np.ndarray:
    """(W,) squared Mahalanobis distance per parameter of each estimate from 0, with τ² included."""
    spread = information + variance * information @ information
    # Rank-deficient information, however large, must leave an invertible matrix.
    ridge = 1e-9 + 1e-12 * np.trace(spread, axis1=1, axis2=2)
    spread += ridge[:, None, None] * np.eye(slope.shape[1])
    solved = np.linalg.solve(spread, slope[..., None])[..., 0]
    return np.einsum("wp,wp->w", slope, solved) / slope.shape[1]


def robust_weights(cost: np.ndarray) -> np.ndarray:
    """(W,) weights of experiments by their costs: small if far worse explained than the others.

    The scale comes from the better half, since the worse half may be lost altogether.
    """
    low, middle = np.quantile(cost, [0.25, 0.5])
    return 1 / (1 + np.maximum(0, (cost - low) / (3 * (middle - low) + 1e-9)) ** 4)
