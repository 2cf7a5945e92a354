"""An agent's networks, optimisers and random numbers as the tensors of a checkpoint."""

from collections.abc import Mapping

import torch
from torch import nn

from simtune.networks.layers import (
    load_generator,
    load_optimizer_tensors,
    load_weights,
    optimizer_tensors,
    under,
)

Stateful = Mapping[str, nn.Module | torch.optim.Optimizer]  # by the names in a checkpoint


def gather_tensors(stateful: Stateful, generator: torch.Generator) -> dict[str, torch.Tensor]:
    """{"actor.head.0.weight": ...}; they share memory with `stateful`."""
    tensors = {"generator": generator.get_state()}
    for name, part in stateful.items():
        own = part.state_dict() if isinstance(part, nn.Module) else optimizer_tensors(part)
        tensors |= {f"{name}.{key}": value for key, value in own.items()}
    return tensors


def scatter_tensors(
    stateful: Stateful, generator: torch.Generator, tensors: Mapping[str, torch.Tensor]
) -> None:
    """The inverse: copy them into `stateful`, on whatever device that is.

    On another kind of device than they were saved on, random numbers restart from a seed. Raises
    InputError for tensors of other networks, as of another version.
    """
    load_generator(generator, tensors["generator"])
    for name, part in stateful.items():
        own = under(f"{name}.", tensors)
        if isinstance(part, nn.Module):
            load_weights(part, own, name)
        else:
            load_optimizer_tensors(part, own)
