"""Which versions of simtune and of its packages made a run."""

import importlib.metadata
import platform
from collections.abc import Mapping
from typing import Any

import simtune

_MODEL_PACKAGES = ("simtune", "mujoco")  # decide what a model's content is


def versions() -> dict[str, str]:
    """Those here, as config.json stores them."""
    packages = ("mujoco", "mujoco_warp", "torch")
    return {
        "simtune": simtune.__version__,
        "python": platform.python_version(),
        **{name: importlib.metadata.version(name) for name in packages},
        "platform": platform.platform(),
    }


def changed_versions(stored: Mapping[str, Any]) -> dict[str, str]:
    """{name: "VERSION → VERSION here"} of all that differ; `stored`: content of config.json."""
    before = stored.get("versions") or {}
    return {k: f"{before[k]} → {v}" for k, v in versions().items() if before.get(k, v) != v}


def changed_readers(stored: Mapping[str, Any]) -> str:
    """The changes of what reads a task, such as "mujoco 3.3.0 → 3.4.0"; empty: none.

    With others, unchanged files may have another content, by which a run is refused.
    """
    changed = changed_versions(stored)
    return ", ".join(f"{name} {changed[name]}" for name in _MODEL_PACKAGES if name in changed)
