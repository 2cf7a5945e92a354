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
from simtune.simulation.backdrops import Backdrops
from simtune.simulation.plate import before_plate, check_stands_still
from simtune.simulation.primitives import Primitives
from simtune.simulation.sky import can_turn, smooth_sky
from simtune.simulation.stray_light import StrayLight
from simtune.simulation.worlds import no_printed_warnings

_CHUNK = 64  # pictures per launch: fits the cache, and still amortises the launch
_POSES = ("geom_xpos", "geom_xmat", "cam_xpos", "cam_xmat", "light_xpos", "light_xdir")
_COMPILING = Lock()  # Warp builds modules one at a time
_LEFT_IN_SHADOW = 0.1  # of a lamp's light; `Primitives` take each room's own share
_GREY = 0xFF808080  # packed; of a background that is unknown
_NOTHING = 0  # packed pixel of a ray without a hit; drawn ones are opaque, so never 0


class Raycaster:
    """Draws geoms, meshes and flexes with lights and textures; no tendons and no sites.

    One render context per thread, since a context's launches run on one thread. The sky of a camera
    that never turns is drawn once, smoothly, and put behind all pictures, which saves a third; for
    other cameras it is smoothed beforehand. Scenes of simple shapes are drawn by `Primitives` on a
    CPU, three times as fast.
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
    ):
        """`sky_samples` per pixel and axis: stars are smaller than pixels and would sparkle.

        `size`: (height, width) of pictures. `plate`: (height, width, 3) uint8 RGB in place of the
        sky and of static geoms, see `before_plate`. An unknown background is a random picture in
        their place. Raises InputError for a plate with a camera that moves.
        """
        init_warp()
        self.size = size
        self._num_threads = num_threads or _num_cores()
        sky = None
        if plate is not None:
            check_stands_still(model, camera)
            model, sky = before_plate(model, space), _packed(plate)
        elif background_is_unknown:
            model, sky = before_plate(model, space), np.full(size, _GREY, np.uint32)
        elif can_turn(model, space, model.camera(camera).id):
            model = smooth_sky(model, model.cam_fovy[model.camera(camera).id] / size[0])
        else:
            sky = _constant_sky(model, camera, size, sky_samples)
        self._idle: SimpleQueue[_Context] = SimpleQueue()
        for _ in range(self._num_threads):
            self._idle.put(_Context(model, space, camera, size, sky))
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
            pixels = context.cast(states[chunk], parameters[chunk], none)
            covered[chunk] = pixels.reshape(-1, *self.size) != _NOTHING

        if self._backdrops:
            self._in_threads(cast, len(states))
        return covered

    def _in_threads(self, work: Callable[["_Context", slice], None], num: int) -> None:
        """`num` pictures in chunks, each by a thread that has a context for itself."""
        step = min(_CHUNK, max(1, -(-num // self._num_threads)))  # work for each thread

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

    def __init__(self, model, space, camera, size, sky):
        self._worlds = Batch(model, _CHUNK, nthread=1)
        self._writer = ModelWriter(space, model)
        fields = {p.field for p in space}
        self._drawn = sorted(f for f in fields if field_of(f).is_drawn_per_world)
        self._written: np.ndarray | None = None
        self._sky = sky  # (H, W) uint32 or None
        self._casts_shadow = model.light_castshadow.astype(bool)  # (lights,)
        self._has_flexes = model.nflex > 0
        self._poses = (*_POSES, "flexvert_xpos") if self._has_flexes else _POSES
        for name in self._poses:
            self._worlds.bind(name)  # unbound fields are not computed
        with _COMPILING:
            self._model = mujoco_warp.put_model(model)
            self._data = mujoco_warp.make_data(model, nworld=_CHUNK)
            self._make = partial(
                _make_context,
                model,
                camera,
                size,
                nworld=_CHUNK,
                render_skybox=sky is None,
                use_precomputed_rays="cam_fovy" not in fields,
            )
            self._warp_context = self._make()
            self._with_shadows = None  # made when it is needed first: it takes time
            self._primitives: Primitives | None = None
            if Primitives.can_draw(self._warp_context):
                self._primitives = Primitives(model, self._warp_context)

    def render(
        self,
        states: np.ndarray,
        parameters: np.ndarray,
        stray: StrayLight,
        frames: np.ndarray,
        behind: np.ndarray | None,
    ) -> None:
        """Draw n <= _CHUNK states, (n, S), into `frames`, (n, H, W, 3), perhaps before others."""
        pixels = self.cast(states, parameters, stray).reshape(frames.shape[:-1])
        sky = self._sky if behind is None else _packed(behind)
        if sky is not None:
            np.copyto(pixels, sky, where=pixels == _NOTHING)
        _unpack(pixels, frames)

    def cast(self, states: np.ndarray, parameters: np.ndarray, stray: StrayLight) -> np.ndarray:
        """(n, H * W) packed pixels of n <= _CHUNK states; _NOTHING where none is drawn."""
        n, worlds = len(states), self._worlds
        worlds.state[:n] = states
        self._write(parameters)
        worlds.forward(ids=np.arange(n), stage=mujoco.mjtStage.mjSTAGE_POS.value)
        for name in self._poses:
            assign(getattr(self._data, name), getattr(worlds, name))
        # Draw only these; but flexes' search trees have a fixed number of worlds.
        self._data.nworld = _CHUNK if self._has_flexes else n
        return self._drawn_by(stray)[:n]

    def _drawn_by(self, stray: StrayLight) -> np.ndarray:
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
        cast = np.zeros((_CHUNK, len(self._casts_shadow)), bool)
        cast[: len(in_world)] = in_world[:, None] & self._casts_shadow
        device = self._model.light_castshadow.device
        self._model.light_castshadow = warp.array(cast, dtype=bool, device=device)
        return self._with_shadows

    def _write(self, parameters: np.ndarray) -> None:
        """Write (n, N) parameters, unless they equal the previous chunk's."""
        padded = parameters[np.arange(_CHUNK) % len(parameters)]
        if self._written is not None and np.array_equal(self._written, padded):
            return
        self._writer.write_batch(self._worlds, padded)
        for name in self._drawn:
            values = np.ascontiguousarray(self._worlds.expand(name), np.float32)
            field = getattr(self._model, name)
            setattr(self._model, name, warp.array(values, dtype=field.dtype, device=field.device))
        self._written = padded


def init_warp() -> None:
    """Start Warp without its output: its greeting, and that there is no CUDA."""
    warp.config.log_level = warp.LOG_WARNING
    stderr = os.dup(2)
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 2)  # below Python, since the library itself prints
    try:
        warp.init()
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)


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


def _draw(model, data, context) -> np.ndarray:
    """(nworld, H * W) uint32 pixels, packed as ARGB."""
    mujoco_warp.refit_bvh(model, data, context)
    mujoco_warp.render(model, data, context)
    return context.rgb_data.numpy()


def _packed(picture: np.ndarray) -> np.ndarray:
    """(..., 3) uint8 RGB to (...,) pixels, packed as ARGB."""
    opaque = np.full((*picture.shape[:-1], 1), 255, np.uint8)
    return np.concatenate([picture[..., ::-1], opaque], -1).view(np.uint32)[..., 0]


def _unpack(pixels: np.ndarray, frames: np.ndarray) -> None:
    """(n, H, W) pixels, packed as ARGB, into (n, H, W, 3) uint8 RGB."""
    bgra = pixels.view(np.uint8).reshape(*pixels.shape, 4)
    for channel in range(3):  # several times as fast as all at once
        frames[..., channel] = bgra[..., 2 - channel]


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
    return pixels.reshape(size).copy()
