"""Tune a simulator's parameters until it matches the video of a real robot (docs/python.md)."""

from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"
__all__ = ["Result", "check", "load", "load_task", "train", "tune"]

if TYPE_CHECKING:
    from simtune.api import Result, check, load, load_task, train, tune


def __getattr__(name: str) -> Any:
    """The public names; torch and MuJoCo, which take seconds, are loaded with the first of them."""
    if name not in __all__:
        raise AttributeError(f"module 'simtune' has no attribute {name!r}")
    from simtune import api

    return getattr(api, name)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
