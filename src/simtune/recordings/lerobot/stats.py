"""Statistics of a LeRobotDataset's features, for each episode and for the dataset."""

from collections.abc import Iterable
from typing import Any

import numpy as np

_QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}


def column_stats(values: np.ndarray) -> dict[str, Any]:
    """Statistics of a column (rows,) or (rows, A), as lists of A numbers.

    Min and max of integers stay integers. Numbers that are not finite are ignored; if none is
    finite, all statistics are 0.
    """
    by_number = [_number_stats(column) for column in values.reshape(len(values), -1).T]
    stats = {name: [found[name] for found in by_number] for name in by_number[0]}
    return {**stats, "count": [len(values)]}


def _number_stats(values: np.ndarray) -> dict[str, float]:
    """Statistics of `values` (rows,)."""
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
    # Histograms of 8-bit values are exact, and those of episodes can be summed.
    counts = np.zeros((3, 256), np.int64)
    for frame in frames:
        for channel in range(3):
            counts[channel] += np.bincount(frame[..., channel].ravel(), minlength=256)
    return counts


def image_stats(counts: np.ndarray, num_frames: int) -> dict[str, Any]:
    """Statistics of pictures from their histogram (3, 256), as (3, 1, 1) lists in [0, 1]."""
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
