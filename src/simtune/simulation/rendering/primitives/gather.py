# type: ignore
# ruff: noqa: UP018
# This is Warp's language, not Python: its types are others, and float(1.0) is a variable.
"""Kernels that gather what `draw` needs of each world, once per picture: its geoms and lights.

Arrays of mujoco_warp's model have a row for each world, or one row for all.
"""

from typing import Any

import warp as wp
from mujoco_warp import GeomType
from mujoco_warp._src import render

from simtune.parameters.model_writer import DEFAULT_GREY
from simtune.simulation.rendering.primitives.geoms import ENDLESS, Geom
from simtune.simulation.rendering.primitives.light import Light

_UNHIT_BOUND = wp.constant(1e30)
_UNSEEN_HIGHLIGHT = wp.constant(1e-5)  # share that changes no pixel
_BOUND_FACTOR = wp.constant(1.0 - 1e-5)  # for rounding
MOST_LINES = wp.constant(200)  # of a plane, along either axis
_DEFAULT_RGBA = wp.constant(wp.vec4(*DEFAULT_GREY))
_GLOW = wp.constant(render.DEFAULT_MAT_EMISSION)
_SPECULAR = wp.constant(render.DEFAULT_MAT_SPECULAR)
_SHININESS, _MAX_SHININESS = wp.constant(0.5), wp.constant(render.MAX_SHININESS)

wp.set_module_options({"enable_backward": False})


@wp.struct
class Surroundings:
    """What all geoms of a model share."""

    camera: int
    ambient: wp.vec3  # light of the headlight
    endless: float  # m, width of an endless plane
    num_quads: float  # along each side of a box
    as_opengl: bool  # see primitives


@wp.func
def _of(values: wp.array2d[Any], world: int, i: int):
    """A world's own value, or that of all."""
    return values[world % values.shape[0], i]


@wp.func
def _radius(kind: int, size: wp.vec3):
    """Of a bounding sphere."""
    if kind == GeomType.SPHERE:
        return size[0]
    if kind == GeomType.CAPSULE:
        return size[0] + size[1]
    if kind == GeomType.ELLIPSOID:
        return wp.max(size)
    if kind == GeomType.CYLINDER:
        return wp.sqrt(size[0] * size[0] + size[1] * size[1])
    if kind == GeomType.BOX:
        return wp.length(size)
    return ENDLESS


@wp.func
def _placed(kind: int, pos: wp.vec3, mat: wp.mat33, size: wp.vec3, eye: wp.vec3):
    """A geom where it is, and the rays from the eye that may meet it."""
    geom = Geom()
    geom.kind = kind
    geom.pos = pos
    geom.mat = mat
    geom.size = size
    geom.centre = geom.pos - eye
    geom.radius = _radius(geom.kind, geom.size)
    geom.bound = wp.length_sq(geom.centre) * _BOUND_FACTOR - geom.radius * geom.radius
    return geom


@wp.func
def _painted(geom: Geom, rgba: wp.vec4, specular: float, shininess: float):
    """The geom in its colour, which may be that of nothing, with its highlights."""
    geom.rgb = wp.vec3(rgba[0], rgba[1], rgba[2])
    if rgba[3] == 0.0:
        geom.bound = _UNHIT_BOUND
        geom.radius = -1.0
    geom.specular = specular
    geom.shininess = _MAX_SHININESS * shininess
    geom.shiny_from = float(2.0)
    if specular > 0.0 and geom.shininess > 0.0:
        geom.shiny_from = wp.pow(_UNSEEN_HIGHLIGHT, 2.0 / geom.shininess)
    return geom


@wp.func
def _lines_of_plane(geom: Geom, endless: float):
    """Distances of lines along a plane's axes, and the first: the third size is half a square.

    Those of an endless plane move with the camera, by whole tiles; those of another are an even
    number of squares, and a margin (`makePlane`, `mjv_updateScene` in MuJoCo).
    """
    lines, first = geom.size, -geom.size
    from_camera = -(wp.transpose(geom.mat) @ geom.centre)
    most = float(MOST_LINES)
    for axis in range(2):
        half = geom.size[axis]
        if half <= 0.0:
            tile = endless / (most - 2.0)
            if geom.repeat[axis] > 0.0:
                tile = 2.0 / geom.repeat[axis]
            lines[axis] = (endless + 2.0 * tile) / most
            first[axis] = 2.0 * tile * wp.rint(from_camera[axis] / (2.0 * tile))
        else:
            square = wp.max(wp.max(geom.size[2], half / (most - 2.0)), 1e-9)
            lines[axis] = 2.0 * square
            first[axis] = -2.0 * wp.floor(half / square / 2.0) * square
    return lines, first


@wp.func
def _as_in_opengl(geom: Geom, around: Surroundings):
    """The geom with the grid at whose lines its flat faces are lit."""
    geom.texture_last = True
    if geom.kind == GeomType.PLANE:
        geom.is_flat = True
        lines, first = _lines_of_plane(geom, around.endless)
        geom.lines = lines
        geom.first_line = first
    if geom.kind == GeomType.BOX:
        geom.is_flat = True
        geom.lines = 2.0 * geom.size / around.num_quads
        geom.first_line = -geom.size
    return geom


@wp.kernel
def gather_geoms(
    ids: wp.array[int],
    geom_type: wp.array[int],
    geom_xpos: wp.array2d[wp.vec3],
    geom_xmat: wp.array2d[wp.mat33],
    geom_size: wp.array2d[wp.vec3],
    geom_rgba: wp.array2d[wp.vec4],
    geom_matid: wp.array2d[int],
    mat_rgba: wp.array2d[wp.vec4],
    mat_emission: wp.array2d[float],
    mat_specular: wp.array2d[float],
    mat_shininess: wp.array2d[float],
    mat_texrepeat: wp.array2d[wp.vec2],
    mat_texuniform: wp.array2d[bool],
    textures: wp.array[wp.vec3i],
    cam_xpos: wp.array2d[wp.vec3],
    around: Surroundings,
    geoms: wp.array2d[Geom],
):
    world, i = wp.tid()
    at = ids[i]
    size, eye = _of(geom_size, world, at), cam_xpos[world, around.camera]
    geom = _placed(geom_type[at], geom_xpos[world, at], geom_xmat[world, at], size, eye)
    material = geom_matid[0, at]
    rgba = _of(geom_rgba, world, at)
    glow, specular, shininess = float(_GLOW), float(_SPECULAR), float(_SHININESS)
    geom.texture = textures[textures.shape[0] - 1]  # the last one: no material
    if material >= 0:
        if rgba == _DEFAULT_RGBA:
            rgba = _of(mat_rgba, world, material)
        glow = _of(mat_emission, world, material)
        specular = _of(mat_specular, world, material)
        shininess = _of(mat_shininess, world, material)
        geom.texture = textures[material]
        geom.repeat = _of(mat_texrepeat, world, material)
        geom.uniform = _of(mat_texuniform, world, material)
    geom.glow = wp.vec3(glow) + around.ambient
    geom = _painted(geom, rgba, specular, shininess)
    if around.as_opengl:
        geom = _as_in_opengl(geom, around)
    geoms[world, i] = geom


@wp.kernel
def gather_lights(
    light_type: wp.array2d[int],
    light_xpos: wp.array2d[wp.vec3],
    light_xdir: wp.array2d[wp.vec3],
    light_attenuation: wp.array2d[wp.vec3],
    light_cutoff: wp.array2d[float],
    light_exponent: wp.array2d[float],
    light_castshadow: wp.array2d[bool],
    light_active: wp.array2d[bool],
    light_ambient: wp.array2d[wp.vec3],
    light_diffuse: wp.array2d[wp.vec3],
    light_specular: wp.array2d[wp.vec3],
    cam_xmat: wp.array2d[wp.mat33],
    camera: int,
    of_camera: Light,
    lights: wp.array2d[Light],
):
    """The model's lights; the last one is the camera's."""
    world, i = wp.tid()
    light = of_camera
    if i < lights.shape[1] - 1:
        light.kind = _of(light_type, world, i)
        light.pos = light_xpos[world, i]
        light.direction = light_xdir[world, i]
        light.attenuation = _of(light_attenuation, world, i)
        light.cos_cutoff = wp.cos(wp.radians(_of(light_cutoff, world, i)))
        light.exponent = _of(light_exponent, world, i)
        light.casts = _of(light_castshadow, world, i)
        light.ambient = wp.vec3()
        light.diffuse = wp.vec3()
        light.specular = wp.vec3()
        if _of(light_active, world, i):
            light.ambient = _of(light_ambient, world, i)
            light.fills = wp.length_sq(light.ambient) > 0.0
            light.diffuse = _of(light_diffuse, world, i)
            light.specular = _of(light_specular, world, i)
    else:
        orientation = cam_xmat[world, camera]
        light.direction = -wp.vec3(orientation[0, 2], orientation[1, 2], orientation[2, 2])
    lights[world, i] = light
