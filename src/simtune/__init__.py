"""Tune a simulator's parameters until it matches the video of a real robot (docs/python.md)."""

from typing import TYPE_CHECKING, Any

__all__ = ["Result", "check", "load", "load_task", "record", "train", "tune"]

if TYPE_CHECKING:
    from simtune.api import Result, check, load, load_task, record, train, tune


def __getattr__(name: str) -> Any:
    """The public names; MuJoCo is loaded with the first of them, torch with what needs it."""
    if name == "__version__":
        return _version()
    if name not in __all__:
        raise AttributeError(f"module 'simtune' has no attribute {name!r}")
    from simtune import api

    return getattr(api, name)


def _version() -> str:
    """As it was installed: by git's tags (CONTRIBUTING.md)."""
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("simtune")
    except PackageNotFoundError:  # a folder on Python's path
        return "unknown"


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
