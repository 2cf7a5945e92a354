"""Code shared by dm_control's tasks: models, and soft indicator functions for rewards.

The models are read without importing dm_control, which would load OpenGL. `tolerance` follows
dm_control.utils.rewards (Tassa et al. 2018, arXiv:1801.00690, Sec. 4).
"""

from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from simtune.cameras.footage import Footage
from simtune.observation import JointSensor
from simtune.parameters import Parameter, ParameterSpace
from simtune.parameters.joint_types import HINGE
from simtune.tasks.task import Task

_ENCODER_NOISE = 1e-3  # rad or m


def suite_task(
    name: str,
    parameters: list[Parameter],
    load_spec: Callable[[], mujoco.MjSpec] | None = None,
    *,
    camera: str,
    encoders: tuple[str, ...],
    **rest: Any,
) -> Task:
    """A task with the suite's model NAME.xml, filmed by `camera`; `rest`: other fields of `Task`.

    `encoders`: joints with an encoder; --observe must name these, they are not used by default.
    """
    load_spec = load_spec or partial(load_suite_spec, name)
    return Task(
        name=name,
        load_spec=load_spec,
        parameters=ParameterSpace(parameters, where=name),
        cameras=(Footage(camera=camera, name=camera),),
        sensors=(_encoders(untextured_model(load_spec()), encoders),),
        looks_at=("cameras",),
        **rest,
    )


def _encoders(model: mujoco.MjModel, joints: tuple[str, ...]) -> JointSensor:
    """Encoders of joints that are all hinges or all slides; their zero is the model's."""
    is_hinge = model.joint(joints[0]).type[0] == HINGE
    return JointSensor(
        name="encoders",
        columns=joints,
        joints=joints,
        places=np.array([model.joint(joint).qposadr[0] for joint in joints]),
        unit="rad" if is_hinge else "m",
        factor=np.ones(len(joints)),
        shift=np.zeros(len(joints)),
        noise=_ENCODER_NOISE,
        offset=np.zeros(len(joints)),
    )


def load_suite_spec(name: str) -> mujoco.MjSpec:
    """The suite's model NAME.xml, e.g. "walker", with the assets it includes."""
    package = find_spec("dm_control")  # finds a top-level package without importing it
    if package is None or not package.submodule_search_locations:
        raise ModuleNotFoundError("dm_control is not installed; the built-in tasks need its models")
    folder = Path(package.submodule_search_locations[0]) / "suite"
    return mujoco.MjSpec.from_file(str(folder / f"{name}.xml"))


def untextured_model(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile a model without textures, which take a hundred times as long as everything else."""
    spec = spec.copy()
    for texture in spec.textures:
        texture.width = texture.height = 1
    return spec.compile()


def tolerance(
    x: np.ndarray,
    *,
    low: float = 0.0,
    high: float = 0.0,
    margin: float,
    value_at_margin: float = 0.1,
    shape: str = "gaussian",
) -> np.ndarray:
    """1 where low <= x <= high, falling to `value_at_margin` at a distance of `margin` outside.

    `shape` of the fall: "gaussian", or "linear" or "quadratic" down to 0.
    """
    distance = np.maximum(np.maximum(low - x, x - high), 0) / margin
    if shape == "gaussian":
        return value_at_margin ** (distance**2)
    power = {"linear": 1, "quadratic": 2}[shape]
    return np.maximum(1 - (1 - value_at_margin) * distance**power, 0)
