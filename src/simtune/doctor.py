"""What this machine has, and which renderers work on it."""

import os
import platform
import time
from collections.abc import Iterator, Mapping
from importlib.metadata import PackageNotFoundError, version
from typing import get_args

import numpy as np

from simtune.names import RendererName

_FOR_ROBOTS = ("xarm-python-sdk", "pyrealsense2")
_WORKS = "works"
_PACKAGES = ("simtune", "mujoco", "mujoco-warp", "torch", "av", "pyarrow", "numpy")
_PACKAGES += _FOR_ROBOTS
NAMES = ("python", *_PACKAGES, "cpu", "cuda", *get_args(RendererName))  # of what is told


def analyze() -> Iterator[tuple[str, str]]:
    """(what, its state here), one after another: a driver may end the process when tried."""
    python = f"{platform.python_version()} on {platform.platform()}, {os.cpu_count()} cores"
    yield "python", python
    for package in _PACKAGES:
        try:
            yield package, version(package)
        except PackageNotFoundError:
            wanted_for = ", for --real xarm" if package in _FOR_ROBOTS else ""
            yield package, f"not installed: pip install {package}{wanted_for}"
    yield from _devices()
    for renderer in get_args(RendererName):
        yield renderer, _try_renderer(renderer)


def works(found: Mapping[str, str]) -> bool:
    """Whether the default renderer works, by what `analyze` found."""
    return found["raycaster"].startswith(_WORKS)


def _devices() -> Iterator[tuple[str, str]]:
    import torch

    from simtune.devices import choose_device
    from simtune.networks.layers import has_fast_bf16

    cpu = torch.device("cpu")
    yield "cpu", f"{torch.get_num_threads()} threads, fast bfloat16: {has_fast_bf16(cpu)}"
    gpu = "none: all runs on the CPU"
    if torch.cuda.is_available():
        does = "draws, and trains networks"
        if choose_device("auto") == "cpu":
            does = "not used, since Warp cannot draw with it: all runs on the CPU"
        gpu = f"{torch.cuda.get_device_name()}: {does}"
    yield "cuda", gpu


def _try_renderer(name: RendererName) -> str:
    """Draw the quick task's start with a renderer, twice: the first time may compile."""
    from simtune.devices import choose_device
    from simtune.tasks import load_task

    task = load_task("cartpole")
    try:
        device = choose_device("auto") if name == "raycaster" else "cpu"
        simulator = task.simulator(image_size=64, renderer=name, device=device)
        rng = np.random.default_rng(0)
        parameters = np.tile(task.parameters.nominal, (64, 1))
        actions = np.zeros((64, 1, simulator.num_actions))
        rollouts = simulator.roll_out(parameters, actions, rng)
        simulator.film(rollouts)
        began_s = time.monotonic()
        frames = simulator.film(rollouts)
    except Exception as error:  # whatever a driver raises: the doctor is to report it
        return f"does not work: {' '.join(str(error).split())}"
    if frames.max() == frames.min():
        return "draws nothing but one colour"
    speed = frames.shape[0] * frames.shape[1] / (time.monotonic() - began_s)
    return f"{_WORKS}: {speed:,.0f} frames/s at 64 px"
