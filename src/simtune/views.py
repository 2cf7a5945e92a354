"""What a picture shows: the views of one camera or several, equally high, side by side."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np


@dataclass(frozen=True)
class View:
    """What one camera shows."""

    camera: str  # the model's
    aspect: float = 1.0  # width over height
    # (H, W, 3) uint8 behind what moves, in place of what the model has there; see `Footage.plate`
    plate: np.ndarray | None = None

    def width(self, height: int) -> int:
        """Pixels."""
        return width_of(self.aspect, height)


def width_of(aspect: float, height: int) -> int:
    """Pixels of a view; what is left of one more is not shown."""
    return max(1, int(aspect * height + 1e-6))


def parts(widths: Sequence[int]) -> list[slice]:
    """The columns of each view."""
    ends = [0, *accumulate(widths)]
    return [slice(*both) for both in pairwise(ends)]


def apart(frames: np.ndarray, widths: Sequence[int]) -> list[np.ndarray]:
    """(..., H, W₁ + W₂ + …, 3) frames as each view's own (..., H, W, 3), which are no copies."""
    return [frames[..., columns, :] for columns in parts(widths)]
