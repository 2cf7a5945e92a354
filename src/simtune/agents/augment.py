"""Crops of stacked frames, on their own device, without waiting for the host.

All frames of a stack move together, or the motion between them would be lost. Each stack's offset
is drawn uniformly from a generator of the frames' device.
"""

import torch


def random_crop(frames: torch.Tensor, size: int, generator: torch.Generator) -> torch.Tensor:
    """(B, K, H, W, 3) uint8 to (B, K, size, size, 3), cut out at random places (RAD)."""
    _check(frames, size)
    top, left = (
        torch.randint(side - size + 1, frames.shape[:1], generator=generator, device=frames.device)
        for side in frames.shape[2:4]
    )
    return crop(frames, top, left, size)


def centre_crop(frames: torch.Tensor, size: int) -> torch.Tensor:
    """(B, K, H, W, 3) to (B, K, size, size, 3), a view: what an agent sees when it acts."""
    _check(frames, size)
    top, left = ((side - size) // 2 for side in frames.shape[2:4])
    return frames[:, :, top : top + size, left : left + size]


def crop(frames: torch.Tensor, top: torch.Tensor, left: torch.Tensor, size: int) -> torch.Tensor:
    """(B, K, H, W, 3) uint8 and (B,) corners to (B, K, size, size, 3).

    A crop's rows are contiguous in memory and are gathered as such: on a CPU a hundred times as
    fast as indexing pixels. The stacks may overlap in memory, as those of a replay do.
    """
    batch, num_stacked, height, width, channels = frames.shape
    if frames.stride()[2:] != (width * channels, channels, 1):
        frames = frames.contiguous()
    of_stack, of_frame, of_row, of_pixel, _ = frames.stride()
    stack, frame, row = (
        torch.arange(end, device=frames.device) * stride
        for end, stride in ((batch, of_stack), (num_stacked, of_frame), (size, of_row))
    )
    corner = stack + top * of_row + left * of_pixel  # (B,)
    start = corner[:, None, None] + frame[:, None] + row  # (B, K, size)
    run = size * channels
    span = (batch - 1) * of_stack + (num_stacked - 1) * of_frame + height * of_row
    runs = frames.as_strided((span - run + 1, run), (1, 1))  # a run beginning at each index
    return runs.index_select(0, start.flatten()).view(batch, num_stacked, size, size, channels)


def _check(frames: torch.Tensor, size: int) -> None:
    height, width = frames.shape[2:4]
    if size > min(height, width):
        raise ValueError(f"frames of {height} × {width} pixels have no crop of {size}")
