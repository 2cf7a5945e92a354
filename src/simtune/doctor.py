"""What this machine has, and which renderers work on it."""

import os
import platform
import time
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version

import numpy as np

_FOR_ROBOTS = ("xarm-python-sdk", "pyrealsense2")
_PACKAGES = ("simtune", "mujoco", "mujoco-warp", "torch", "av", "pyarrow", "numpy")


def analyze(say: Callable[[str], None]) -> bool:
    """Say what there is, a line each; whether the default renderer works."""
    say(f"python     {platform.python_version()} on {platform.platform()}, {os.cpu_count()} cores")
    for package in _PACKAGES + _FOR_ROBOTS:
        try:
            say(f"{package:10s} {version(package)}")
        except PackageNotFoundError:
            wanted_for = ", for --real xarm" if package in _FOR_ROBOTS else ""
            say(f"{package:10s} not installed: pip install {package}{wanted_for}")
    _say_devices(say)
    works = _try_renderer("raycaster", say)
    _try_renderer("opengl", say)
    return works


def _say_devices(say: Callable[[str], None]) -> None:
    import torch

    from simtune.networks import has_fast_bf16

    cpu = torch.device("cpu")
    say(f"cpu        {torch.get_num_threads()} threads, fast bfloat16: {has_fast_bf16(cpu)}")
    gpu = "none: all runs on the CPU"
    if torch.cuda.is_available():
        used_for = "draws, and trains policies; all else is learnt on the CPU"
        gpu = f"{torch.cuda.get_device_name()}: {used_for}"
    say(f"cuda       {gpu}")


def _try_renderer(name, say: Callable[[str], None]) -> bool:
    """Draw the quick task's start with a renderer, twice: the first time may compile."""
    from simtune.tasks import load_task

    task = load_task("cartpole")
    try:
        simulator = task.simulator(image_size=64, renderer=name)
        rng = np.random.default_rng(0)
        parameters = np.tile(task.parameters.nominal, (64, 1))
        actions = np.zeros((64, 1, simulator.num_actions))
        rollouts = simulator.roll_out(parameters, actions, rng)
        simulator.film(rollouts)
        began_s = time.monotonic()
        frames = simulator.film(rollouts)
    except Exception as error:  # whatever a driver throws: the doctor is there to tell
        say(f"{name:10s} does not work: {' '.join(str(error).split())}")
        return False
    if frames.max() == frames.min():
        say(f"{name:10s} draws nothing but one colour")
        return False
    speed = frames.shape[0] * frames.shape[1] / (time.monotonic() - began_s)
    say(f"{name:10s} works: {speed:,.0f} frames/s at 64 px")
    return True
