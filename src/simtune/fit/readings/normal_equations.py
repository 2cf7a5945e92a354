"""Normal equations of parameters and offsets from stretches whose initial states are unknown."""

import numpy as np
from scipy.special import ndtri, stdtrit

from simtune.fit.elimination import NormalEquations, eliminate
from simtune.fit.readings.residuals import HUBER
from simtune.fit.readings.slopes import StretchSlopes

_RIDGE = 1e-9  # of information


def by_shared(
    slopes: StretchSlopes, finds_offset: np.ndarray, starts_by_shared: np.ndarray
) -> np.ndarray:
    """(W, P + offsets, K + 1, D) derivatives of residuals by parameters and offsets, A_(θ, b).

    An offset shifts predictions. Initial states x̄(θ, b) that readings give follow an offset and a
    lateness; if they did not, their prior would seem to inform about both:

        dr/d(θ, b) = ∂r/∂(θ, b) + ∂r/∂x · dx̄/d(θ, b)

    `finds_offset`: (D,) bool; `starts_by_shared`: (W, P + offsets, S), see `OpenLoopReplay`, in
    units of the start's prior std.
    """
    shape, offsets = slopes.predicted.shape, np.eye(len(finds_offset))[finds_offset, None]
    by_offset = np.broadcast_to(offsets, (shape[0], len(offsets), *shape[1:]))
    direct = np.concatenate([slopes.by_parameter, by_offset], 1)
    return direct + np.einsum("wps,wskd->wpkd", starts_by_shared, slopes.by_start)


def normal_equations(
    by_start: np.ndarray,
    by_shared: np.ndarray,
    residuals: np.ndarray,
    noise: np.ndarray,
    shift: np.ndarray | float = 0.0,
) -> NormalEquations:
    """From (W, K + 1, D) residuals, NaN where nothing was read, with noise (D,).

    With A_x, A_θ the derivatives of r / σ by initial states (W, S, K + 1, D) and by what is shared
    (W, P + offsets, K + 1, D), V Huber's weights, and initial states `shift` (W, S) away from those
    that the readings give:

        H = A_x V A_xᵀ + 1    C = A_x V A_θᵀ    B = A_θ V A_θᵀ

    and `eliminate` leaves what is shared.
    """
    num = len(residuals)
    r = np.nan_to_num(residuals / noise).reshape(num, -1)
    weights = _weights(residuals, noise).reshape(num, -1)
    by_start, by_shared = (
        (derived / noise).reshape(num, derived.shape[1], r.shape[1])
        for derived in (by_start, by_shared)
    )
    weighted, shared = by_start * weights[:, None], by_shared * weights[:, None]
    hessian = weighted @ by_start.swapaxes(1, 2) + np.eye(by_start.shape[1])
    cross = weighted @ by_shared.swapaxes(1, 2)
    gradient = (weighted @ r[..., None])[..., 0] + shift
    direct, direct_gradient = shared @ by_shared.swapaxes(1, 2), (shared @ r[..., None])[..., 0]
    return eliminate(hessian, cross, gradient, direct, direct_gradient)


def explained_by_starts(
    by_start: np.ndarray, residuals: np.ndarray, noise: np.ndarray
) -> np.ndarray:
    """(D,) degrees of freedom of each reading that initial states take: tr(H⁻¹ A_x V A_xᵀ).

    Up to one for each unknown of a stretch, less what its prior tells. `noise`: (D,) with which
    each residual counts fully. Else see `normal_equations`.
    """
    derived = by_start / noise  # (W, S, K + 1, D)
    weighted = derived * _weights(residuals, noise)[:, None]
    by_reading = np.einsum("wskd,wtkd->wdst", weighted, derived)
    hessian = by_reading.sum(1, keepdims=True) + np.eye(by_start.shape[1])
    return np.linalg.solve(hessian, by_reading).trace(axis1=-2, axis2=-1).sum(0)


def _weights(residuals: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Huber's, like the residuals; 0 where nothing was read."""
    r = residuals / noise
    return np.isfinite(r) * np.minimum(1, HUBER / np.maximum(np.abs(np.nan_to_num(r)), 1e-12))


def jackknife(by_group: np.ndarray, gradients: np.ndarray, information: np.ndarray) -> np.ndarray:
    """(P + offsets,) standard deviations, by leaving out each group in turn (Tukey 1958).

    Each takes one Newton step from the full solution: θ₍₋g₎ − θ = (I − I_g)⁻¹ b_g, of (G, P, P)
    information and (G, P) gradients. This captures differences between episodes, such as the load
    in the hand. A single group shows none: 0. `information`: of all, with the prior.
    """
    if len(by_group) == 1:
        return np.zeros(len(information))
    # Without the only group in which a sensor was read its offset is unknown: a ridge.
    ridge = _RIDGE * np.diag(np.diag(information))
    left = information - by_group + ridge  # (G, P, P)
    return jackknife_std(np.linalg.solve(left, gradients[..., None])[..., 0])


def jackknife_std(moved: np.ndarray) -> np.ndarray:
    """(P,) standard deviations from (K, P) changes where each of K parts is left out in turn.

    With few parts they are uncertain themselves, so 90 % intervals are as wide as Student's t.
    """
    num = len(moved)
    unsure = stdtrit(max(num - 1, 1), 0.95) / ndtri(0.95)
    return unsure * np.sqrt((num - 1) / num * np.square(moved - moved.mean(0)).sum(0))
