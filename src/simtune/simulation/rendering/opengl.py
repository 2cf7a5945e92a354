"""MuJoCo's classic renderer: OpenGL through EGL or OSMesa, without a display."""

import atexit
import copy
import importlib
import os
import sys
from ctypes.util import find_library

import mujoco
import numpy as np

from simtune.cameras.views import View
from simtune.errors import InputError
from simtune.parameters import ModelWriter, ParameterSpace
from simtune.simulation.rendering.picture_settings import PictureSettings
from simtune.simulation.rendering.stray_light import StrayLight

_HEADLESS = {"egl": "EGL", "osmesa": "OSMesa"}  # libraries of the backends without a display
_MAX_GEOMS = 10_000  # as in mujoco.Renderer
# A shadow map has at most so many texels for a pixel of the picture. A finer one costs most of the
# time without a GPU and shows nothing: walker at 128 pixels is drawn three times as fast, and one
# pixel in a thousand differs by more than 8 of 255.
_TEXELS_PER_PIXEL = 8
_ALL, _FULL_STATE = mujoco.mjtCatBit.mjCAT_ALL.value, mujoco.mjtState.mjSTATE_INTEGRATION


class OpenGLRenderer:
    """Draws all that MuJoCo's viewer draws, tendons and sites too, one picture after another.

    Use it from one thread only, as OpenGL demands. MUJOCO_GL=egl or osmesa chooses the backend.
    Raises InputError without OpenGL.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        space: ParameterSpace,
        view: View,
        settings: PictureSettings,
    ):
        self.size = size = settings.points(view)
        quality = settings.quality
        self._model = copy.copy(model)
        self._model.cam_sensorsize[:] = 0  # the field of view is vertical, as for every renderer
        self._writer = ModelWriter(space, self._model)
        self._written: np.ndarray | None = None
        self._data = mujoco.MjData(self._model)
        self._view = mujoco.MjvCamera()
        self._view.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._view.fixedcamid = model.camera(view.camera).id
        self._option = mujoco.MjvOption()
        self._scene = mujoco.MjvScene(self._model, maxgeom=_MAX_GEOMS)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = quality.shadow_map_px > 0
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = quality.reflections
        # read when a context is made
        self._model.vis.global_.offheight, self._model.vis.global_.offwidth = size
        finest = _TEXELS_PER_PIXEL * max(size)
        self._model.vis.quality.shadowsize = min(quality.shadow_map_px, finest)
        self._model.vis.quality.offsamples = quality.multisamples
        self._canvas = _Canvas(self._model, size)

    def render(
        self, states: np.ndarray, parameters: np.ndarray, stray: StrayLight | None = None
    ) -> np.ndarray:
        """(n, S) states, (n, N) parameters to (n, H, W, 3) uint8 RGB."""
        model, data, scene = self._model, self._data, self._scene
        frames = np.empty((len(states), *self.size, 3), np.uint8)
        for frame, state, values in zip(frames, states, parameters, strict=True):
            if self._written is None or not np.array_equal(self._written, values):
                self._writer.write(model, values)
                self._written = np.array(values)
            mujoco.mj_setState(model, data, state, _FULL_STATE)
            mujoco.mj_fwdPosition(model, data)
            mujoco.mjv_updateScene(model, data, self._option, None, self._view, _ALL, scene)
            self._canvas.draw(scene, frame)
        return frames

    def covers(self, states: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """(n, H, W) True: the model's background is drawn."""
        return np.ones((len(states), *self.size), bool)

    def __del__(self) -> None:
        if hasattr(self, "_canvas"):
            self._canvas.close()


class _Canvas:
    """An OpenGL context and MuJoCo's resources in it. Raises InputError without OpenGL."""

    def __init__(self, model: mujoco.MjModel, size: tuple[int, int]):
        height, width = size
        self._rectangle = mujoco.MjrRect(0, 0, width, height)
        self._gl = _make_gl_context(width, height)
        try:
            self._mjr = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        except mujoco.FatalError as error:  # GLX without a display makes a context of nothing
            self._gl.free()
            raise InputError(_no_opengl(str(error))) from error
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._mjr)
        atexit.register(self.close)  # before EGL, which also ends at exit and would complain

    def draw(self, scene: mujoco.MjvScene, frame: np.ndarray) -> None:
        """Draw into `frame`, (H, W, 3) uint8."""
        self._gl.make_current()  # another renderer may have been current
        mujoco.mjr_render(self._rectangle, scene, self._mjr)
        upside_down = np.empty_like(frame)
        mujoco.mjr_readPixels(upside_down, None, self._rectangle, self._mjr)
        frame[:] = upside_down[::-1]

    def close(self) -> None:
        """Free both."""
        atexit.unregister(self.close)
        self._gl.make_current()
        self._mjr.free()
        self._gl.free()


def _make_gl_context(width: int, height: int):
    """A current GLContext, by MUJOCO_GL or, on Linux, of EGL or else OSMesa."""
    backend = os.environ.get("MUJOCO_GL", "").lower().strip()
    if not backend and sys.platform == "linux":
        there = [name for name, library in _HEADLESS.items() if find_library(library)]
        if not there:
            raise InputError(_no_opengl("neither EGL nor OSMesa is installed"))
        backend = there[0]
    module = f"mujoco.{backend}" if backend in _HEADLESS else "mujoco.gl_context"
    try:
        # Imported only here: it fixes the backend for the whole process.
        context = importlib.import_module(module).GLContext(width, height)
        context.make_current()
    except Exception as error:  # each backend and platform fails differently
        raise InputError(_no_opengl(f"{backend or 'OpenGL'} does not start")) from error
    return context


def _no_opengl(why: str) -> str:
    return (
        f"the opengl renderer cannot be used: {why}; install it (on Debian: apt install libegl1 "
        "libgl1, or libosmesa6) or use the raycaster"
    )
