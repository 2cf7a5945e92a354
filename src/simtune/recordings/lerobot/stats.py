"""The statistics that a LeRobotDataset carries for each feature, of an episode and of all."""

from collections.abc import Iterable
from typing import Any

import numpy as np

_QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}


def column_stats(values: np.ndarray) -> dict[str, Any]:
    """Of a column (rows,) or (rows, A), lists of A numbers; integers keep min and max whole.

    Numbers that are not finite do not count; where none is, all are 0.
    """
    each = [_number_stats(column) for column in values.reshape(len(values), -1).T]
    stats = {name: [found[name] for found in each] for name in each[0]}
    return {**stats, "count": [len(values)]}


def _number_stats(values: np.ndarray) -> dict[str, float]:
    """Of (rows,)."""
    known = values[np.isfinite(values)]
    if not len(known):
        known = np.zeros_like(values[:1])
    shares = list(_QUANTILES.values())
    quantiles = np.quantile(known.astype(float), shares).tolist()
    return {
        "min": known.min().item(),
        "max": known.max().item(),
        "mean": float(known.mean(dtype=np.float64)),
        "std": float(known.std(dtype=np.float64)),
        **dict(zip(_QUANTILES, quantiles, strict=True)),
    }


def count_colours(frames: Iterable[np.ndarray]) -> np.ndarray:
    """Histogram (3, 256) of the RGB values of frames (H, W, 3) uint8."""
    # Histograms of 8-bit values lose nothing, and those of episodes add up.
    counts = np.zeros((3, 256), np.int64)
    for frame in frames:
        for channel in range(3):
            counts[channel] += np.bincount(frame[..., channel].ravel(), minlength=256)
    return counts


def image_stats(counts: np.ndarray, num_frames: int) -> dict[str, Any]:
    """Of pictures, from their histogram (3, 256), (3, 1, 1) lists in [0, 1]."""
    values = np.arange(256) / 255
    total, cumulated = counts.sum(1), counts.cumsum(1)
    mean = counts @ values / total
    stats = {
        "min": values[(counts > 0).argmax(1)],
        "max": values[255 - (counts[:, ::-1] > 0).argmax(1)],
        "mean": mean,
        "std": np.sqrt((counts @ values**2 / total - mean**2).clip(0)),
    }
    for name, share in _QUANTILES.items():
        stats[name] = values[(cumulated >= share * total[:, None]).argmax(1)]
    lists = {name: value[:, None, None].tolist() for name, value in stats.items()}
    return {**lists, "count": [num_frames]}
