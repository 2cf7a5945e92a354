"""Scenes with the arm: models, actions, initial state, and positions of sites."""

from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.cameras.footage import Footage
from simtune.parameters import Parameter, ParameterSpace
from simtune.simulation import MocapActions
from simtune.tasks.batch_state import computed, reset_to_default
from simtune.tasks.task import Task

_STEP_S = 0.3  # of a policy step
_EPISODE_STEPS = 60
_CAMERA = "over_shoulder"
_STEP_M = 0.025  # largest displacement of the hand by an action, along each axis
_LIGHTS = ("left", "right", "front")
_SCENES = Path(__file__).parent


def arm_task(
    name: str, parameters: list[Parameter], workspace_m: list[list[float]], **rest: Any
) -> Task:
    """A task in the scene of the folder `name` beside this file.

    An action is a displacement of the hand: x, y, z in [−1, 1], times 2.5 cm. The hand stays within
    `workspace_m`, [low, high] along each axis. `rest`: other fields of `Task`.
    """
    scene = str(_SCENES / name / "scene.xml")
    hand = {"body": "target", "metres_per_unit": _STEP_M, "workspace_m": workspace_m}
    return Task(
        name=name,
        load_spec=lambda: mujoco.MjSpec.from_file(scene),
        parameters=ParameterSpace(parameters, where=name),
        cameras=(Footage(camera=_CAMERA, name=_CAMERA),),
        control_timestep_s=_STEP_S,
        action_repeat=1,
        episode_steps=_EPISODE_STEPS,
        map_actions=partial(MocapActions, **hand),
        **rest,
    )


def lighting() -> Parameter:
    """The brightness of all three lights."""
    return Parameter(
        name="lighting",
        field="light_diffuse",
        objects=_LIGHTS,
        nominal=0.3,
        low=0.0,
        high=1.0,
        scale="linear",
        unit="1",
    )


def start_arm(batch: Batch) -> None:
    """Set the scene's keyframe "start", at rest."""
    reset_to_default(batch)
    batch.qpos[:] = batch.model.key("start").qpos


def place_of(batch: Batch, site: str) -> np.ndarray:
    """(nsim, 3) position of a site, m."""
    return computed(batch, "site_xpos")[:, batch.model.site(site).id]


def towards(way_m: np.ndarray) -> np.ndarray:
    """(nsim, 3) action that moves the hand by `way_m`, clipped to the largest possible action."""
    return np.clip(way_m / _STEP_M, -1, 1)
