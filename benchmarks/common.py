"""What benchmarks share. Run as a script it prints what every one's JSON says of the machine."""

import json
import os
import platform
from importlib.metadata import version
from typing import Any

from simtune.fit import ParticleConfig, ShootingConfig, Stage
from simtune.tuning.posterior_config import PosteriorSearchConfig

# A search in seconds that finds nothing, to see that all of a benchmark runs.
QUICK = PosteriorSearchConfig(
    num_worlds=32,
    unseen_worlds=16,
    detector_updates=(10,),
    posterior_updates=10,
    state_updates=10,
    least_updates=2,
    replicas=(1, 1),
    particles=ParticleConfig(num=8, steps=4),
    shooting=ShootingConfig(stages=(Stage(4, 1, 2.0), Stage(8, 1)), longer=(), num_windows=6),
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
