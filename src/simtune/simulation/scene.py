"""What a `Simulator` simulates."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.parameters import ParameterSpace
from simtune.simulation.actions import DirectActions, MapActions

Script = Callable[[Batch], np.ndarray]  # worlds in their present state to (n, A) actions


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A model, its tuned parameters, how its worlds start, and what moves them."""

    model: mujoco.MjModel
    space: ParameterSpace
    step_s: float  # duration of an action
    initialize: Callable[[Batch, np.random.Generator], None]  # starts the worlds
    map_actions: MapActions = DirectActions  # factory of a model's action mapping
    script: Script | None = None  # acts on knowledge that only a simulator has
