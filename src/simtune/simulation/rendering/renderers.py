"""Pictures of all cameras, side by side, averaged over pixels as by a camera's sensor."""

from itertools import product

import mujoco
import numpy as np

from simtune.parameters import ParameterSpace
from simtune.simulation.rendering.picture_settings import PictureSettings
from simtune.simulation.rendering.renderer import make_renderer
from simtune.simulation.rendering.stray_light import StrayLight

_CHUNK = 256  # supersampled pictures drawn at a time, to limit memory


class Renderers:
    """A renderer for each view."""

    def __init__(self, model: mujoco.MjModel, space: ParameterSpace, settings: PictureSettings):
        """Raises InputError for what `make_renderer` refuses."""
        self._supersampling, self._shape = settings.supersampling, settings.shape
        self._each = [make_renderer(model, space, view, settings) for view in settings.views]

    def render(
        self, states: np.ndarray, parameters: np.ndarray, stray: StrayLight | None = None
    ) -> np.ndarray:
        """(n, S) states of worlds of (n, N) parameters to (n, H, W, 3) uint8 RGB.

        Raises ValueError if there is no camera.
        """
        if not self._each:
            raise ValueError("nothing can be drawn: no camera films this scene")
        if self._supersampling == 1:
            return self._side_by_side(states, parameters, stray)
        frames = np.empty((len(states), *self._shape, 3), np.uint8)
        for start in range(0, len(states), _CHUNK):
            part = slice(start, start + _CHUNK)
            chunk_stray = stray.of(part) if stray else None
            large = self._side_by_side(states[part], parameters[part], chunk_stray)
            frames[part] = _averaged(large, self._supersampling)
        return frames

    def covers(self, states: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """(n, H, W) bool: pixels that show nothing but what is drawn; see `Renderer.covers`."""
        each = [renderer.covers(states, parameters) for renderer in self._each]
        (height, width), k = self._shape, self._supersampling
        points = np.concatenate(each, 2).reshape(-1, height, k, width, k)
        return np.all(points, axis=(2, 4))

    def _side_by_side(
        self, states: np.ndarray, parameters: np.ndarray, stray: StrayLight | None
    ) -> np.ndarray:
        drawn = [renderer.render(states, parameters, stray) for renderer in self._each]
        return drawn[0] if len(drawn) == 1 else np.concatenate(drawn, 2)


def _averaged(pictures: np.ndarray, factor: int) -> np.ndarray:
    """(n, H, W, 3) uint8 averages of (n, H factor, W factor, 3) pixels, rounded half up."""
    total = np.full_like(pictures[:, ::factor, ::factor], factor**2 // 2, np.uint16)
    for row, column in product(range(factor), repeat=2):  # six times as fast as one sum
        total += pictures[:, row::factor, column::factor]
    return (total // factor**2).astype(np.uint8)
