"""What benchmarks share. Run as a script it prints what every one's JSON says of the machine."""

import json
import os
import platform
from importlib.metadata import version
from typing import Any

from simtune.fit import ShootingConfig
from simtune.tuning.posterior_config import PosteriorSearchConfig

# A search in seconds that finds nothing, to see that all of a benchmark runs.
QUICK = PosteriorSearchConfig(
    num_worlds=64,
    unseen_worlds=32,
    sight_updates=(30,),
    judge_updates=20,
    state_updates=20,
    shooting=ShootingConfig(longer=()),
)

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
