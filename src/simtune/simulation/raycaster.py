"""mujoco_warp's batch ray caster: CPU or CUDA, no OpenGL, no display."""

import copy
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from functools import partial
from queue import SimpleQueue
from threading import Lock

import mujoco
import mujoco_warp
import numpy as np
import warp
from mujoco.batch import Batch

from simtune.parameters import ModelWriter, ParameterSpace, field_of
from simtune.simulation import packing
from simtune.simulation.backdrops import Backdrops
from simtune.simulation.packing import packed
from simtune.simulation.plate import before_plate, check_stands_still
from simtune.simulation.primitives import Primitives
from simtune.simulation.sky import can_turn, smooth_sky
from simtune.simulation.stray_light import StrayLight
from simtune.simulation.worlds import no_printed_warnings

# Pictures per launch: on a CPU they fit the cache, and still amortise the launch
_CHUNK, _GPU_CHUNK = 64, 1024
_POSES = ("geom_xpos", "geom_xmat", "cam_xpos", "cam_xmat", "light_xpos", "light_xdir")
_COMPILING = Lock()  # Warp builds modules one at a time
_LEFT_IN_SHADOW = 0.1  # of a lamp's light; `Primitives` take each room's own share
_GREY = 0xFF808080  # packed; of a background that is unknown


class Raycaster:
    """Draws geoms, meshes and flexes with lights and textures; no tendons and no sites.

    On a CPU with one render context per thread, since a context's launches run on one thread; on a
    GPU with one context. The sky of a camera that never turns is drawn once, smoothly, and put
    behind all pictures, which saves a third; for other cameras it is smoothed beforehand. Scenes of
    simple shapes are drawn by `Primitives`, on a CPU three times as fast.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        space: ParameterSpace,
        camera: str,
        size: tuple[int, int],
        num_threads: int = 0,
        sky_samples: int = 4,
        plate: np.ndarray | None = None,
        background_is_unknown: bool = False,
        device: str = "cpu",
    ):
        """`sky_samples` per pixel and axis: stars are smaller than pixels and would sparkle.

        `size`: (height, width) of pictures. `plate`: (height, width, 3) uint8 RGB in place of the
        sky and of static geoms, see `before_plate`. An unknown background is a random picture in
        their place. `device`: cpu, cuda or cuda:N. Raises InputError for a plate with a camera that
        moves.
        """
        init_warp(device)
        self.size, self._device = size, device
        num_threads = num_threads or _num_cores()
        is_cpu = device == "cpu"
        self._num_threads = num_threads if is_cpu else 1
        self._chunk = _CHUNK if is_cpu else _GPU_CHUNK
        sky = None
        if plate is not None:
            check_stands_still(model, camera)
            model, sky = before_plate(model, space), packed(plate)
        elif background_is_unknown:
            model, sky = before_plate(model, space), np.full(size, _GREY, np.uint32)
        elif can_turn(model, space, model.camera(camera).id):
            model = smooth_sky(model, model.cam_fovy[model.camera(camera).id] / size[0])
        else:
            sky = _constant_sky(model, camera, size, sky_samples)
        self._idle: SimpleQueue[_Context] = SimpleQueue()
        for _ in range(self._num_threads):
            threads = 1 if is_cpu else num_threads
            self._idle.put(_Context(model, space, camera, size, sky, self._chunk, threads))
        self._pool = ThreadPoolExecutor(self._num_threads)
        self._backdrops = Backdrops(size) if background_is_unknown else None

    def render(
        self, states: np.ndarray, parameters: np.ndarray, stray: StrayLight | None = None
    ) -> np.ndarray:
        """(n, S) states, (n, N) parameters to (n, H, W, 3) uint8 RGB.

        `stray`: of each. Only `Primitives` draw all of it. Others draw shadows only, all equally
        dark, and where the model's own lamps throw them. Without it unknown backgrounds are grey.
        """
        stray = stray or StrayLight.none(len(states))
        frames = np.empty((len(states), *self.size, 3), np.uint8)

        def draw(context: "_Context", chunk: slice) -> None:
            backdrops = stray.backdrop[chunk]
            behind = self._backdrops.of(backdrops) if self._backdrops and backdrops.any() else None
            context.render(states[chunk], parameters[chunk], stray.of(chunk), frames[chunk], behind)

        self._in_threads(draw, len(states))
        return frames

    def covers(self, states: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """See `Renderer`."""
        covered = np.ones((len(states), *self.size), bool)

        def cast(context: "_Context", chunk: slice) -> None:
            none = StrayLight.none(len(states[chunk]))
            pixels = context.cast(states[chunk], parameters[chunk], none).numpy()
            drawn = pixels[: len(none.shadow)] != packing.NOTHING
            covered[chunk] = drawn.reshape(-1, *self.size)

        if self._backdrops:
            self._in_threads(cast, len(states))
        return covered

    def _in_threads(self, work: Callable[["_Context", slice], None], num: int) -> None:
        """`num` pictures in chunks, each by a thread that has a context for itself."""
        warp.set_device(self._device)  # mujoco_warp launches on the present one
        step = min(self._chunk, max(1, -(-num // self._num_threads)))  # work for each thread

        def do(start: int) -> None:
            context = self._idle.get()
            try:
                work(context, slice(start, start + step))
            finally:
                self._idle.put(context)

        with no_printed_warnings():  # diverged worlds are drawn, too
            list(self._pool.map(do, range(0, num, step)))


def _num_cores() -> int:
    """Cores that this process may use, which may be fewer than the machine has."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class _Context:
    """One thread's worlds for the poses, and Warp's copies of model and data."""

    def __init__(self, model, space, camera, size, sky, num_worlds, num_threads):
        self._num_worlds = num_worlds
        self._worlds = Batch(model, num_worlds, nthread=num_threads)
        self._writer = ModelWriter(space, model)
        fields = {p.field for p in space}
        self._drawn = sorted(f for f in fields if field_of(f).is_drawn_per_world)
        self._written: np.ndarray | None = None
        self._casts_shadow = model.light_castshadow.astype(bool)  # (lights,)
        self._has_flexes = model.nflex > 0
        self._poses = (*_POSES, "flexvert_xpos") if self._has_flexes else _POSES
        for name in self._poses:
            self._worlds.bind(name)  # unbound fields are not computed
        with _COMPILING:
            self._model = mujoco_warp.put_model(model)
            self._data = mujoco_warp.make_data(model, nworld=num_worlds)
            self._make = partial(
                _make_context,
                model,
                camera,
                size,
                nworld=num_worlds,
                render_skybox=sky is None,
                use_precomputed_rays="cam_fovy" not in fields,
            )
            self._warp_context = self._make()
            self._with_shadows = None  # made when it is needed first: it takes time
            self._primitives: Primitives | None = None
            if Primitives.can_draw(self._warp_context):
                self._primitives = Primitives(model, self._warp_context)
            warp.load_module(packing, device=self._warp_context.rgb_data.device)
        num_pixels = size[0] * size[1]
        self._run = size[1] if self._warp_context.rgb_data.device.is_cpu else 1  # of pixels
        self._sky = _on_device(np.empty((0, num_pixels)) if sky is None else sky.reshape(1, -1))
        self._rgb = None
        if not self._warp_context.rgb_data.device.is_cpu:
            self._rgb = warp.empty((num_worlds, num_pixels, 3), dtype=warp.uint8)  # type: ignore

    def render(
        self,
        states: np.ndarray,
        parameters: np.ndarray,
        stray: StrayLight,
        frames: np.ndarray,
        behind: np.ndarray | None,
    ) -> None:
        """Draw n states, (n, S), into `frames`, (n, H, W, 3), perhaps before others."""
        n, pixels = len(states), self.cast(states, parameters, stray)
        sky = self._sky if behind is None else _on_device(packed(behind).reshape(n, -1))
        size, device = (n, pixels.shape[1], 3), pixels.device
        at = frames.ctypes.data
        shown = warp.array(ptr=at, shape=size, dtype=warp.uint8, device="cpu")  # type: ignore
        rgb = shown if device.is_cpu else self._rgb
        parts = n, size[1] // self._run
        warp.launch(packing.unpack, parts, [pixels, sky, self._run], [rgb], device=device)
        if rgb is not shown:
            warp.copy(shown, rgb, count=shown.size)
            warp.synchronize_device(device)

    def cast(self, states: np.ndarray, parameters: np.ndarray, stray: StrayLight) -> warp.array:
        """Packed pixels of n states, in the first of its rows, (·, H · W); `packing.NOTHING` where
        none is drawn."""
        n, worlds = len(states), self._worlds
        worlds.state[:n] = states
        self._write(parameters)
        worlds.forward(ids=np.arange(n), stage=mujoco.mjtStage.mjSTAGE_POS.value)
        for name in self._poses:
            assign(getattr(self._data, name), getattr(worlds, name))
        # Draw only these; but flexes' search trees have a fixed number of worlds.
        self._data.nworld = self._num_worlds if self._has_flexes else n
        return self._drawn_by(stray)

    def _drawn_by(self, stray: StrayLight) -> warp.array:
        if self._primitives:
            return self._primitives.draw(self._model, self._data, stray)
        context = self._shadowing(stray.shadow > 0) if stray.shadow.any() else self._warp_context
        with _COMPILING if context._megakernel is None else nullcontext():
            return _draw(self._model, self._data, context)

    def _shadowing(self, in_world: np.ndarray):
        """The render context of worlds of which those `in_world`, (n,) bool, have shadows."""
        if self._with_shadows is None:
            with _COMPILING:
                self._with_shadows = self._make(
                    use_shadows=True, shadow_light_fraction=_LEFT_IN_SHADOW
                )
        cast = np.zeros((self._num_worlds, len(self._casts_shadow)), bool)
        cast[: len(in_world)] = in_world[:, None] & self._casts_shadow
        device = self._model.light_castshadow.device
        self._model.light_castshadow = warp.array(cast, dtype=bool, device=device)
        return self._with_shadows

    def _write(self, parameters: np.ndarray) -> None:
        """Write (n, N) parameters, unless they equal the previous chunk's."""
        padded = parameters[np.arange(self._num_worlds) % len(parameters)]
        if self._written is not None and np.array_equal(self._written, padded):
            return
        self._writer.write_batch(self._worlds, padded)
        for name in self._drawn:
            values = np.ascontiguousarray(self._worlds.expand(name), np.float32)
            field = getattr(self._model, name)
            setattr(self._model, name, warp.array(values, dtype=field.dtype, device=field.device))
        self._written = padded


def init_warp(device: str = "cpu") -> None:
    """Start Warp without its output (its greeting, and that there is no CUDA), for a device."""
    warp.config.log_level = warp.LOG_WARNING
    stderr = os.dup(2)
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 2)  # below Python, since the library itself prints
    try:
        warp.init()
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)
    warp.set_device(device)


def _make_context(model, camera, size, **settings):
    return mujoco_warp.create_render_context(
        model,
        cam_res=size[::-1],
        cam_active=[camera],
        render_rgb=True,
        render_depth=False,
        render_seg=False,
        background_color=(0.0, 0.0, 0.0, 0.0),  # packs to _NOTHING
        **settings,
    )


def _draw(model, data, context) -> warp.array:
    """(nworld, H · W) packed pixels."""
    mujoco_warp.refit_bvh(model, data, context)
    mujoco_warp.render(model, data, context)
    return context.rgb_data


def _on_device(pixels: np.ndarray) -> warp.array:
    """Packed pixels, where the pictures are drawn."""
    return warp.array(np.ascontiguousarray(pixels, np.uint32), dtype=warp.uint32)


def assign(target, values: np.ndarray) -> None:
    shape = (*target.shape, *target.dtype._shape_)
    target.assign(np.ascontiguousarray(values, np.float32).reshape(shape))


def _constant_sky(
    model: mujoco.MjModel, camera: str, size: tuple[int, int], samples: int
) -> np.ndarray:
    """(H, W) packed pixels behind everything."""
    model = copy.copy(model)
    model.geom_rgba[:] = model.flex_rgba[:] = 0
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    context = _make_context(model, camera, size, render_skybox=True, samples_per_pixel=samples)
    pixels = _draw(mujoco_warp.put_model(model), mujoco_warp.put_data(model, data), context)
    return pixels.numpy().reshape(size).copy()
