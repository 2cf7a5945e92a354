"""Code shared by dm_control's tasks (Tassa et al. 2018, arXiv:1801.00690).

Their models are read without importing dm_control.suite, which would load OpenGL.
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import dm_control
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
    return mujoco.MjSpec.from_file(str(Path(dm_control.__file__).parent / f"suite/{name}.xml"))


def untextured_model(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile a model without textures, which take a hundred times as long as everything else."""
    spec = spec.copy()
    for texture in spec.textures:
        texture.width = texture.height = 1
    return spec.compile()
