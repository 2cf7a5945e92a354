"""mujoco_warp's batch ray caster: CPU or CUDA, no OpenGL, no display."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache, partial
from threading import Lock

import mujoco
import numpy as np
import warp

from simtune.cameras.pictures import pictures_at_once
from simtune.cameras.views import View
from simtune.errors import InputError
from simtune.parameters import ParameterSpace
from simtune.simulation.rendering import packing
from simtune.simulation.rendering.appearance import NUM_GROUPS, as_opengl_reads
from simtune.simulation.rendering.backdrops import Backdrops
from simtune.simulation.rendering.constant_sky import constant_sky
from simtune.simulation.rendering.packing import packed
from simtune.simulation.rendering.picture_settings import PictureSettings
from simtune.simulation.rendering.plate import before_plate, check_stands_still
from simtune.simulation.rendering.raycaster_context import Context
from simtune.simulation.rendering.sky import can_turn, smooth_sky
from simtune.simulation.rendering.stray_light import StrayLight
from simtune.simulation.rendering.warp_context import init_warp
from simtune.simulation.worlds import no_printed_warnings

_GREY = 0xFF808080  # packed; of a background that is unknown
_NOTHING_TO_DRAW = (
    "nothing can be drawn: the model has no geoms in the groups 0 to 2, which are those that are "
    "seen; give a geom to be seen one of these groups, or use no camera"
)
_MOST_WITH_FLEXES = 4
_MAX_ALONE_PIXELS = 16_000  # of a picture that a CPU draws alone, beside a GPU that learns


class Raycaster:
    """Draws geoms, meshes and flexes with lights and textures; no tendons and no sites.

    On a CPU with one render context per thread, since a context's launches run on one thread; on a
    GPU with one context, but a single small picture on the CPU even then. The sky of a camera that
    never turns is drawn once, smoothly, and put behind all pictures, which saves a third; for other
    cameras it is smoothed beforehand. Scenes of simple shapes are drawn by `Primitives`, on a CPU
    three times as fast.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        space: ParameterSpace,
        view: View,
        settings: PictureSettings,
        *,
        num_threads: int = 0,
    ):
        """A plate is drawn in place of the sky and of static geoms, see `before_plate`; if the
        background is unknown, a random picture. `num_threads`: 0: as many as there are cores.
        Raises InputError for a plate with a camera that moves, or if nothing of the model is drawn.
        """
        if not model.nflex and not (model.geom_group < NUM_GROUPS).any():
            raise InputError(_NOTHING_TO_DRAW)
        device = settings.device
        init_warp(device)
        self.size = size = settings.points(view)
        self._device = device
        num_threads = num_threads or _num_cores()
        is_cpu = device == "cpu"
        self._alone: Callable[[], Raycaster] | None = None  # draws one picture
        if not is_cpu and size[0] * size[1] <= _MAX_ALONE_PIXELS:
            on_cpu = replace(settings, device="cpu")
            self._alone = cache(partial(Raycaster, model, space, view, on_cpu, num_threads=1))
        self._num_threads = num_threads if is_cpu else 1
        self._chunk = pictures_at_once(device, *size)
        if is_cpu and model.nflex:  # which draw a whole chunk, however few pictures are asked for
            self._chunk = min(self._chunk, _MOST_WITH_FLEXES)
        model, sky = _with_sky(model, space, view, settings)
        threads = 1 if is_cpu else num_threads
        self._idle = [  # with the beginning of the chunk that each drew last; the latest is last
            (-1, Context(model, space, view.camera, size, sky, self._chunk, threads))
            for _ in range(self._num_threads)
        ]
        self._taking = Lock()
        self._pool = ThreadPoolExecutor(self._num_threads)
        self._backdrops = Backdrops(size) if view.background_is_unknown else None

    def render(
        self, states: np.ndarray, parameters: np.ndarray, stray: StrayLight | None = None
    ) -> np.ndarray:
        """(n, S) states, (n, N) parameters to (n, H, W, 3) uint8 RGB.

        `stray`: of each. Only `Primitives` draw all of it. Others draw shadows only, all equally
        dark, and where the model's own lamps throw them. Without it unknown backgrounds are grey.
        """
        if len(states) == 1 and self._alone:
            return self._alone().render(states, parameters, stray)
        stray = stray or StrayLight.none(len(states))
        frames = np.empty((len(states), *self.size, 3), np.uint8)

        def draw(context: Context, chunk: slice) -> None:
            backdrops = stray.backdrop[chunk]
            behind = self._backdrops.of(backdrops) if self._backdrops and backdrops.any() else None
            context.render(states[chunk], parameters[chunk], stray.of(chunk), frames[chunk], behind)

        self._in_threads(draw, len(states))
        return frames

    def covers(self, states: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """See `Renderer`."""
        covered = np.ones((len(states), *self.size), bool)

        def cast(context: Context, chunk: slice) -> None:
            none = StrayLight.none(len(states[chunk]))
            pixels = context.cast(states[chunk], parameters[chunk], none).numpy()
            drawn = pixels[: len(none.shadow)] != packing.NOTHING
            covered[chunk] = drawn.reshape(-1, *self.size)

        if self._backdrops:
            self._in_threads(cast, len(states))
        return covered

    def _in_threads(self, work: Callable[[Context, slice], None], num: int) -> None:
        """`num` pictures in chunks, each by a thread that has a context for itself."""
        warp.set_device(self._device)  # mujoco_warp launches on the present one
        step = min(self._chunk, max(1, -(-num // self._num_threads)))  # work for each thread

        def do(start: int) -> None:
            context = self._take(start)
            try:
                work(context, slice(start, start + step))
            finally:
                self._idle.append((start, context))

        with no_printed_warnings():  # diverged worlds are drawn, too
            list(self._pool.map(do, range(0, num, step)))

    def _take(self, start: int) -> Context:
        """An idle context, best the one that drew this chunk last: it has its worlds' parameters.

        Writing them takes as long as some pictures.
        """
        with self._taking:
            drew_it = [i for i, (began, _) in enumerate(self._idle) if began == start]
            return self._idle.pop(drew_it[-1] if drew_it else 0)[1]


def _with_sky(
    model: mujoco.MjModel, space: ParameterSpace, view: View, settings: PictureSettings
) -> tuple[mujoco.MjModel, np.ndarray | None]:
    """The model to draw, and (H, W) packed pixels behind it; None: its own sky, drawn.

    Before a plate or an unknown background most of what stands still is hidden; see `before_plate`.
    """
    model, camera, size = as_opengl_reads(model), view.camera, settings.points(view)
    if view.plate is not None:
        check_stands_still(model, camera)
        k = settings.supersampling
        return before_plate(model, space), packed(view.plate.repeat(k, 0).repeat(k, 1))
    if view.background_is_unknown:
        return before_plate(model, space), np.full(size, _GREY, np.uint32)
    number = model.camera(camera).id
    if can_turn(model, space, number):
        return smooth_sky(model, model.cam_fovy[number] / size[0]), None
    return model, constant_sky(model, camera, size)


def _num_cores() -> int:
    """Cores that this process may use, which may be fewer than the machine has."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
