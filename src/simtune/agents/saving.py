"""An agent's networks, optimisers and random numbers as the tensors of a checkpoint."""

from collections.abc import Mapping

import torch
from torch import nn

from simtune.networks import load_optimizer_tensors, load_weights, optimizer_tensors, under

Parts = Mapping[str, nn.Module | torch.optim.Optimizer]


def gather_tensors(parts: Parts, generator: torch.Generator) -> dict[str, torch.Tensor]:
    """{"actor.head.0.weight": ...}; they share memory with the parts."""
    tensors = {"generator": generator.get_state()}
    for name, part in parts.items():
        own = part.state_dict() if isinstance(part, nn.Module) else optimizer_tensors(part)
        tensors |= {f"{name}.{key}": value for key, value in own.items()}
    return tensors


def scatter_tensors(
    parts: Parts, generator: torch.Generator, tensors: Mapping[str, torch.Tensor]
) -> None:
    """The inverse: copy them into the parts, on whatever device those are.

    Random numbers go on as they would have on the kind of device that they were saved on only.
    Raises InputError for tensors of other networks, which another version has.
    """
    saved = tensors["generator"].cpu()
    if len(saved) == len(generator.get_state()):
        generator.set_state(saved)
    else:  # a CPU's state is not a GPU's
        generator.manual_seed(int(saved[:8].view(torch.int64).abs().item()))
    for name, part in parts.items():
        own = under(f"{name}.", tensors)
        if isinstance(part, nn.Module):
            load_weights(part, own, name)
        else:
            load_optimizer_tensors(part, own)
