"""What a `Simulator` is made of: what is simulated, and how it is drawn."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco.batch import Batch

from simtune.cameras.views import View
from simtune.names import RendererName
from simtune.parameters import ParameterSpace
from simtune.simulation.actions import DirectActions, MapActions
from simtune.simulation.rendering.opengl_quality import OPENGL_FAST, OpenGLQuality

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


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """Pictures of some cameras, equally high and side by side, and their renderer.

    With `supersampling` k, k × k points are averaged per pixel, as by a camera's sensor: thin
    things blend with their background instead of vanishing between the points.
    """

    image_size: int  # height in pixels
    views: tuple[View, ...] = ()  # none: nothing is ever drawn
    renderer: RendererName = "raycaster"
    quality: OpenGLQuality = OPENGL_FAST
    supersampling: int = 1
    device: str = "cpu"  # on which the ray caster draws: cpu, cuda or cuda:N

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W) of all views together."""
        return self.image_size, sum(view.width(self.image_size) for view in self.views)
