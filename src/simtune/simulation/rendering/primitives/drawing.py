"""Planes, spheres, capsules, ellipsoids, cylinders and boxes, drawn fast.

mujoco_warp's ray caster draws much more, but begins anew at each pixel, with eighty arguments and a
search tree. Here what is constant over a picture is computed once, and geoms have bounding spheres:
the same pictures, on a CPU, where a thread draws a row, in a third of the time. With `StrayLight`,
planes reflect, and lights that cast shadows do so.
"""

from typing import Any

import mujoco
import numpy as np
import warp as wp
from mujoco_warp import Data, GeomType, Model, RenderContext
from mujoco_warp._src.render_util import texture_pixels

from simtune.simulation.rendering.primitives import gather, kernel
from simtune.simulation.rendering.primitives.gather import (
    Surroundings,
    gather_geoms,
    gather_lights,
)
from simtune.simulation.rendering.primitives.geoms import Geom
from simtune.simulation.rendering.primitives.kernel import Stray, draw
from simtune.simulation.rendering.primitives.light import DIRECTIONAL, Light
from simtune.simulation.rendering.stray_light import StrayLight

_MAX_GEOMS = 64  # as many as bits; with more, a search tree is faster than to test each
_STRAY = np.dtype(Stray.numpy_dtype())  # pyright: ignore
_PLANE_WIDTH_RATIO = 2.1  # of an endless plane to how far cameras see
# Flat faces are lit at the lines of grids, and textures dim highlights, too. mujoco_warp computes
# light at each pixel, and adds highlights afterwards.
_AS_OPENGL = True
_DRAWN = {GeomType.PLANE, GeomType.SPHERE, GeomType.CAPSULE}
_DRAWN |= {GeomType.ELLIPSOID, GeomType.CYLINDER, GeomType.BOX}


class Primitives:
    """Draws for a render context what mujoco_warp.render would, if it can."""

    @staticmethod
    def can_draw(context: RenderContext) -> bool:
        """Whether all of a context's geoms are primitives, and no shadows are asked for."""
        return (
            context.bvh_ngeom <= _MAX_GEOMS
            and {*context.geom_ray_types} <= _DRAWN
            and not (context.use_shadows or context.has_orthographic_camera)
        )

    def __init__(self, model: mujoco.MjModel, context: RenderContext):
        self._device = device = context.rgb_data.device
        for module in (gather, kernel):
            wp.load_module(module, device=device)  # compiles it
        self._context = context
        self._camera = int(context.cam_id_map.numpy()[0])
        self._run = int(context.cam_res.numpy()[0][0]) if device.is_cpu else 1  # of pixels
        self._half_height = _half_height(model.cam_fovy[self._camera])
        self._around = _surroundings(model, self._camera)
        self._headlight = _headlight(model)
        textures, texels = _textures(model)
        self._textures = wp.array(textures, dtype=wp.vec3i, device=device)
        self._texels = wp.array(texels, dtype=wp.vec3, device=device)
        n = len(context.rgb_data)
        ids = context.enabled_geom_ids
        self._geoms = wp.empty((n, len(ids)), dtype=Geom, device=device)  # type: ignore
        self._lights = wp.empty((n, model.nlight + 1), dtype=Light, device=device)  # type: ignore
        self._zooms = wp.ones(n, dtype=float, device=device)
        self._fovy: wp.array | None = None  # of the worlds, at which the rays have these zooms
        self._sky = (
            int(context.skybox_tex_id.numpy()[0]),
            1 / float(context.skybox_face_width.numpy()[0]),
        )

    def draw(self, model: Model, data: Data, stray: StrayLight) -> wp.array:
        """(nworld, H · W) packed pixels."""
        self._gather(model, data)
        self._zoom(model)
        context, strays = self._context, _strays(stray)
        wp.launch(
            draw,
            dim=(data.nworld, context.rgb_data.shape[1] // self._run),
            inputs=[
                context.ray,
                self._zooms,
                self._run,
                context.znear,
                context.zfar,
                data.cam_xpos,
                data.cam_xmat,
                self._camera,
                self._geoms,
                self._lights,
                self._shared(strays, Stray),
                self._texels,
                context.textures,
                *self._sky,
            ],
            outputs=[context.rgb_data],
            device=self._device,
        )
        return context.rgb_data

    def _gather(self, model: Model, data: Data) -> None:
        """Geoms and lights of all worlds, where the pictures are drawn."""
        wp.launch(
            gather_geoms,
            dim=(data.nworld, self._geoms.shape[1]),
            inputs=[
                self._context.enabled_geom_ids,
                model.geom_type,
                data.geom_xpos,
                data.geom_xmat,
                model.geom_size,
                model.geom_rgba,
                model.geom_matid,
                model.mat_rgba,
                model.mat_emission,
                model.mat_specular,
                model.mat_shininess,
                model.mat_texrepeat,
                model.mat_texuniform,
                self._textures,
                data.cam_xpos,
                self._around,
            ],
            outputs=[self._geoms],
            device=self._device,
        )
        wp.launch(
            gather_lights,
            dim=(data.nworld, self._lights.shape[1]),
            inputs=[
                model.light_type,
                data.light_xpos,
                data.light_xdir,
                model.light_attenuation,
                model.light_cutoff,
                model.light_exponent,
                model.light_castshadow,
                model.light_active,
                model.light_ambient,
                model.light_diffuse,
                model.light_specular,
                data.cam_xmat,
                self._camera,
                self._headlight,
            ],
            outputs=[self._lights],
            device=self._device,
        )

    def _zoom(self, model: Model) -> None:
        """Spacing of rays, relative to that at the nominal field of view, if that has changed."""
        if self._fovy is model.cam_fovy:
            return
        self._fovy = model.cam_fovy
        fovy = model.cam_fovy.numpy()[:, self._camera].astype(float)
        zooms = _half_height(fovy) / self._half_height
        self._zooms.assign(np.broadcast_to(zooms, len(self._zooms)))

    def _shared(self, structs: np.ndarray, dtype) -> wp.array:
        """As Warp sees them: on a CPU in place, valid while `structs` lives.

        By pointer, since given the array itself Warp compares dtypes at every call, which is slow,
        and once failed when two threads did so at the same time.
        """
        address = structs.ctypes.data
        in_place = wp.array(ptr=address, shape=structs.shape, dtype=dtype, device="cpu")
        return in_place.to(self._device)  # type: ignore


def _surroundings(model: mujoco.MjModel, camera: int) -> Any:  # a `Surroundings`
    around, headlight = Surroundings(), model.vis.headlight
    around.camera, around.as_opengl = camera, _AS_OPENGL
    around.ambient = wp.vec3(*headlight.ambient * bool(headlight.active))
    around.endless = _PLANE_WIDTH_RATIO * model.vis.map.zfar * model.stat.extent
    around.num_quads = float(model.vis.quality.numquads)
    return around


def _headlight(model: mujoco.MjModel) -> Any:  # a `Light`
    """Without its direction, which is the camera's."""
    light, headlight = Light(), model.vis.headlight
    light.kind = int(DIRECTIONAL)
    light.diffuse = wp.vec3(*headlight.diffuse * bool(headlight.active))
    light.specular = wp.vec3(*headlight.specular * bool(headlight.active))
    return light


def _strays(stray: StrayLight) -> np.ndarray:
    strays = np.zeros(len(stray.shadow), _STRAY)
    for name in _STRAY.fields or ():
        strays[name] = getattr(stray, name)
    return strays


def _half_height(fovy_deg: np.ndarray) -> np.ndarray:
    """Of the picture, at unit distance."""
    return np.tan(np.radians(fovy_deg) / 2)


def _textures(model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    """(nmat + 1, 3) first texel, width and height of each material's texture, and all texels."""
    textures = np.full((model.nmat + 1, 3), -1)  # the last one: no material
    texels, num_texels = [np.zeros((1, 3))], 1
    for material, texture in enumerate(model.mat_texid[:, mujoco.mjtTextureRole.mjTEXROLE_RGB]):
        if texture >= 0:
            image = texture_pixels(model, texture)
            height, width, num_channels = image.shape
            textures[material] = num_texels, width, height
            texels.append(np.zeros((height * width, 3)))
            texels[-1][:, :num_channels] = image.reshape(-1, num_channels)[:, :3] / 255
            num_texels += height * width
    return textures, np.concatenate(texels)
