"""Weights in bfloat16 to compute with, beside those in float32 that learn."""

import copy
from typing import Generic, TypeVar

import torch
from torch import nn

from simtune.networks import layers

_Network = TypeVar("_Network", bound=nn.Module)


class HalfCopy(Generic[_Network]):
    """A network for computing where bfloat16 is faster; elsewhere the network itself.

    Autocast casts each matrix where it is used, forwards and back: a quarter of an update on a GPU.
    This casts all of them at once, after each step.
    """

    def __init__(self, network: _Network, device: torch.device):
        """Of a network on its device; it shares what stays float32: `FineLinear`, normalisation."""
        self.used = network
        self._pairs: list[tuple[nn.Parameter, nn.Parameter]] = []
        if layers.has_fast_bf16(device):
            parts = [part for part in network.modules() if _is_cast(part)]
            cast = {id(weight) for part in parts for weight in part.parameters()}
            memo = {id(p): p for p in network.parameters() if id(p) not in cast}
            self.used = copy.deepcopy(network, memo)
            for part in filter(_is_cast, self.used.modules()):
                part.to(torch.bfloat16)
            pairs = zip(network.parameters(), self.used.parameters(), strict=True)
            self._pairs = [(weight, half) for weight, half in pairs if half is not weight]

    def refresh(self) -> None:
        """Take over the network's weights."""
        _copy_all([half for _, half in self._pairs], [weight for weight, _ in self._pairs])

    def hand_over_gradients(self) -> None:
        """To the network's weights, from those that were used."""
        fine, coarse = [], []
        for weight, half in self._pairs:
            weight.grad = torch.empty_like(weight)  # laid out as an optimiser expects
            fine.append(weight.grad)
            coarse.append(half.grad)
            half.grad = None
        _copy_all(fine, coarse)

    def counterparts(self) -> dict[torch.Tensor, torch.Tensor]:
        """Those in bfloat16, by the weights that learn; none where these are used themselves."""
        return dict(self._pairs)


def _copy_all(into: list[torch.Tensor], values: list[torch.Tensor]) -> None:
    """Copy float32 to bfloat16 or back: in one kernel where the memory's layouts are the same."""
    pairs = list(zip(into, values, strict=True))
    alike = [(one, other) for one, other in pairs if one.stride() == other.stride()]
    with torch.no_grad():
        if alike:
            targets, sources = ([*tensors] for tensors in zip(*alike, strict=True))
            torch._foreach_copy_(targets, sources)  # pyright: ignore[reportPrivateImportUsage]
        for one, other in pairs:
            if one.stride() != other.stride():
                one.copy_(other)


def _is_cast(part: nn.Module) -> bool:
    return isinstance(part, nn.Linear | nn.Conv2d) and not isinstance(part, layers.FineLinear)
