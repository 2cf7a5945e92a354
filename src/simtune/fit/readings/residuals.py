"""Size and autocorrelation of the residuals that a simulator leaves in readings."""

import numpy as np

from simtune.fit.readings.readings import is_within

HUBER = 5.0  # root mean squares: larger residuals count linearly (Huber 1964)
_CLIPPING_ITERATIONS = 3  # outliers inflate the first estimates
_ADDED_RMS = 1e-6


def spread(residuals: np.ndarray, unread: np.ndarray) -> np.ndarray:
    """(D,) root mean square of (W, K, D), with outliers, such as lost packets, clipped.

    Not a median, so that a simulator that is sometimes wrong in different ways still counts.
    `unread`: (D,) where there are none, NaN, such as in segments that leave a sensor out.
    """
    size = np.abs(residuals.reshape(-1, residuals.shape[-1]))
    known = np.isfinite(size)
    size, num = np.where(known, size, 0.0), known.sum(0)
    rms = np.sqrt(np.square(size).sum(0) / np.maximum(num, 1))
    for _ in range(_CLIPPING_ITERATIONS):
        rms = np.sqrt(np.square(np.minimum(size, HUBER * rms)).sum(0) / np.maximum(num, 1))
    return np.where(num, rms + _ADDED_RMS, unread)


def correlation_times(residuals: np.ndarray) -> np.ndarray:
    """(D,) integrated autocorrelation times, in readings, of (W, K, D) residuals; 1: white noise.

    1 + 2 Σ ρ(l), summed until pairs of ρ get negative (initial positive sequence, Geyer 1992). Rows
    may lack readings: a lag l counts by how many readings have another one l rows later.
    """
    values, known = np.nan_to_num(residuals), np.isfinite(residuals)
    within = is_within(residuals)
    # (K, D); as one knows the mean, zero, a row without a reading adds nothing
    covariance = _lagged_products(values) / np.maximum(_lagged_products(within.astype(float)), 1)
    rho = covariance / np.maximum(covariance[:1], 1e-30)
    apart = np.rint(within.sum((0, 1)) / np.maximum(known.sum((0, 1)), 1))  # rows
    pairs = zip(rho.T, np.maximum(2 * apart, 2).astype(int), strict=True)
    return np.array([_geyer_sum(its, rows) for its, rows in pairs])


def _lagged_products(values: np.ndarray) -> np.ndarray:
    """(K, D) sums, over rows that lie k apart, of products of (W, K, D)."""
    num_rows = values.shape[1]
    size = 2 ** int(np.ceil(np.log2(2 * num_rows)))
    power = np.abs(np.fft.rfft(values, size, axis=1)) ** 2
    return np.fft.irfft(power, size, axis=1).sum(0)[:num_rows]


def _geyer_sum(rho: np.ndarray, pair: int) -> float:
    """1 + 2 Σ ρ of (K,) lags, the first 1, by sums over `pair` rows: about two readings."""
    pairs = rho[: len(rho) - len(rho) % pair].reshape(-1, pair).sum(1)
    kept = np.minimum.accumulate(pairs > 0)
    return max(1.0, 2 * float((pairs * kept).sum()) - 1)
