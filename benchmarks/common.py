"""What every benchmark's JSON says of the machine; run as a script it prints just that."""

import json
import os
import platform
from importlib.metadata import version
from typing import Any

_PACKAGES = ("simtune", "mujoco", "mujoco-warp", "warp-lang", "torch")


def machine(*more_packages: str) -> dict[str, Any]:
    """The hardware, and the versions of what the figures depend on."""
    return {
        "hardware": {"cpu": _cpu_model(), "cores": os.cpu_count()},
        "versions": {name: version(name) for name in (*_PACKAGES, *more_packages)},
    }


def _cpu_model() -> str:
    try:
        with open("/proc/cpuinfo") as lines:
            return next(line.split(":")[1].strip() for line in lines if "model name" in line)
    except (OSError, StopIteration):
        return platform.processor()


if __name__ == "__main__":
    print(json.dumps(machine()))
