"""What one thread needs to draw: its worlds for the poses, and Warp's copies of model and data."""

from contextlib import nullcontext
from functools import partial
from threading import Lock

import mujoco
import mujoco_warp
import numpy as np
import warp
from mujoco.batch import Batch
from mujoco_warp import RenderContext

from simtune.parameters import ModelWriter, ParameterSpace, field_of
from simtune.simulation.rendering import packing
from simtune.simulation.rendering.appearance import focus, kinds_of_lamps, most_matt
from simtune.simulation.rendering.packing import packed
from simtune.simulation.rendering.primitives.drawing import Primitives
from simtune.simulation.rendering.stray_light import StrayLight
from simtune.simulation.rendering.warp_context import assign, draw, make_context
from simtune.simulation.rendering.warp_model import put_model

_POSES = ("geom_xpos", "geom_xmat", "cam_xpos", "cam_xmat", "light_xpos", "light_xdir")
_COMPILING = Lock()  # Warp builds modules one at a time
_SHADOW_LIGHT_SHARE = 0.1  # of a lamp's light; `Primitives` take each room's own share


class Context:
    """One thread's worlds for the poses, and Warp's copies of model and data."""

    def __init__(
        self,
        model: mujoco.MjModel,
        space: ParameterSpace,
        camera: str,
        size: tuple[int, int],
        sky: np.ndarray | None,
        num_worlds: int,
        num_threads: int,
    ):
        """`size`: (height, width) of at most `num_worlds` pictures at once.

        `sky`: (H, W) packed pixels behind everything; None: the ray caster draws it.
        """
        self._num_worlds = num_worlds
        self._worlds = Batch(model, num_worlds, nthread=num_threads)
        self._writer = ModelWriter(space, model)
        fields = {p.field for p in space}
        self._drawn = sorted(f for f in fields if field_of(f).is_drawn_per_world)
        self._kinds_of_lamps = model.light_type.copy()  # (lights,)
        self._written: np.ndarray | None = None  # parameters of the last chunk
        self._casts_shadow = model.light_castshadow.astype(bool)  # (lights,)
        self._has_flexes = model.nflex > 0
        self._poses = (*_POSES, "flexvert_xpos") if self._has_flexes else _POSES
        for name in self._poses:
            self._worlds.bind(name)  # unbound fields are not computed
        self._make = partial(
            make_context,
            model,
            camera,
            size,
            fields,
            nworld=num_worlds,
            render_skybox=sky is None,
            use_precomputed_rays="cam_fovy" not in fields,
        )
        with _COMPILING:
            self._load_warp(model)
        self._prepare_unpacking(size, sky)

    def _load_warp(self, model: mujoco.MjModel) -> None:
        """Warp's copies of model and data, and what draws them."""
        self._model = put_model(model)
        self._data = mujoco_warp.make_data(model, nworld=self._num_worlds)
        self._warp_context = self._make()
        # Made when it is needed first: it takes time
        self._with_shadows: RenderContext | None = None
        self._primitives: Primitives | None = None
        if Primitives.can_draw(self._warp_context):
            self._primitives = Primitives(model, self._warp_context)
        self._device = self._warp_context.rgb_data.device
        warp.load_module(packing, device=self._device)

    def _prepare_unpacking(self, size: tuple[int, int], sky: np.ndarray | None) -> None:
        """What packed pixels become pictures with."""
        num_pixels = size[0] * size[1]
        self._sky = self._pixels(np.empty((0, num_pixels)) if sky is None else sky.reshape(1, -1))
        is_cpu = self._device.is_cpu
        self._run = size[1] if is_cpu else 1  # of pixels that a thread unpacks
        self._rgb: warp.array | None = None  # on a GPU, where pictures are copied from
        if not is_cpu:
            shape = self._num_worlds, num_pixels, 3
            self._rgb = warp.empty(shape, dtype=warp.uint8)  # type: ignore

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
        sky = self._sky if behind is None else self._pixels(packed(behind).reshape(n, -1))
        size = n, pixels.shape[1], 3
        in_place = {"ptr": frames.ctypes.data, "device": "cpu"}
        shown = warp.array(shape=size, dtype=warp.uint8, **in_place)  # type: ignore
        rgb = shown if self._rgb is None else self._rgb
        parts = n, size[1] // self._run
        warp.launch(packing.unpack, parts, [pixels, sky, self._run], [rgb], device=self._device)
        if rgb is not shown:
            warp.copy(shown, rgb, count=shown.size)
            warp.synchronize_device(self._device)

    def cast(self, states: np.ndarray, parameters: np.ndarray, stray: StrayLight) -> warp.array:
        """Packed pixels of n states, in the first of its rows, (·, H · W); `packing.NOTHING` where
        none is drawn."""
        n, worlds = len(states), self._worlds
        worlds.state[:n] = states
        self._write(parameters)
        worlds.forward(ids=np.arange(n), stage=mujoco.mjtStage.mjSTAGE_POS.value)
        # Draw only these; but flexes' search trees have a fixed number of worlds.
        num = self._data.nworld = self._num_worlds if self._has_flexes else n
        for name in self._poses:
            assign(getattr(self._data, name), getattr(worlds, name)[:num])
        return self._drawn_by(stray)

    def _drawn_by(self, stray: StrayLight) -> warp.array:
        if self._primitives:
            return self._primitives.draw(self._model, self._data, stray)
        context = self._shadowing(stray.shadow > 0) if stray.shadow.any() else self._warp_context
        with _COMPILING if context._megakernel is None else nullcontext():
            return draw(self._model, self._data, context)

    def _shadowing(self, in_world: np.ndarray) -> RenderContext:
        """The render context of worlds of which those `in_world`, (n,) bool, have shadows."""
        if self._with_shadows is None:
            with _COMPILING:
                self._with_shadows = self._make(
                    use_shadows=True, shadow_light_fraction=_SHADOW_LIGHT_SHARE
                )
        cast = np.zeros((self._num_worlds, len(self._casts_shadow)), bool)
        cast[: len(in_world)] = in_world[:, None] & self._casts_shadow
        device = self._model.light_castshadow.device
        self._model.light_castshadow = warp.array(cast, dtype=bool, device=device)
        return self._with_shadows

    def _pixels(self, pixels: np.ndarray) -> warp.array:
        """Packed ones, where the pictures are drawn."""
        whole = np.ascontiguousarray(pixels, np.uint32)
        return warp.array(whole, dtype=warp.uint32, device=self._device)

    def _write(self, parameters: np.ndarray) -> None:
        """Write (n, N) parameters, unless they equal the previous chunk's."""
        padded = parameters[np.arange(self._num_worlds) % len(parameters)]
        if self._written is not None and np.array_equal(self._written, padded):
            return
        self._writer.write_batch(self._worlds, padded)
        values = {name: self._worlds.expand(name).astype(np.float32) for name in self._drawn}
        for name, as_opengl in (("mat_shininess", most_matt), ("light_exponent", focus)):
            if name in values:
                values[name] = as_opengl(values[name])
        if "light_cutoff" in values:
            values["light_type"] = kinds_of_lamps(self._kinds_of_lamps, values["light_cutoff"])
        for name, drawn in values.items():
            drawn, field = np.ascontiguousarray(drawn), getattr(self._model, name)
            setattr(self._model, name, warp.array(drawn, dtype=field.dtype, device=field.device))
        self._written = padded
