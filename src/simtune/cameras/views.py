"""The views of one or several cameras, equally high and side by side, in a picture."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np


@dataclass(frozen=True)
class View:
    """What one camera shows."""

    camera: str  # of the model
    aspect: float = 1.0  # width over height
    # (H, W, 3) uint8 background in place of the model's; see `Footage.plate`
    plate: np.ndarray | None = None
    # Whether what is behind the things that move is unknown; see `Backdrops`
    background_is_unknown: bool = False

    def width(self, height: int) -> int:
        """Pixels."""
        return width_of(self.aspect, height)


def width_of(aspect: float, height: int) -> int:
    """Width of a view in pixels, rounded down."""
    return max(1, int(aspect * height + 1e-6))


def parts(widths: Sequence[int]) -> list[slice]:
    """The columns of each view."""
    ends = [0, *accumulate(widths)]
    return [slice(*both) for both in pairwise(ends)]


def apart(frames: np.ndarray, widths: Sequence[int]) -> list[np.ndarray]:
    """(..., H, W₁ + W₂ + …, 3) frames as each view's own (..., H, W, 3), without copying."""
    return [frames[..., columns, :] for columns in parts(widths)]
