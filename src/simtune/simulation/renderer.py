"""Draw worlds: one interface, two renderers."""

from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np

from simtune.errors import InputError
from simtune.names import RendererName
from simtune.parameters import ParameterSpace
from simtune.simulation.stray_light import StrayLight


@dataclass(frozen=True)
class OpenGLQuality:
    """What OpenGL draws beyond lit, textured surfaces; each costs time without a GPU."""

    shadow_map_px: int = 0  # side of the shadow map; 0 draws no shadows
    multisamples: int = 0  # of a pixel, against jagged edges; 0 is one
    reflections: bool = False
    skybox: bool = True


OPENGL_FAST = OpenGLQuality()
# As dm_control draws: a camera that does not look like the simulator.
OPENGL_DM_CONTROL = OpenGLQuality(shadow_map_px=4096, multisamples=4, reflections=True)


class Renderer(Protocol):
    """Draws pictures of one model from one camera, each of a world of its own."""

    size: tuple[int, int]  # (height, width), pixels

    def render(
        self, states: np.ndarray, parameters: np.ndarray, stray: StrayLight | None = None
    ) -> np.ndarray:
        """(n, S) states of worlds with (n, N) parameters to (n, H, W, 3) uint8 RGB.

        `stray`: of each; OpenGL draws what its quality says.
        """
        ...


def make_renderer(
    name: RendererName,
    model: mujoco.MjModel,
    space: ParameterSpace,
    camera: str,
    size: tuple[int, int],
    quality: OpenGLQuality = OPENGL_FAST,
    plate: np.ndarray | None = None,
) -> Renderer:
    """The renderer of that name, which draws pictures of `size`, (height, width).

    The ray caster has no `quality`; only it knows a `plate`, (height, width, 3) uint8.

    Raises InputError for an unknown name or camera, for OpenGL where there is none, and for a
    plate before a camera that moves.
    """
    if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, camera) < 0:
        raise InputError(f"the model has no camera {camera!r}")
    # Each is imported only when asked for: Warp and OpenGL are slow or noisy to load.
    if name == "raycaster":
        from simtune.simulation.raycaster import Raycaster

        return Raycaster(model, space, camera, size, plate=plate)
    if name == "opengl":
        if plate is not None:
            raise ValueError("OpenGL draws no plate")
        from simtune.simulation.opengl import OpenGLRenderer

        return OpenGLRenderer(model, space, camera, size, quality)
    raise InputError(f"no renderer {name!r}; there are: raycaster, opengl")
