"""mujoco_warp's batch ray caster: CPU or CUDA, no OpenGL, no display."""

from concurrent.futures import ThreadPoolExecutor
from os import cpu_count
from threading import Lock

import mujoco
import mujoco_warp
import numpy as np
import warp
from mujoco.batch import Batch

from simtune.parameters import ModelWriter, ParameterSpace

_CHUNK = 64  # pictures a launch: small enough to stay in the cache, large enough to amortise it
_POSES = ("geom_xpos", "geom_xmat", "cam_xpos", "cam_xmat", "light_xpos", "light_xdir")
# Model fields that the ray caster reads for each world; other parameters act through the poses.
_DRAWN_FIELDS = ("geom_rgba", "geom_size", "mat_rgba", "mat_emission", "mat_specular")
_DRAWN_FIELDS += ("mat_shininess", "cam_fovy", "light_diffuse", "light_ambient", "light_specular")
_COMPILING = Lock()  # Warp builds modules one at a time


class Raycaster:
    """Draws geoms, meshes and flexes with lights and textures; no tendons and no sites.

    One render context a thread, since a context's launches run on one thread. The sky of a
    camera that never turns is drawn once and put behind all pictures, which costs a third less.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        space: ParameterSpace,
        camera: str,
        image_size: int,
        num_threads: int = 0,
    ):
        warp.config.log_level = warp.LOG_WARNING
        self.image_size = image_size
        num_threads = num_threads or cpu_count() or 1
        drawn = [p.field for p in space if p.field in _DRAWN_FIELDS]
        moves_camera = any(p.field.startswith("cam_") for p in space)
        sky = None if moves_camera else _constant_sky(model, camera, image_size)
        self._contexts = [
            _Context(model, space, camera, image_size, sorted(set(drawn)), sky)
            for _ in range(num_threads)
        ]
        self._pool = ThreadPoolExecutor(num_threads)

    def render(self, states: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """(n, S) states, (n, N) parameters to (n, H, W, 3) uint8 RGB."""
        size = self.image_size
        frames = np.empty((len(states), size, size, 3), np.uint8)
        chunks = [slice(i, i + _CHUNK) for i in range(0, len(states), _CHUNK)]
        lanes = [chunks[i :: len(self._contexts)] for i in range(len(self._contexts))]

        def draw(context: "_Context", lane: list[slice]) -> None:
            for chunk in lane:
                frames[chunk] = context.render(states[chunk], parameters[chunk])

        list(self._pool.map(draw, self._contexts, lanes))
        return frames


class _Context:
    """What one thread needs: worlds for the poses, and Warp's copies of model and data."""

    def __init__(self, model, space, camera, image_size, drawn, sky):
        self._worlds = Batch(model, _CHUNK, nthread=1)
        self._writer = ModelWriter(space, model)
        self._drawn = drawn
        self._written: np.ndarray | None = None
        self._sky = sky  # (H, W) uint32 or None
        self._size = image_size
        for name in _POSES:
            self._worlds.bind(name)  # unbound fields are not computed
        with _COMPILING:
            self._model = mujoco_warp.put_model(model)
            self._data = mujoco_warp.make_data(model, nworld=_CHUNK)
            self._warp_context = _make_context(model, camera, image_size, _CHUNK, sky is None)

    def render(self, states: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        n, worlds = len(states), self._worlds
        worlds.state[:n] = states
        self._write(parameters)
        worlds.forward(ids=np.arange(n), stage=mujoco.mjtStage.mjSTAGE_POS.value)
        for name in _POSES:
            _assign(getattr(self._data, name), getattr(worlds, name))
        with _COMPILING if self._warp_context._megakernel is None else _NO_LOCK:
            pixels = _draw(self._model, self._data, self._warp_context)
        pixels = pixels[:n].reshape(n, self._size, self._size)
        if self._sky is not None:
            pixels = np.where(pixels == 0, self._sky, pixels)
        return _rgb(pixels)

    def _write(self, parameters: np.ndarray) -> None:
        """Write (n, N) parameters, unless they are those of the chunk before."""
        padded = np.concatenate([parameters, np.tile(parameters[:1], (_CHUNK - len(parameters), 1))])
        if self._written is not None and np.array_equal(self._written, padded):
            return
        self._writer.write_batch(self._worlds, padded)
        for name in self._drawn:
            values = np.ascontiguousarray(self._worlds.expand(name), np.float32)
            field = getattr(self._model, name)
            setattr(self._model, name, warp.array(values, dtype=field.dtype, device=field.device))
        self._written = padded


class _NoLock:
    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None


_NO_LOCK = _NoLock()


def _make_context(model, camera, image_size, num_worlds, with_sky):
    has_sky = (model.tex_type == mujoco.mjtTexture.mjTEXTURE_SKYBOX).any()
    return mujoco_warp.create_render_context(
        model,
        nworld=num_worlds,
        cam_res=(image_size, image_size),
        cam_active=[camera],
        render_rgb=True,
        render_depth=False,
        render_seg=False,
        render_skybox=bool(with_sky and has_sky),
        background_color=(0.0, 0.0, 0.0, 0.0),  # packs to 0, which no drawn pixel does
    )


def _draw(model, data, context) -> np.ndarray:
    """(nworld, H * W) uint32 pixels, packed as ARGB."""
    mujoco_warp.refit_bvh(model, data, context)
    mujoco_warp.render(model, data, context)
    return context.rgb_data.numpy()


def _rgb(pixels: np.ndarray) -> np.ndarray:
    """(..., H, W) packed pixels to (..., H, W, 3) uint8."""
    channels = np.ascontiguousarray(pixels).view(np.uint8).reshape(*pixels.shape, 4)
    return channels[..., 2::-1]


def _assign(target, values: np.ndarray) -> None:
    shape = (*target.shape, *target.dtype._shape_)
    target.assign(np.ascontiguousarray(values, np.float32).reshape(shape))


def _constant_sky(model: mujoco.MjModel, camera: str, image_size: int) -> np.ndarray | None:
    """(H, W) packed pixels behind everything, or None where the camera can turn."""
    index = model.camera(camera).id
    mode = model.cam_mode[index]
    turns_not = mode in (mujoco.mjtCamLight.mjCAMLIGHT_TRACK, mujoco.mjtCamLight.mjCAMLIGHT_TRACKCOM)
    if not turns_not and model.body_weldid[model.cam_bodyid[index]] != 0:
        return None
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    warp_model = mujoco_warp.put_model(model)
    warp_data = mujoco_warp.put_data(model, data, nworld=1)
    invisible = np.zeros((1, model.ngeom, 4), np.float32)
    warp_model.geom_rgba = warp.array(invisible, dtype=warp.vec4)
    context = _make_context(model, camera, image_size, 1, with_sky=True)
    return _draw(warp_model, warp_data, context).reshape(image_size, image_size).copy()
