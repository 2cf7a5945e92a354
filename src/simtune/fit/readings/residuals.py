"""Size and autocorrelation of the residuals that a simulator leaves in readings."""

import numpy as np

HUBER = 5.0  # root mean squares: larger residuals count linearly (Huber 1964)
_CLIPPED = 3  # iterations of clipping: outliers inflate the first estimates
_SMALLEST = 1e-6


def spread(residuals: np.ndarray, unread: np.ndarray) -> np.ndarray:
    """(D,) root mean square of (W, K, D), with outliers, such as lost packets, clipped.

    Not a median, so that a simulator that is sometimes wrong in different ways still counts.
    `unread`: (D,) where there are none, NaN, such as in segments that leave a sensor out.
    """
    size = np.abs(residuals.reshape(-1, residuals.shape[-1]))
    known = np.isfinite(size)
    size, num = np.where(known, size, 0.0), known.sum(0)
    rms = np.sqrt(np.square(size).sum(0) / np.maximum(num, 1))
    for _ in range(_CLIPPED):
        rms = np.sqrt(np.square(np.minimum(size, HUBER * rms)).sum(0) / np.maximum(num, 1))
    return np.where(num, rms + _SMALLEST, unread)


def correlation_times(residuals: np.ndarray) -> np.ndarray:
    """(D,) integrated autocorrelation times, in steps, of (W, K, D) residuals; 1 for white noise.

    1 + 2 Σ ρ(l), summed until pairs of ρ get negative (initial positive sequence, Geyer 1992).
    """
    values = np.nan_to_num(residuals)
    num_steps, known = values.shape[1], np.isfinite(residuals)
    size = 2 ** int(np.ceil(np.log2(2 * num_steps)))
    power = np.abs(np.fft.rfft(values, size, axis=1)) ** 2
    pairs = np.abs(np.fft.rfft(known.astype(float), size, axis=1)) ** 2
    covariance = np.fft.irfft(power, size, axis=1).sum(0)[:num_steps]
    counts = np.maximum(np.fft.irfft(pairs, size, axis=1).sum(0)[:num_steps], 1)
    covariance = covariance / counts
    rho = covariance / np.maximum(covariance[:1], 1e-30)  # (K, D)
    even = rho[: num_steps - num_steps % 2].reshape(-1, 2, rho.shape[1]).sum(1)
    kept = np.minimum.accumulate(even > 0, axis=0)
    return np.maximum(1.0, 2 * (even * kept).sum(0) - 1)
