"""Draws worlds: one interface, two renderers."""

from typing import Protocol

import mujoco
import numpy as np

from simtune.errors import InputError
from simtune.names import RendererName
from simtune.parameters import ParameterSpace
from simtune.simulation.rendering.opengl_quality import OPENGL_FAST, OpenGLQuality
from simtune.simulation.rendering.stray_light import StrayLight


class Renderer(Protocol):
    """Draws pictures of one model from one camera, each of its own world."""

    size: tuple[int, int]  # (height, width), pixels

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
    name: RendererName,
    model: mujoco.MjModel,
    space: ParameterSpace,
    camera: str,
    size: tuple[int, int],
    quality: OpenGLQuality = OPENGL_FAST,
    plate: np.ndarray | None = None,
    background_is_unknown: bool = False,
    device: str = "cpu",
) -> Renderer:
    """The renderer with this name, for pictures of `size`, (height, width).

    The ray caster has no `quality`; only it supports a `plate`, (height, width, 3) uint8, an
    unknown background (OpenGL draws the model's own), and a `device`: cpu, cuda or cuda:N.

    Raises InputError for an unknown name or camera, for OpenGL if there is none, and for a plate
    with a camera that moves.
    """
    if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, camera) < 0:
        raise InputError(f"the model has no camera {camera!r}")
    # Imported only when asked for: Warp and OpenGL are slow or noisy to load.
    if name == "raycaster":
        from simtune.simulation.rendering.raycaster import Raycaster

        return Raycaster(
            model,
            space,
            camera,
            size,
            plate=plate,
            background_is_unknown=background_is_unknown,
            device=device,
        )
    if name == "opengl":
        if plate is not None:
            raise ValueError("OpenGL draws no plate")
        from simtune.simulation.rendering.opengl import OpenGLRenderer

        return OpenGLRenderer(model, space, camera, size, quality)
    raise InputError(f"no renderer {name!r}; there are: raycaster, opengl")
