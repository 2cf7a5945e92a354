"""Ways in which a film's framing may differ from the simulator's pictures."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Framing:
    """A change of framing: how to reverse it, and a description."""

    says: str  # "the film looks ..."
    # (2, 3): maps a point of the simulator's picture to that of the film; −1 (left, top) to 1
    matrix: np.ndarray

    @property
    def is_mirrored(self) -> bool:
        """Whether no turn of the camera reverses it."""
        return bool(np.linalg.det(self.matrix[:, :2]) < 0)

    @property
    def is_on_its_side(self) -> bool:
        """Whether what is wide looks high."""
        return not self.matrix[0, 0]

    def undo(self, frames: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(..., H, W, 3) uint8 frames as the simulator's camera would see them, and (H, W) bool.

        The latter is where the film shows anything. Bilinear; elsewhere edges are repeated.
        """
        height, width = frames.shape[-3:-1]
        x, y = ((np.arange(n) + 0.5) * 2 / n - 1 for n in (width, height))
        points = np.stack([*np.meshgrid(x, y), np.ones((height, width))])
        at = np.tensordot(self.matrix, points, 1)
        seen = np.logical_and(*(np.abs(at) <= 1))
        column = ((at[0] + 1) / 2 * width - 0.5).clip(0, width - 1)
        row = ((at[1] + 1) / 2 * height - 0.5).clip(0, height - 1)
        left, top = (np.minimum(i.astype(int), n - 2) for i, n in ((column, width), (row, height)))
        right, down = (part[..., None].astype(np.float32) for part in (column - left, row - top))
        upper, lower = (
            frames[..., t, left, :] * (1 - right) + frames[..., t, left + 1, :] * right
            for t in (top, top + 1)
        )
        return np.rint(upper * (1 - down) + lower * down).astype(np.uint8), seen


def _framing(says: str, x: float = 1, y: float = 1, right: float = 0, down: float = 0) -> Framing:
    """Scaled by `x` and `y`, then shifted by shares of the width and the height."""
    return Framing(says, np.array([[x, 0, 2 * right], [0, y, 2 * down]], float))


def _zoomed(by: float) -> Framing:
    """Things look `by` times as large."""
    if by > 1:
        return _framing(f"enlarged {by:.3g} times: its field of view is narrower", by, by)
    return _framing(f"reduced {1 / by:.3g} times: its field of view is wider", by, by)


def _stretched(by: float) -> list[Framing]:
    """Things look `by` times as wide, or as high."""
    does, times = ("stretched", by) if by > 1 else ("squeezed", 1 / by)
    return [
        _framing(f"{does} horizontally by {times:.3g}", x=by),
        _framing(f"{does} vertically by {times:.3g}", y=by),
    ]


def _shifted(by: float) -> list[Framing]:
    """Things are shifted by this share of the picture's width or height."""
    return [
        _framing(f"shifted to the right by {by:g} of its width", right=by),
        _framing(f"shifted to the left by {by:g} of its width", right=-by),
        _framing(f"shifted down by {by:g} of its height", down=by),
        _framing(f"shifted up by {by:g} of its height", down=-by),
    ]


AS_IT_IS = _framing("as it should")
MIRRORED = _framing("mirrored left to right", x=-1)
_TOLD_ALONE = (  # by pictures, without readings
    MIRRORED,
    _framing("mirrored top to bottom", y=-1),
    _framing("upside down", x=-1, y=-1),
    Framing("turned by 90° counterclockwise", np.array([[0, 1, 0], [-1, 0, 0]], float)),
    Framing("turned by 90° clockwise", np.array([[0, -1, 0], [1, 0, 0]], float)),
)
# All ways to turn or mirror a square, but for leaving it as it is
TURNS = (
    *_TOLD_ALONE,
    Framing("mirrored, and turned by 90°", np.array([[0, 1, 0], [1, 0, 0]], float)),
    Framing("mirrored, and turned by 90°", np.array([[0, -1, 0], [-1, 0, 0]], float)),
)
# Framings that are recognised. Smaller changes cannot be told from a difference of renderers; 1.33
# results from 4:3 in a square, 1.78 from 16:9.
FRAMINGS = (
    *_TOLD_ALONE,
    *(_zoomed(by) for by in (1 / 1.5, 1 / 1.3, 1 / 1.15, 1.15, 1.3, 1.5)),
    *(framing for by in (9 / 16, 3 / 4, 1 / 1.15, 1.15, 4 / 3) for framing in _stretched(by)),
    *_shifted(0.1),
    *_shifted(0.2),
)
