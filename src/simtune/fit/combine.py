"""Many small experiments to one estimate: a random-effects meta-analysis.

Windows of a motion, or pictures, each tell something of the same parameters, and disagree by more
than their own noise explains: a detector's errors go with each other, contacts are not smooth. So
each counts by the variance of its own estimate plus the variance between them (DerSimonian and
Laird 1986). This also keeps a single chaotic window from outweighing all others.
"""

from dataclasses import dataclass

import numpy as np

_STUDENT = 4.0  # degrees of freedom by which experiments that stand out count less
_SMALLEST_VARIANCE, _LARGEST_VARIANCE = 4e-3**2, 0.08**2  # between experiments
FIRST_VARIANCE = 0.02**2
_VARIANCE_STEP, _FEWEST_INFORMATIVE = 1.5, 4  # by which it follows what they show
_CHI2_MEDIAN = 0.6  # over its degrees of freedom, or near it, for a few of them
COMMON_STD = 0.1  # of errors that all have in common, as these unknowns have them
_NOTHING = np.zeros(0)
_RIDGE = 1e-6  # of information: what nothing is known of can still be inverted
# Of steps (Levenberg, 1944): each moves as if parameters were known within a tenth of their range.
_DAMPING = 0.1**-2


@dataclass(frozen=True)
class Combined:
    """What experiments say together of P parameters' unit coordinates, and Q common errors."""

    slope: np.ndarray  # (P + Q,) of −log likelihood
    information: np.ndarray  # (P + Q, P + Q) its second derivative
    covariance: np.ndarray  # (P, P) of the parameters, whatever errors are in common
    variance: float  # between experiments

    def step(self, unit: np.ndarray, largest: float) -> np.ndarray:
        """(P + Q,) damped Newton step from (P,) `unit`, which moves by no more than `largest`."""
        damped = self.information + _DAMPING * np.eye(len(self.slope))
        return step_within_bounds(damped, self.slope, unit, largest)


def step_within_bounds(
    damped: np.ndarray, slope: np.ndarray, unit: np.ndarray, largest: float
) -> np.ndarray:
    """(P + Q,) that of `newton_within`, shortened so that no unit coordinate moves farther."""
    change = newton_within(damped, slope, unit, (0.0, 1.0))
    return change * (largest / np.abs(change[: len(unit)]).max(initial=largest))


def newton_within(
    hessian: np.ndarray, slope: np.ndarray, unit: np.ndarray, bounds: tuple[float, float]
) -> np.ndarray:
    """(P + Q,) Newton step of P unit coordinates; Q others come after them, without bounds.

    What stands at a bound, or beyond, and is drawn farther stays there, and the others step as is
    best then. Others may end beyond.
    """
    (low, high), num, free = bounds, len(unit), np.ones(len(slope), bool)
    while True:
        change = np.zeros(len(slope))
        change[free] = -np.linalg.solve(hessian[np.ix_(free, free)], slope[free])
        its = change[:num]
        beyond = (unit <= low) & (its < 0) | (unit >= high) & (its > 0)
        if not beyond.any():
            return change
        free[:num] &= ~beyond


def combine(
    information: np.ndarray,
    slope: np.ndarray,
    variance: float,
    trust: np.ndarray,
    common: np.ndarray = _NOTHING,
) -> Combined:
    """What W experiments say together of P parameters, and of Q errors that they have in common.

    `information` I (W, P, P) and `slope` g (W, P) are the second and first derivatives of each
    one's −log likelihood, `variance` τ² is that between them, `trust` (W,) how much each counts.
    Experiment w alone would estimate −I_w⁻¹ g_w, with variance I_w⁻¹ + τ². So, with weights c_w
    that are Student's,

        information = Σ_w c_w I_w (1 + τ² I_w)⁻¹      slope = Σ_w c_w (1 + τ² I_w)⁻ᵀ g_w

    The covariance is the robust one, from how the experiments scatter (White 1980); what they
    claim to know counts where they are few. The variance of the result is nearer to what they
    show.

    Of `common`, (Q,) values whose slopes come last, each is normal with standard deviation
    COMMON_STD, the same in all experiments (τ = 0). Their prior is one more experiment.
    """
    num, size = slope.shape[1] - len(common), slope.shape[1]
    if not num:
        return Combined(np.zeros(size), np.eye(size), np.zeros((0, 0)), variance)
    eye, is_parameter = np.eye(size), np.arange(size) < num
    between = variance * is_parameter  # (P + Q,)
    prior = np.where(is_parameter, 0.0, COMMON_STD**-2)
    surprise = _surprise(information[:, :num, :num], slope[:, :num], variance)
    count = trust * (_STUDENT + 1) / (_STUDENT + surprise)  # (W,)
    shrink = np.linalg.inv(eye + between[:, None] * information)  # (W, P + Q, P + Q)
    weighted = count[:, None, None] * (information @ shrink)
    slopes = count[:, None] * np.einsum("wqp,wq->wp", shrink, slope)
    total = slopes.sum(0) + prior * np.concatenate([np.zeros(num), common])
    whole = weighted.sum(0) + np.diag(prior)
    inverse = np.linalg.inv(whole + _RIDGE * eye)
    deviations = slopes - weighted @ (inverse @ total)
    # What is found from data takes freedom from them: of common errors, as far as data say more
    # of these than their prior does.
    found = num + len(common) - (prior * np.diag(inverse)).sum()
    freedom = max(0.0, len(slope) - found)
    few = len(slope) / max(1, freedom)
    scatter = few * deviations.T @ deviations + np.diag(prior)
    covariance = inverse @ scatter @ inverse + _RIDGE * inverse
    # One alone scatters by nothing; it is no surer than it claims.
    claimed = np.einsum("w,wpq->pq", count, information) + np.diag(prior) + _RIDGE * eye
    covariance += np.linalg.inv(claimed) / (1 + freedom)
    informative = np.trace(information[:, :num, :num], axis1=1, axis2=2) * variance > 1
    if informative.sum() >= _FEWEST_INFORMATIVE:
        too_small = np.median(surprise[informative]) > _CHI2_MEDIAN
        variance *= _VARIANCE_STEP if too_small else 1 / _VARIANCE_STEP
    variance = float(np.clip(variance, _SMALLEST_VARIANCE, _LARGEST_VARIANCE))
    return Combined(total, whole, covariance[:num, :num], variance)


def _surprise(information: np.ndarray, slope: np.ndarray, variance: float) -> np.ndarray:
    """(W,) squares of what estimates are off, a parameter, by what experiments and τ allow."""
    spread = information + variance * information @ information
    # One that knows only a combination, and that very well, leaves no number to divide by else.
    ridge = 1e-9 + 1e-12 * np.trace(spread, axis1=1, axis2=2)
    spread += ridge[:, None, None] * np.eye(slope.shape[1])
    solved = np.linalg.solve(spread, slope[..., None])[..., 0]
    return np.einsum("wp,wp->w", slope, solved) / slope.shape[1]


def robust_weights(cost: np.ndarray) -> np.ndarray:
    """(W,) how much experiments of such costs count: little, if far worse explained than others.

    Compared with the better half: the worse one may be lost altogether.
    """
    low, middle = np.quantile(cost, [0.25, 0.5])
    return 1 / (1 + np.maximum(0, (cost - low) / (3 * (middle - low) + 1e-9)) ** 4)
