"""Which device computes and draws."""

from simtune.config.option_checks import check_device
from simtune.errors import InputError


def choose_device(name: str) -> str:
    """What `--device NAME` stands for on this machine. Raises InputError if it is not available."""
    import torch  # slow to load, and many who import this ask nothing

    if name == "auto":
        return "cuda" if torch.cuda.is_available() and _can_draw("cuda") else "cpu"
    check_device(name)
    try:
        torch.empty(0, device=name)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).partition("\n")[0]
        raise InputError(
            f"--device {name} cannot be used here: {reason}; give --device cpu or auto"
        ) from None
    if name != "cpu" and not _can_draw(name):
        raise InputError(
            f"--device {name}: PyTorch can use it, but Warp, which draws, cannot (an old driver?): "
            "give --device cpu"
        )
    return name


def _can_draw(device: str) -> bool:
    from simtune.simulation.rendering.warp_context import init_warp  # slow to load

    try:
        init_warp(device)
    except (RuntimeError, ValueError):
        return False
    return True
