"""What dm_control's tasks share: their models, and soft indicator functions as rewards.

The models are read without importing dm_control, which loads OpenGL. The mathematics of `tolerance`
is that of dm_control.utils.rewards (Tassa et al. 2018, arXiv:1801.00690, Sec. 4).
"""

from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from simtune.footage import Footage
from simtune.parameters import Parameter, ParameterSpace
from simtune.tasks.task import Task


def suite_task(
    name: str,
    parameters: list[Parameter],
    load_spec: Callable[[], mujoco.MjSpec] | None = None,
    *,
    camera: str,
    **rest: Any,
) -> Task:
    """The suite's task of its model NAME.xml; `camera` films; `rest`: what else it is."""
    return Task(
        name=name,
        load_spec=load_spec or partial(load_suite_spec, name),
        parameters=ParameterSpace(parameters, where=name),
        cameras=(Footage(camera=camera, name=camera),),
        **rest,
    )


def load_suite_spec(name: str) -> mujoco.MjSpec:
    """The suite's model NAME.xml with the assets it includes, e.g. "walker"."""
    package = find_spec("dm_control")  # finds a top-level package without importing it
    if package is None or not package.submodule_search_locations:
        raise ModuleNotFoundError("dm_control is not installed; the built-in tasks need its models")
    folder = Path(package.submodule_search_locations[0]) / "suite"
    return mujoco.MjSpec.from_file(str(folder / f"{name}.xml"))


def tolerance(
    x: np.ndarray,
    *,
    low: float = 0.0,
    high: float = 0.0,
    margin: float,
    value_at_margin: float = 0.1,
    shape: str = "gaussian",
) -> np.ndarray:
    """1 where low <= x <= high, `value_at_margin` at a distance of `margin` from there.

    `shape` is how it falls: "gaussian", or "linear" or "quadratic" down to 0.
    """
    distance = np.maximum(np.maximum(low - x, x - high), 0) / margin
    if shape == "gaussian":
        return value_at_margin ** (distance**2)
    power = {"linear": 1, "quadratic": 2}[shape]
    return np.maximum(1 - (1 - value_at_margin) * distance**power, 0)
