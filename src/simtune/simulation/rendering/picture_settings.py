"""What pictures are drawn of, by what, and how well; apart from renderers, slow to load."""

from dataclasses import dataclass

from simtune.cameras.views import View
from simtune.names import RendererName


@dataclass(frozen=True)
class OpenGLQuality:
    """What OpenGL draws beyond lit, textured surfaces; each costs time without a GPU."""

    shadow_map_px: int = 0  # side of the shadow map, at most; 0 draws no shadows
    multisamples: int = 0  # per pixel, against jagged edges; 0 is one
    reflections: bool = False


OPENGL_FAST = OpenGLQuality()
# As dm_control draws: a camera that does not look like the simulator.
OPENGL_DM_CONTROL = OpenGLQuality(shadow_map_px=4096, multisamples=4, reflections=True)


@dataclass(frozen=True, kw_only=True)
class PictureSettings:
    """Pictures of some cameras, equally high and side by side, and their renderer.

    With `supersampling` k, k × k points are averaged per pixel, as by a camera's sensor: thin
    things blend with their background instead of vanishing between the points.
    """

    image_size: int  # height in pixels
    views: tuple[View, ...] = ()  # none: nothing is ever drawn
    renderer: RendererName = "raycaster"
    quality: OpenGLQuality = OPENGL_FAST  # the ray caster has none
    supersampling: int = 1
    device: str = "cpu"  # on which the ray caster draws: cpu, cuda or cuda:N

    @property
    def shape(self) -> tuple[int, int]:
        """(H, W) of all views together."""
        return self.image_size, sum(view.width(self.image_size) for view in self.views)

    def points(self, view: View) -> tuple[int, int]:
        """(height, width) of a view as it is drawn, in points: k² of them per pixel."""
        k, height = self.supersampling, self.image_size
        return k * height, k * view.width(height)
