"""Draws worlds: one interface, two renderers."""

from typing import Protocol

import mujoco
import numpy as np

from simtune.cameras.views import View
from simtune.errors import InputError
from simtune.parameters import ParameterSpace
from simtune.simulation.rendering.picture_settings import PictureSettings
from simtune.simulation.rendering.stray_light import StrayLight


class Renderer(Protocol):
    """Draws pictures of one model from one camera, each of its own world."""

    size: tuple[int, int]  # (height, width), in points; see `PictureSettings`

    def render(
        self, states: np.ndarray, parameters: np.ndarray, stray: StrayLight | None = None
    ) -> np.ndarray:
        """(n, S) states of worlds with (n, N) parameters to (n, H, W, 3) uint8 RGB.

        `stray`: of each; OpenGL draws what its quality says.
        """
        ...

    def covers(self, states: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """(n, H, W) bool: whether a pixel is drawn, not left to an unknown background."""
        ...


def make_renderer(
    model: mujoco.MjModel, space: ParameterSpace, view: View, settings: PictureSettings
) -> Renderer:
    """The settings' renderer, for pictures of one view.

    Only the ray caster supports a plate, an unknown background (OpenGL draws the model's own), and
    a device.

    Raises InputError for an unknown renderer or camera, for OpenGL if there is none, and for a
    plate with a camera that moves.
    """
    if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, view.camera) < 0:
        raise InputError(f"the model has no camera {view.camera!r}")
    # Imported only when asked for: Warp and OpenGL are slow or noisy to load.
    if settings.renderer == "raycaster":
        from simtune.simulation.rendering.raycaster import Raycaster

        return Raycaster(model, space, view, settings)
    if settings.renderer == "opengl":
        if view.plate is not None:
            raise ValueError("OpenGL draws no plate")
        from simtune.simulation.rendering.opengl import OpenGLRenderer

        return OpenGLRenderer(model, space, view, settings)
    raise InputError(f"no renderer {settings.renderer!r}; there are: raycaster, opengl")
