"""Planes, spheres, capsules, ellipsoids, cylinders and boxes, drawn fast on a CPU.

mujoco_warp's ray caster draws much more, but begins anew at each pixel, with eighty arguments and a
search tree. Here a thread draws a row of pixels, what is constant over a picture is computed once,
and geoms have bounding spheres: the same pictures, in a third of the time. With `StrayLight`,
planes reflect, and lights that cast shadows do so.
"""

import mujoco
import numpy as np
import warp as wp
from mujoco_warp import Data, GeomType, Model, RenderContext
from mujoco_warp._src import render
from mujoco_warp._src.render_util import texture_pixels

from simtune.simulation import primitives_kernel
from simtune.simulation.primitives_geoms import Geom
from simtune.simulation.primitives_kernel import DIRECTIONAL, Light, Stray, draw_row
from simtune.simulation.stray_light import StrayLight

_MAX_GEOMS = 64  # each pixel tests every geom; with more, a search tree is faster
_ENDLESS = 1e6  # radius of unbounded geoms
_NEVER = 1e30
_UNSEEN = 1e-5  # share of a highlight that changes no pixel
_GEOM = np.dtype(Geom.numpy_dtype())  # pyright: ignore
_LIGHT = np.dtype(Light.numpy_dtype())  # pyright: ignore
_STRAY = np.dtype(Stray.numpy_dtype())  # pyright: ignore
_MOST_LINES = 200  # of a plane, along either axis
_WIDTH = 2.1  # of an endless plane, relative to how far cameras see
_DRAWN = {GeomType.PLANE, GeomType.SPHERE, GeomType.CAPSULE}
_DRAWN |= {GeomType.ELLIPSOID, GeomType.CYLINDER, GeomType.BOX}


class Primitives:
    """Draws for a render context what mujoco_warp.render would, if it can."""

    @staticmethod
    def can_draw(context: RenderContext) -> bool:
        """Whether all of a context's geoms are primitives, on a CPU and without shadows."""
        return (
            context.rgb_data.device.is_cpu
            and context.bvh_ngeom <= _MAX_GEOMS
            and {*context.geom_ray_types} <= _DRAWN
            and not (context.use_shadows or context.has_orthographic_camera)
        )

    def __init__(self, model: mujoco.MjModel, context: RenderContext):
        wp.load_module(primitives_kernel, device="cpu")  # compiles it
        self._context = context
        self._camera = int(context.cam_id_map.numpy()[0])
        self._width, self._height = map(int, context.cam_res.numpy()[0])
        self._ids = context.enabled_geom_ids.numpy()
        self._half_height = _half_height(model.cam_fovy[self._camera])
        self._headlight = model.vis.headlight
        self._textures, self._texels = _textures(model)
        self._far = model.vis.map.zfar * model.stat.extent
        self._num_quads = model.vis.quality.numquads

    def draw(self, model: Model, data: Data, stray: StrayLight) -> np.ndarray:
        """(nworld, H * W) uint32 pixels, packed as ARGB, 0 for nothing."""
        context, strays = self._context, _strays(stray)
        geoms, lights = self._geoms(model, data), self._lights(model, data)
        wp.launch(
            draw_row,
            dim=(data.nworld, self._height),
            inputs=[
                context.ray,
                self._zooms(model, data.nworld),
                self._width,
                context.zfar,
                data.cam_xpos,
                data.cam_xmat,
                self._camera,
                _shared(geoms, Geom),
                _shared(lights, Light),
                _shared(strays, Stray),
                self._texels,
                context.textures,
                int(context.skybox_tex_id.numpy()[0]),
                1 / float(context.skybox_face_width.numpy()[0]),
            ],
            outputs=[context.rgb_data],
            device="cpu",
        )
        return context.rgb_data.numpy()

    def _zooms(self, model: Model, n: int) -> wp.array:
        """(n,) spacing of rays relative to that at the nominal field of view."""
        fovy = np.broadcast_to(model.cam_fovy.numpy()[:n, self._camera].astype(float), n)
        return wp.array(_half_height(fovy) / self._half_height, dtype=float, device="cpu")

    def _geoms(self, model: Model, data: Data) -> np.ndarray:
        n, ids = data.nworld, self._ids
        material = model.geom_matid.numpy()[0, ids]

        def of_material(field: wp.array, default: float) -> np.ndarray:
            with_default = np.insert(field.numpy()[:n], field.shape[1], default, axis=1)
            return with_default[:, material]  # the default is the last one, index -1

        geoms = np.zeros((n, len(ids)), _GEOM)
        geoms["kind"] = model.geom_type.numpy()[ids]
        geoms["pos"] = data.geom_xpos.numpy()[:n, ids]
        geoms["mat"] = data.geom_xmat.numpy()[:n, ids]
        geoms["size"] = model.geom_size.numpy()[:n, ids]
        geoms["centre"] = geoms["pos"] - data.cam_xpos.numpy()[:n, self._camera, None]
        squared = np.square(geoms["centre"]).sum(-1) * (1 - 1e-5)  # margin for rounding
        geoms["radius"] = _radius(geoms["kind"], geoms["size"])
        geoms["bound"] = squared - np.square(geoms["radius"])

        rgba = model.geom_rgba.numpy()[:n, ids]
        unpainted = (rgba == (0.5, 0.5, 0.5, 1)).all(-1, keepdims=True) & (material >= 0)[:, None]
        rgba = np.where(unpainted, of_material(model.mat_rgba, 0), rgba)
        geoms["rgb"] = rgba[..., :3]
        unseen = np.broadcast_to(rgba[..., 3] == 0, geoms.shape)
        geoms["bound"][unseen], geoms["radius"][unseen] = _NEVER, -1
        emission = of_material(model.mat_emission, render.DEFAULT_MAT_EMISSION)
        geoms["glow"] = emission[..., None] + self._ambient(model, n)[:, None]
        specular = of_material(model.mat_specular, render.DEFAULT_MAT_SPECULAR)
        exponent = render.MAX_SHININESS * of_material(model.mat_shininess, 0.5)
        geoms["specular"], geoms["shininess"] = specular, exponent
        shines = (specular > 0) & (exponent > 0)
        geoms["shiny_from"] = np.where(shines, _UNSEEN ** (2 / np.maximum(exponent, 1e-6)), 2)
        geoms["texture"] = self._textures[material]
        geoms["repeat"] = of_material(model.mat_texrepeat, 0)
        geoms["uniform"] = of_material(model.mat_texuniform, False)
        self._rule(geoms)
        return geoms

    def _rule(self, geoms: np.ndarray) -> None:
        """Rule flat faces with the lines at which OpenGL computes light.

        As MuJoCo does (`makePlane`, `mjv_updateScene`): a plane's squares have its third size as
        half of their sides, and a box has `numquads` along each.
        """
        size = geoms["size"].astype(float)
        is_plane, is_box = (geoms["kind"] == kind for kind in (GeomType.PLANE, GeomType.BOX))
        geoms["is_flat"] = is_plane | is_box
        # Of an endless plane they move with the camera, by whole tiles.
        untiled, repeat = _WIDTH * self._far / (_MOST_LINES - 2), geoms["repeat"]
        tile = np.where(repeat > 0, 2 / np.maximum(repeat, 1e-9), untiled)
        from_camera = -np.einsum("ngij,ngi->ngj", geoms["mat"], geoms["centre"])[..., :2]
        moved = 2 * tile * np.round(from_camera / (2 * tile))
        endless = (_WIDTH * self._far + 2 * tile) / _MOST_LINES
        # Of another they are an even number of squares, and a margin.
        half = size[..., :2]
        square = np.maximum(np.maximum(size[..., 2:], half / (_MOST_LINES - 2)), 1e-9)
        margin = half - 2 * np.floor(half / square / 2) * square
        is_endless = half <= 0
        lines, first = np.array(size), np.array(-size)
        lines[..., :2] = np.where(is_endless, endless, 2 * square)
        first[..., :2] = np.where(is_endless, moved, margin - half)
        of_box = is_box[..., None]
        geoms["lines"] = np.where(of_box, 2 * size / self._num_quads, lines)
        geoms["first_line"] = np.where(of_box, -size, first)

    def _ambient(self, model: Model, n: int) -> np.ndarray:
        """(n or 1, 3) ambient light."""
        if not self._headlight.active and not model.nlight:
            return np.full((1, 3), render.NO_LIGHT_AMBIENT_FALLBACK)
        active = model.light_active.numpy()[:n, :, None]
        of_lights = (model.light_ambient.numpy()[:n] * active).sum(axis=1)
        return of_lights + self._headlight.ambient * bool(self._headlight.active)

    def _lights(self, model: Model, data: Data) -> np.ndarray:
        """(n, L + 1) lights, the last one on the camera."""
        n = data.nworld
        lights = np.zeros((n, model.nlight + 1), _LIGHT)
        active = model.light_active.numpy()[:n, :, None]
        own, headlight = lights[:, :-1], lights[:, -1]
        own["kind"] = model.light_type.numpy()[:n]
        own["pos"] = data.light_xpos.numpy()[:n]
        own["direction"] = data.light_xdir.numpy()[:n]
        own["attenuation"] = model.light_attenuation.numpy()[:n]
        own["cos_cutoff"] = np.cos(np.deg2rad(model.light_cutoff.numpy()[:n]))
        own["casts"] = model.light_castshadow.numpy()[:n]
        own["exponent"] = model.light_exponent.numpy()[:n]
        own["diffuse"] = model.light_diffuse.numpy()[:n] * active
        own["specular"] = model.light_specular.numpy()[:n] * active
        headlight["kind"] = DIRECTIONAL
        headlight["direction"] = -data.cam_xmat.numpy()[:n, self._camera, :, 2]
        headlight["diffuse"] = self._headlight.diffuse * bool(self._headlight.active)
        headlight["specular"] = self._headlight.specular * bool(self._headlight.active)
        return lights


def _strays(stray: StrayLight) -> np.ndarray:
    strays = np.zeros(len(stray.shadow), _STRAY)
    for name in _STRAY.fields or ():
        strays[name] = getattr(stray, name)
    return strays


def _shared(structs: np.ndarray, dtype) -> wp.array:
    """As Warp sees them, in place: valid while `structs` lives.

    By pointer, since given the array itself Warp compares dtypes at every call, which is slow, and
    once failed when two threads did so at the same time.
    """
    return wp.array(ptr=structs.ctypes.data, shape=structs.shape, dtype=dtype, device="cpu")


def _half_height(fovy_deg: np.ndarray) -> np.ndarray:
    """Of the picture, at unit distance."""
    return np.tan(np.radians(fovy_deg) / 2)


def _radius(kind: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Of bounding spheres."""
    x, y, _ = np.moveaxis(size, -1, 0)
    shapes = [GeomType.SPHERE, GeomType.CAPSULE, GeomType.ELLIPSOID, GeomType.CYLINDER]
    radii = [x, x + y, size.max(-1), np.hypot(x, y), np.linalg.norm(size, axis=-1)]
    return np.select([kind == shape for shape in (*shapes, GeomType.BOX)], radii, _ENDLESS)


def _textures(model: mujoco.MjModel) -> tuple[np.ndarray, wp.array]:
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
    return textures, wp.array(np.concatenate(texels), dtype=wp.vec3, device="cpu")
