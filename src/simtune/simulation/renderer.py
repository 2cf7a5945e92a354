"""Draw worlds: one interface, two renderers."""

from typing import Protocol

import mujoco
import numpy as np

from simtune.errors import InputError
from simtune.names import RendererName
from simtune.parameters import ParameterSpace
from simtune.simulation.quality import OPENGL_FAST, OpenGLQuality


class Renderer(Protocol):
    """Draws pictures of one model from one camera, each of a world of its own."""

    image_size: int

    def render(self, states: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """(n, S) states of worlds with (n, N) parameters to (n, H, W, 3) uint8 RGB."""
        ...


def make_renderer(
    name: RendererName,
    model: mujoco.MjModel,
    space: ParameterSpace,
    camera: str,
    image_size: int,
    quality: OpenGLQuality = OPENGL_FAST,
) -> Renderer:
    """The renderer of that name; the ray caster has no `quality`.

    Raises InputError for an unknown name or camera, and for OpenGL where there is none.
    """
    if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, camera) < 0:
        raise InputError(f"the model has no camera {camera!r}")
    # Each is imported only when asked for: Warp and OpenGL are slow or noisy to load.
    if name == "raycaster":
        from simtune.simulation.raycaster import Raycaster

        return Raycaster(model, space, camera, image_size)
    if name == "opengl":
        from simtune.simulation.opengl import OpenGLRenderer

        return OpenGLRenderer(model, space, camera, image_size, quality)
    raise InputError(f"no renderer {name!r}; there are: raycaster, opengl")
