"""A film's edges, whatever the colours and the light on both sides."""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d

from simtune.camera_pose.robot import Outlines

_SIGMA_PX = 1.0  # of the derivative filter
_STATIC_EDGE_WEIGHT = 0.02  # of an edge that is also in the picture without the robot
_MIN_EDGE_CONTRAST = 0.06  # of the full scale per pixel


class Across(NamedTuple):
    """Edges on lines across outlines, at S places of each of N lines."""

    strength: np.ndarray  # (N, S) of the full scale per pixel
    direction_match: np.ndarray  # (N, S) 0 to 1: how well an edge has the line's direction


class EdgeFilm:
    """M frames as structure tensors, summed over their colours (Di Zenzo 1986).

    A moving edge is in the frame, and in its difference from the picture without the robot; the
    weaker slope counts. So neither the background nor what the robot hides is an edge.
    """

    def __init__(self, frames: np.ndarray, plate: np.ndarray | None):
        """(M, H, W, 3) uint8 frames; `plate`: (H, W, 3) background, if there is one."""
        self.num, self.size = len(frames), frames.shape[1:3]
        slopes = _slopes(frames)
        self._tensors = [_tensor(*slopes)]
        if plate is not None:
            still = _slopes(plate[None])
            self._tensors.append(_tensor(*(a - b for a, b in zip(slopes, still, strict=True))))

    def moving(self) -> np.ndarray:
        """(M, H, W) bool: on clear edges of moving things."""
        squared = np.min([tensor[..., 0] + tensor[..., 2] for tensor in self._tensors], 0)
        return squared > _MIN_EDGE_CONTRAST**2

    def across(self, outlines: Outlines, pixels: np.ndarray, steps: np.ndarray) -> Across:
        """On lines through N points of outlines, now at (N, 2) pixels, (S,) `steps` along normals.

        If an outline stands still, so do its edges: they count by its share of such frames.
        """
        frames, normals = outlines.frames, outlines.normals
        height, width = self.size
        at = pixels[:, None] + normals[:, None] * steps[:, None]
        inside = ((at >= 0) & (at <= [width - 1.001, height - 1.001])).all(-1)
        at = at.clip(0, [width - 1.001, height - 1.001]).astype(np.float32)
        corner = at.astype(int)
        share = at - corner
        first = (frames[:, None] * height + corner[..., 1]) * width + corner[..., 0]
        found = [_along(_between(tensor, first, share, width), normals) for tensor in self._tensors]
        squared, match = found[0]
        if len(found) > 1:
            match = np.where(found[1][0] < squared, found[1][1], match)
            still = np.maximum(outlines.still, _STATIC_EDGE_WEIGHT)[:, None]
            squared = np.minimum(squared, found[1][0]) + still * squared
        return Across(np.sqrt(squared * inside), match)


def _slopes(pictures: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(M, H, W, 3) each: to the right, and down."""
    shades = pictures.astype(np.float32) / 255
    right, down = (
        gaussian_filter1d(gaussian_filter1d(shades, _SIGMA_PX, 3 - axis), _SIGMA_PX, axis, order=1)
        for axis in (2, 1)
    )
    return right, down


def _tensor(right: np.ndarray, down: np.ndarray) -> np.ndarray:
    """(M, H, W, 3): xx, xy and yy."""
    products = ((right, right), (right, down), (down, down))
    return np.stack([np.einsum("...c,...c", a, b) for a, b in products], -1)


def _between(tensors: np.ndarray, first: np.ndarray, share: np.ndarray, width: int) -> np.ndarray:
    """(N, S, 3) bilinear, between pixels of which the first one's index is given."""
    flat, (x, y) = tensors.reshape(-1, 3), np.moveaxis(share[..., None], 2, 0)
    above = flat[first] * (1 - x) + flat[first + 1] * x
    below = flat[first + width] * (1 - x) + flat[first + width + 1] * x
    return above * (1 - y) + below * y


def _along(tensors: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N, S) squared slopes along normals, and their shares of all squared slopes."""
    (xx, xy, yy), (x, y) = np.moveaxis(tensors, -1, 0), normals.T[..., None].astype(np.float32)
    squared = np.maximum(xx * x * x + 2 * xy * x * y + yy * y * y, 0)
    return squared, squared / (xx + yy + 1e-9)
