"""The encoder of pixels that agents and the paper's model share, for CPUs and for GPUs."""

from typing import Any, cast

import torch
from torch import nn
from torch.nn import functional

NUM_FEATURES = 50  # of a stack, as in CURL
_CPU_SLICE = 32  # stacks whose intermediate results fit in a cache, and in reused memory
_CROP_SHARE = 0.84  # of a picture's side: the paper's 84 pixels of 100
_ALIGNMENT = 8  # bfloat16 numbers in the 16 bytes by which a GPU's matrix units read


def crop_of(image_size: int) -> int:
    """Side of the crops of square pictures, pixels (RAD's, as in the paper's appendix)."""
    return round(_CROP_SHARE * image_size)


class PixelConvolutions(nn.Module):
    """Four 3×3 convolutions with 32 filters and strides 2, 1, 1, 1, each followed by a ReLU."""

    def __init__(self, num_channels: int, image_size: int):
        super().__init__()
        side = (image_size - 3) // 2 + 1 - 3 * 2  # without padding each further layer costs 2
        if side < 1:
            raise ValueError(f"images must be at least 15 pixels wide, got {image_size}")
        self.num_outputs = 32 * side * side
        layers: list[nn.Module] = [nn.Conv2d(num_channels, 32, 3, stride=2), nn.ReLU(inplace=True)]
        for _ in range(3):
            layers += [nn.Conv2d(32, 32, 3), nn.ReLU(inplace=True)]
        # channels_last is a fifth faster on CPUs, and suits the tensor cores of GPUs
        self.layers = nn.Sequential(*layers).to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def forward(self, frames: torch.Tensor) -> torch.Tensor:
        """(B, K, H, W, 3) uint8 to (B, num_outputs)."""
        if frames.device.type == "cpu":
            maps = torch.cat([self._in_cache(some) for some in frames.split(_CPU_SLICE)])
        else:
            maps = self._in_few_kernels(frames)
        return maps.permute(0, 2, 3, 1).flatten(1)  # as it lies in memory

    def _in_cache(self, frames: torch.Tensor) -> torch.Tensor:
        """(B, K, H, W, 3) to (B, 32, side, side), for a CPU."""
        first, *others = self.layers
        assert isinstance(first, nn.Conv2d)
        # The K frames' rows are interleaved into one tall picture, and the kernel likewise: the
        # same sums without copying, since stacking the frames takes as long as a layer.
        num_stacked = frames.shape[1]
        tall = first.weight.unflatten(1, (num_stacked, 3)).permute(0, 2, 3, 1, 4).flatten(2, 3)
        rows = frames.transpose(1, 2).contiguous().flatten(1, 2).permute(0, 3, 1, 2)
        pixels = rows.to(torch.float32, memory_format=torch.channels_last)
        # Scale to 0 to 1 by the weights, of which there are fewer than pixels.
        convolved = functional.conv2d(pixels, tall / 255, first.bias, (2 * num_stacked, 2))
        for layer in others:
            convolved = layer(convolved)
        return convolved

    def _in_few_kernels(self, frames: torch.Tensor) -> torch.Tensor:
        """The same for a GPU: aligned channels for its matrix units, a layer in one kernel."""
        kind = frames.device.type
        is_cast = torch.is_autocast_enabled(kind)
        dtype = torch.get_autocast_dtype(kind) if is_cast else torch.float32
        hidden = _aligned_stacks(frames, dtype)
        for layer in self.layers:
            if isinstance(layer, nn.Conv2d):
                weight, bias = layer.weight, cast(torch.Tensor, layer.bias)
                if layer is self.layers[0]:
                    missing = hidden.shape[1] - layer.in_channels
                    weight = functional.pad(weight / 255, (0, 0, 0, 0, 0, missing))
                weight = weight.to(dtype, memory_format=torch.channels_last)
                hidden = cast(
                    torch.Tensor, _ConvRelu.apply(hidden, weight, bias.to(dtype), layer.stride)
                )
        return hidden


def _aligned_stacks(frames: torch.Tensor, dtype: torch.dtype) -> torch.Tensor:
    """(B, K, H, W, 3) uint8 to (B, C, H, W), channels last, the first 3K of C used, others 0."""
    batch, num_stacked, height, width, _ = frames.shape
    used = 3 * num_stacked
    shape = (batch, height, width, used + -used % _ALIGNMENT)
    pixels = torch.zeros(shape, dtype=dtype, device=frames.device)
    pixels[..., :used].unflatten(-1, (num_stacked, 3)).copy_(frames.permute(0, 2, 3, 1, 4))
    return pixels.permute(0, 3, 1, 2)


class _ConvRelu(torch.autograd.Function):
    """ReLU(convolution + bias): PyTorch's own layers take three kernels, and each a pass."""

    @staticmethod
    def forward(
        ctx: Any,
        inputs: torch.Tensor,
        weight: torch.Tensor,
        bias: torch.Tensor,
        stride: tuple[int, int],
    ) -> torch.Tensor:
        if inputs.is_cuda and torch.version.hip is None:
            out = torch.cudnn_convolution_relu(inputs, weight, bias, stride, (0, 0), (1, 1), 1)
        else:
            out = functional.conv2d(inputs, weight, bias, stride).relu_()
        ctx.save_for_backward(inputs, weight, out)
        ctx.stride = stride
        return out

    @staticmethod
    def backward(ctx: Any, *grads: torch.Tensor) -> tuple[torch.Tensor | None, ...]:
        inputs, weight, out = ctx.saved_tensors
        grad = torch.ops.aten.threshold_backward(grads[0], out, 0)
        needed = [ctx.needs_input_grad[0], ctx.needs_input_grad[1], False]
        convolution = (ctx.stride, (0, 0), (1, 1), False, (0, 0), 1)
        of_inputs, of_weight, _ = torch.ops.aten.convolution_backward(
            grad, inputs, weight, None, *convolution, needed
        )
        by_channel = grad.permute(0, 2, 3, 1).reshape(-1, grad.shape[1])
        of_bias = by_channel.new_ones(1, len(by_channel)) @ by_channel  # faster than to sum
        return of_inputs, of_weight, of_bias[0], None


class AlignedLinear(nn.Linear):
    """A linear layer whose outputs are aligned on a GPU: four times as fast for 50 of them."""

    def forward(self, input: torch.Tensor) -> torch.Tensor:
        """(B, inputs) to (B, outputs)."""
        missing = -self.out_features % _ALIGNMENT
        if not input.is_cuda or not missing:
            return super().forward(input)
        weight = functional.pad(self.weight, (0, 0, 0, missing))
        outputs = functional.linear(input, weight, functional.pad(self.bias, (0, missing)))
        return outputs[:, : self.out_features]


class PixelEncoder(nn.Module):
    """The agent's encoder: stacked frames to 50 normalised features (RAD, appendix E).

    The convolutions, then a linear layer and a LayerNorm; no tanh, as in RAD's and CURL's SAC.
    """

    def __init__(self, num_channels: int, image_size: int):
        super().__init__()
        self.convolutions = PixelConvolutions(num_channels, image_size)
        self.head = feature_head(self.convolutions.num_outputs)

    def forward(self, frames: torch.Tensor) -> torch.Tensor:
        """(B, K, H, W, 3) uint8 to (B, 50) float32."""
        return self.head(self.convolutions(frames)).float()


def feature_head(num_inputs: int) -> nn.Sequential:
    """Convolutional features to a few normalised ones."""
    return nn.Sequential(AlignedLinear(num_inputs, NUM_FEATURES), nn.LayerNorm(NUM_FEATURES))
