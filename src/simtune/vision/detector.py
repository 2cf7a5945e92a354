"""The keypoint detector: a small convolutional network for single pictures.

It finds the keypoints and estimates the parameters that a picture shows (colours, light, camera).
It is trained on single frames, for which the simulator gives the true state for free: this is most
of the work of estimating parameters from pixels, and needs no sequences.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import nn
from torch.nn import functional as F

from simtune.cameras.pictures import pictures_at_once
from simtune.networks.layers import autocast, mlp
from simtune.vision.detections import Detections

_CPU = torch.device("cpu")
_STRIDE = 2  # pixels per cell of the heatmaps
_NEAR_CELLS = 2  # a keypoint's position is an average over cells this near to the peak


@dataclass(frozen=True, kw_only=True)
class DetectorConfig:
    channels: int = 16
    free_maps: int = 8  # attention maps beside the keypoints', for colours of static things
    reads_rows: bool = False  # the mean of each row, too: where a ground ends, hence its height
    uses_bfloat16: bool = False  # for features, on a CPU that is faster with it
    hidden: int = 128
    batch_size: int = 32
    learning_rate: float = 5e-3
    noise: float = 0.01  # of the full scale: camera noise, video compression


class KeypointDetector(nn.Module):
    """(B, H, W, 3) uint8 pictures to keypoints (B, L, 2) in pixels and visible parameters (B, V).

    Attention maps at half resolution; each gives a position and the picture's colour there. The
    keypoints' maps are trained by cross-entropy on the true cell, which takes a few hundred
    updates, where regression through the maps takes thousands.
    """

    grid: torch.Tensor  # (cells, 2) x, y in pixels

    def __init__(
        self, num_keypoints: int, num_visible: int, shape: tuple[int, int], config: DetectorConfig
    ):
        """`shape`: (height, width) of the pictures."""
        super().__init__()
        c, self.num_keypoints = config.channels, num_keypoints
        num_maps = num_keypoints + config.free_maps
        self.fine = nn.ModuleList([nn.Conv2d(3, c, 5, _STRIDE, 2), nn.Conv2d(c, c, 3, 1, 1)])
        self.middle = nn.ModuleList(
            [nn.Conv2d(c, 2 * c, 3, 2, 1), nn.Conv2d(2 * c, 2 * c, 3, 1, 1)]
        )
        self.coarse = nn.ModuleList(
            [nn.Conv2d(2 * c, 2 * c, 3, 2, 1), nn.Conv2d(2 * c, 2 * c, 3, 1, 1)]
        )
        self.to_middle, self.to_fine = nn.Conv2d(2 * c, 2 * c, 1), nn.Conv2d(2 * c, c, 1)
        self.mix = nn.Conv2d(c, c, 3, 1, 1)
        self.maps = nn.Conv2d(c, num_maps, 1)
        self.cells = -(-shape[0] // _STRIDE), -(-shape[1] // _STRIDE)  # rows and columns
        self._reads_rows, self._uses_bfloat16 = config.reads_rows, config.uses_bfloat16
        num_read = num_maps * 5 + 2 * c + (c * self.cells[0] if config.reads_rows else 0)
        sizes = (num_read, config.hidden, config.hidden, num_visible)
        self.head = mlp(sizes, nn.ELU) if num_visible else None
        y, x = (torch.arange(cells) * _STRIDE + (_STRIDE - 1) / 2 for cells in self.cells)
        grid = torch.stack(torch.meshgrid(x, y, indexing="xy"), -1).reshape(-1, 2)
        self.register_buffer("grid", grid, persistent=False)

    def forward(self, pictures: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(B, 3, H, W) in [-1, 1] to heatmap logits (B, L, cells) and visible parameters."""
        with autocast(_CPU, self._uses_bfloat16):  # no matter on a GPU
            fine, coarse = (features.float() for features in self._features(pictures))
        logits = self.maps(fine).flatten(2).contiguous()  # (B, maps, cells)
        heatmaps = logits[:, : self.num_keypoints]
        if self.head is None:
            return heatmaps, logits.new_empty(len(pictures), 0)
        colours = F.avg_pool2d(pictures, _STRIDE, ceil_mode=True).flatten(2).transpose(1, 2)
        place = (self.grid / self.grid.amax(0) * 2 - 1).expand(len(pictures), -1, -1)
        read = torch.bmm(logits.softmax(-1), torch.cat([place, colours], -1)).flatten(1)
        # Pooled, since the gradient of `mean` is not channels last, and slows what precedes it.
        rows = [F.avg_pool2d(fine, (1, self.cells[1])).flatten(1)] if self._reads_rows else []
        whole = F.avg_pool2d(coarse, coarse.shape[-2:]).flatten(1)
        visible = self.head(torch.cat([read, whole, *rows], -1))
        return heatmaps, visible

    def _features(self, pictures: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """A small U-net: (B, c, rows, columns) fine and (B, 2c, ...) coarse features."""
        fine = F.relu_(self.fine[0](pictures))
        fine = F.relu_(self.fine[1](fine)) + fine
        middle = F.relu_(self.middle[0](fine))
        middle = F.relu_(self.middle[1](middle)) + middle
        coarse = F.relu_(self.coarse[0](middle))
        coarse = F.relu_(self.coarse[1](coarse)) + coarse
        middle = middle + F.interpolate(self.to_middle(coarse), size=middle.shape[-2:])
        fine = fine + F.interpolate(self.to_fine(middle), size=fine.shape[-2:])
        return F.relu_(self.mix(fine)) + fine, coarse

    def _mean_place(self, cells: torch.Tensor, near: torch.Tensor) -> torch.Tensor:
        """(..., 2) mean position around a peak, finer than a cell; see `_near_peak`."""
        return (near.softmax(-1)[..., None] * self.grid[cells]).sum(-2)

    def candidates(self, heatmaps: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """(B, 2, L, 2) the two most probable places of each keypoint, their probability and spread.

        Two, since similar things (left and right) get confused: then one of the two is right.
        Probabilities are (B, 2, L), spreads (B, 2, L, 2) pixels.
        """
        cells, near = self._near_peak(heatmaps)
        others, others_near = self._near_peak(heatmaps.scatter(-1, cells, -torch.inf))
        cells, near = torch.stack([cells, others], 1), torch.stack([near, others_near], 1)
        everywhere = heatmaps.logsumexp(-1)[:, None]
        probability = (near.logsumexp(-1) - everywhere).exp()
        places = self._mean_place(cells, near)
        return places, probability, self._spread(places, cells, near)

    def _spread(self, mean: torch.Tensor, cells: torch.Tensor, near: torch.Tensor) -> torch.Tensor:
        """(..., 2) standard deviation of heatmaps around a peak, in excess of a sharp one's.

        A point between cells is trained as weights of the four around it, which have a spread.
        """
        part = (mean - self.grid[0]) / _STRIDE % 1
        sharp = _STRIDE**2 * part * (1 - part)
        away = self.grid[cells] - mean[..., None, :]
        variance = (near.softmax(-1)[..., None] * away.square()).sum(-2)
        return (variance - sharp).clamp(min=0).sqrt()

    def _near_peak(self, heatmaps: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Cells (B, L, 25) at most `_NEAR_CELLS` rows and columns from the peak, and their logits.

        Those outside of the picture have a logit of −∞.
        """
        (rows, columns), whole = self.cells, heatmaps.unflatten(-1, self.cells)
        row = whole.amax(-1).argmax(-1, keepdim=True)  # three times as fast as argmax of all cells
        column = whole.take_along_dim(row[..., None], -2).argmax(-1)
        steps = torch.arange(-_NEAR_CELLS, _NEAR_CELLS + 1, device=heatmaps.device)
        row, column = row + steps, column + steps
        is_row, is_column = (row >= 0) & (row < rows), (column >= 0) & (column < columns)
        row, column = row.clamp(0, rows - 1), column.clamp(0, columns - 1)
        cells = (row[..., :, None] * columns + column[..., None, :]).flatten(-2)
        is_cell = (is_row[..., :, None] & is_column[..., None, :]).flatten(-2)
        return cells, heatmaps.gather(-1, cells).masked_fill(~is_cell, -torch.inf)

    def loss(
        self,
        pictures: torch.Tensor,
        keypoints: torch.Tensor,
        visible: torch.Tensor,
        visible_width: torch.Tensor,
    ) -> torch.Tensor:
        """Mean loss of (B, 3, H, W) pictures with true (B, L, 2) keypoints, (B, V) visible.

        Visible parameters are in coordinates of the whole space; errors count relative to
        `visible_width` (V,), the width of the present search range.
        """
        heatmaps, estimated = self(pictures)
        truth = splat(keypoints, self.cells)
        zero = 0 * estimated.sum()  # a tensor, so that backward() always works
        where = -(truth * heatmaps.log_softmax(-1)).sum(-1).mean() if self.num_keypoints else zero
        found = self._mean_place(*self._near_peak(heatmaps))
        exact = F.smooth_l1_loss(found, keypoints, beta=0.5) if self.num_keypoints else zero
        error = 2 * (estimated - visible) / visible_width
        colours = (
            F.smooth_l1_loss(error, torch.zeros_like(error), beta=0.1) if error.numel() else zero
        )
        return where + 0.5 * exact + 5.0 * colours


def splat(keypoints: torch.Tensor, cells: tuple[int, int]) -> torch.Tensor:
    """(B, L, 2) pixel positions to (B, L, rows · columns) bilinear weights of four cells each."""
    rows, columns = cells
    place = ((keypoints - (_STRIDE - 1) / 2) / _STRIDE).clamp(min=0).unbind(-1)
    ends = columns - 1, rows - 1  # numbers, since a GPU would wait for a tensor of them
    place = torch.stack([at.clamp(max=end) for at, end in zip(place, ends, strict=True)], -1)
    corner = place.floor().unbind(-1)
    corner = torch.stack([at.clamp(max=end - 1) for at, end in zip(corner, ends, strict=True)], -1)
    part = place - corner
    weights = keypoints.new_zeros(*keypoints.shape[:-1], rows * columns)
    for step_x in (0, 1):
        for step_y in (0, 1):
            x, y = part[..., 0], part[..., 1]
            weight = (x if step_x else 1 - x) * (y if step_y else 1 - y)
            cell = (corner[..., 1] + step_y) * columns + corner[..., 0] + step_x
            weights.scatter_add_(-1, cell.long()[..., None], weight[..., None])
    return weights


def to_input(frames: np.ndarray | torch.Tensor) -> torch.Tensor:
    """(B, H, W, 3) uint8 to (B, 3, H, W) float in [-1, 1], channels last."""
    pictures = torch.as_tensor(frames).permute(0, 3, 1, 2).float().div_(127.5).sub_(1)
    return pictures.contiguous(memory_format=torch.channels_last)


@torch.no_grad()
def detect(detector: KeypointDetector, frames: np.ndarray) -> Detections:
    """Keypoints and visible parameters in (n, H, W, 3) frames, on the detector's device."""
    parts, device = [], detector.grid.device
    at_once = pictures_at_once(device, *frames.shape[1:3])  # more are slower on a CPU
    for part in torch.from_numpy(frames).split(at_once):
        heatmaps, estimated = detector(to_input(part.to(device)))
        places, *others = detector.candidates(heatmaps)
        parts.append((places[:, 0], places, *others, estimated))
    return Detections(*(torch.cat(part).cpu().numpy() for part in zip(*parts, strict=True)))
