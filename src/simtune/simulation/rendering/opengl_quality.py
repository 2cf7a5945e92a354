"""Quality settings of OpenGL; apart from its renderer, which is slow to load."""

from dataclasses import dataclass


@dataclass(frozen=True)
class OpenGLQuality:
    """What OpenGL draws beyond lit, textured surfaces; each costs time without a GPU."""

    shadow_map_px: int = 0  # side of the shadow map, at most; 0 draws no shadows
    multisamples: int = 0  # per pixel, against jagged edges; 0 is one
    reflections: bool = False
    skybox: bool = True


OPENGL_FAST = OpenGLQuality()
# As dm_control draws: a camera that does not look like the simulator.
OPENGL_DM_CONTROL = OpenGLQuality(shadow_map_px=4096, multisamples=4, reflections=True)
