"""Common to networks: layers, the positional encoding, precision, and their checkpoints."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import cast

import torch
from torch import nn

from simtune.errors import InputError


def positional_encoding(x: torch.Tensor, octaves: int) -> torch.Tensor:
    """(..., N) values to (..., N·(2·octaves + 1)): x, sin(2ᵏπx), cos(2ᵏπx) (NeRF, Eq. 4).

    Expects values in [0, 1], where the slowest cosine is monotonic; the encoding of values in their
    own units would depend on their size.
    """
    octave = torch.arange(octaves, device=x.device, dtype=x.dtype)
    angles = x[..., None] * (torch.pi * 2**octave)
    return torch.cat([x[..., None], angles.sin(), angles.cos()], -1).flatten(-2)


class FineLinear(nn.Linear):
    """A linear layer in float32 also under autocast: bfloat16 would round a value of 300 to 2."""

    def forward(self, input: torch.Tensor) -> torch.Tensor:
        """(B, inputs) of any precision to (B, outputs) float32."""
        with torch.autocast(input.device.type, enabled=False):
            return super().forward(input.float())


def mlp(
    sizes: Sequence[int],
    activation: type[nn.Module],
    dropout: float = 0.0,
    last: type[nn.Linear] = nn.Linear,
) -> nn.Sequential:
    """Linear layers of these sizes, with activation and dropout after all but the last."""
    layers: list[nn.Module] = []
    for size_in, size_out in pairwise(sizes[:-1]):
        layers += [nn.Linear(size_in, size_out), activation()]
        layers += [nn.Dropout(dropout)] if dropout else []
    return nn.Sequential(*layers, last(sizes[-2], sizes[-1]))


class Standardizer(nn.Module):
    """Makes (..., D) inputs of a network have about mean 0 and standard deviation 1."""

    mean: torch.Tensor
    std: torch.Tensor

    def __init__(self, size: int, added_std: float):
        """`added_std`: to that of the inputs, so that what hardly changes does not grow large."""
        super().__init__()
        self._added_std = added_std
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("std", torch.ones(size))

    def fit(self, inputs: torch.Tensor) -> None:
        """Standardise from now on by the mean and standard deviation of these (B, D)."""
        self.mean.copy_(inputs.mean(0))
        self.std.copy_(inputs.std(0) + self._added_std)

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """(..., D) standardised, within ±10."""
        return ((inputs - self.mean) / self.std).clamp(-10, 10)


def has_fast_bf16(device: torch.device) -> bool:
    """Whether bfloat16 is faster than float32 there: on CPUs, if they multiply in it."""
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    on_cpu = torch.cpu._is_avx512_bf16_supported() or torch.cpu._is_amx_tile_supported()
    return device.type == "cpu" and on_cpu


def autocast(device: torch.device, wanted: bool = True) -> torch.autocast:
    """Compute in bfloat16 if that is faster; weights stay float32, or small updates get lost."""
    enabled = wanted and has_fast_bf16(device)
    return torch.autocast(device.type, dtype=torch.bfloat16, enabled=enabled)


@contextmanager
def predicting(module: nn.Module) -> Iterator[None]:
    """Without dropout and gradients; restores the module's mode afterwards."""
    was_training = module.training
    module.eval()
    try:
        with torch.inference_mode():
            yield
    finally:
        module.train(was_training)


@contextmanager
def frozen(module: nn.Module) -> Iterator[None]:
    """Gradients of computations inside reach the module's inputs, but not its weights."""
    module.requires_grad_(False)
    try:
        yield
    finally:
        module.requires_grad_(True)


@contextmanager
def seeded(seed: int, device: str = "cpu") -> Iterator[None]:
    """Torch's random numbers (initial weights, dropout) from `seed`, elsewhere undisturbed.

    `device`: also of a GPU, where numbers are drawn there. No other GPU is touched: each that is
    takes memory and seconds.
    """
    gpus = () if device == "cpu" else (device,)
    with torch.random.fork_rng(gpus):
        torch.default_generator.manual_seed(seed)
        for gpu in gpus:
            with torch.cuda.device(gpu):
                torch.cuda.manual_seed(seed)
        yield


def under(prefix: str, tensors: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """Tensors whose names begin with a prefix, by the rest of their names."""
    return {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}


def load_generator(generator: torch.Generator, state: torch.Tensor) -> None:
    """Continue with a checkpoint's random numbers; on another kind of device from a seed."""
    saved = state.cpu()
    if len(saved) == len(generator.get_state()):
        generator.set_state(saved)
    else:  # a CPU's generator state does not fit a GPU's
        generator.manual_seed(int(saved[:8].view(torch.int64).abs().item()))


def load_weights(module: nn.Module, tensors: Mapping[str, torch.Tensor], name: str) -> None:
    """Raises InputError for weights of another network than `name` is in this version."""
    try:
        module.load_state_dict(tensors)
    except RuntimeError as error:
        raise InputError(
            f"the checkpoint holds another {name} than this version of simtune has; use "
            "the one that wrote it (see the run's config.json), or start another run"
        ) from error


def optimizer_tensors(optimizer: torch.optim.Optimizer) -> dict[str, torch.Tensor]:
    """An optimiser's moments and step counts for a checkpoint, {"3.exp_avg": ...}."""
    states = optimizer.state_dict()["state"]
    return {f"{i}.{key}": value for i, state in states.items() for key, value in state.items()}


def load_optimizer_tensors(
    optimizer: torch.optim.Optimizer, tensors: dict[str, torch.Tensor]
) -> None:
    """The inverse of `optimizer_tensors`, for an optimiser of the same parameters."""
    parameters = [p for group in optimizer.param_groups for p in group["params"]]
    states: dict[int, dict[str, torch.Tensor]] = {}
    for name, value in tensors.items():
        index, key = name.split(".", 1)
        # Moments need their parameter's memory layout: fused steps run through both.
        like = parameters[int(index)] if value.ndim else value
        states.setdefault(int(index), {})[key] = torch.empty_like(like).copy_(value)
    whole = {"state": states, "param_groups": optimizer.state_dict()["param_groups"]}
    optimizer.load_state_dict(cast(dict, whole))
