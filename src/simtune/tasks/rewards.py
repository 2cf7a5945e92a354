"""Soft indicator functions: 1 within bounds, falling off outside.

The mathematics of dm_control.utils.rewards (Tassa et al. 2018, arXiv:1801.00690, Sec. 4).
"""

import numpy as np


def tolerance(
    x: np.ndarray,
    *,
    low: float = 0.0,
    high: float = 0.0,
    margin: float,
    value_at_margin: float = 0.1,
    shape: str = "gaussian",
) -> np.ndarray:
    """1 where low <= x <= high, `value_at_margin` at a distance of `margin` from there.

    `shape` is how it falls: "gaussian", or "linear" or "quadratic" down to 0.
    """
    distance = np.maximum(np.maximum(low - x, x - high), 0) / margin
    if shape == "gaussian":
        return value_at_margin ** (distance**2)
    if shape == "linear":
        return np.maximum(1 - (1 - value_at_margin) * distance, 0)
    if shape == "quadratic":
        return np.maximum(1 - (1 - value_at_margin) * distance**2, 0)
    raise ValueError(f"shape must be 'gaussian', 'linear' or 'quadratic', got {shape!r}")
