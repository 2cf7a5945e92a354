"""Which device computes."""

import torch

from simtune.errors import InputError


def choose_device(name: str) -> str:
    """What `--device NAME` stands for on this machine. Raises InputError if it is not available."""
    if name == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    if name.partition(":")[0] not in ("cpu", "cuda"):
        raise InputError(f"--device must be auto, cpu, cuda or cuda:N, got {name}")
    try:
        torch.empty(0, device=name)
    except (RuntimeError, AssertionError) as error:
        raise InputError(f"--device {name} cannot be used here: {error}") from None
    return name
