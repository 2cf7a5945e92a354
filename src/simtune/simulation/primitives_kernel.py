# type: ignore
# ruff: noqa: RUF046, UP018
# This is Warp's language, not Python: its types are others, and float(1.0) is a variable.
"""The kernel that draws rows of pixels: each looks for the nearest geom and adds the lights up."""

import warp as wp
from mujoco_warp import GeomType
from mujoco_warp._src import ray, render
from mujoco_warp._src.render_util import pack_rgba_to_uint32

from simtune.simulation.primitives_geoms import Geom, first_hit, intersect, texture_at

SPOT, DIRECTIONAL = wp.constant(0), wp.constant(1)  # the other kinds shine everywhere
BACKGROUND = wp.constant(wp.uint32(0))
_OFF = wp.constant(1e-4)  # m, by which rays begin off a surface, not to meet it at once
_ENDLESS = wp.constant(1e6)

wp.set_module_options({"enable_backward": False, "fast_math": True})


@wp.struct
class Light:
    """A light of one world, in the world's frame."""

    kind: int
    pos: wp.vec3
    direction: wp.vec3
    attenuation: wp.vec3
    cos_cutoff: float
    exponent: float
    casts: bool  # shadows
    diffuse: wp.vec3
    specular: wp.vec3


@wp.struct
class Stray:
    """Of one world; see `StrayLight`."""

    shadow: float
    mirror: float
    aside: wp.vec3


@wp.func
def _reflect(
    light: Light,
    stray: Stray,
    geoms: wp.array2d[Geom],
    world: int,
    geom: Geom,
    rgb: wp.vec3,
    point: wp.vec3,
    normal: wp.vec3,
    to_eye: wp.vec3,
):
    """What of a light reaches the eye: Blinn and Phong's model, as OpenGL's."""
    strength = float(1.0)
    to_light = -light.direction
    far = float(_ENDLESS)
    if light.kind != DIRECTIONAL:
        distance = wp.length(light.pos - point)
        to_light = (light.pos - point) / distance
        far = distance
        powers = wp.vec3(1.0, distance, distance * distance)
        strength = 1.0 / wp.max(wp.dot(light.attenuation, powers), 1e-15)
        if light.kind == SPOT:
            cos = -wp.dot(to_light, light.direction)
            strength *= wp.pow(wp.max(cos, 0.0), light.exponent)
            if cos < light.cos_cutoff:
                strength = 0.0
    facing = wp.dot(normal, to_light) * strength
    if facing <= 0.0:
        return wp.vec3()
    if stray.shadow > 0.0 and light.casts:
        towards = wp.normalize(to_light + stray.aside)
        hidden_by, _there, _normal = first_hit(geoms, world, point + _OFF * normal, towards, far)
        if hidden_by >= 0:
            facing *= 1.0 - stray.shadow
            strength *= 1.0 - stray.shadow
    reflected = wp.cw_mul(rgb, light.diffuse) * facing
    half = to_light + to_eye
    cos = wp.max(wp.dot(normal, half), 0.0)
    squared = cos * cos / wp.dot(half, half)
    if squared > geom.shiny_from:
        shine = wp.pow(squared, 0.5 * geom.shininess)
        reflected += light.specular * (geom.specular * shine * strength)
    return reflected


@wp.func
def _shade(
    geoms: wp.array2d[Geom],
    lights: wp.array2d[Light],
    stray: Stray,
    texels: wp.array[wp.vec3],
    world: int,
    hit: int,
    point: wp.vec3,
    normal: wp.vec3,
    to_eye: wp.vec3,
):
    """What reaches the eye from a point of a geom, 1 for the full scale."""
    geom = geoms[world, hit]
    rgb = geom.rgb
    if geom.texture[0] >= 0:
        rgb = wp.cw_mul(rgb, texture_at(geom, texels, point, normal))
    light = wp.cw_mul(rgb, geom.glow)
    for i in range(lights.shape[1]):
        light += _reflect(lights[world, i], stray, geoms, world, geom, rgb, point, normal, to_eye)
    return wp.max(wp.min(light, wp.vec3(1.0)), wp.vec3(0.0))


@wp.kernel
def draw_row(
    rays: wp.array[wp.vec3],
    zooms: wp.array[float],
    width: int,
    far: float,
    cam_xpos: wp.array2d[wp.vec3],
    cam_xmat: wp.array2d[wp.mat33],
    camera: int,
    geoms: wp.array2d[Geom],
    lights: wp.array2d[Light],
    strays: wp.array[Stray],
    texels: wp.array[wp.vec3],
    skies: wp.array[wp.Texture2D],
    sky: int,
    sky_texel: float,
    pixels: wp.array2d[wp.uint32],
):
    """A row of each world's picture: the nearest geom of each ray, lit; else the sky."""
    world, row = wp.tid()
    origin = cam_xpos[world, camera]
    orientation = cam_xmat[world, camera]
    for pixel in range(row * width, (row + 1) * width):
        local = rays[pixel]
        if zooms[world] != 1.0:
            local = wp.normalize(
                wp.vec3(local[0] * zooms[world], local[1] * zooms[world], local[2])
            )
        direction = orientation @ local
        nearest = far / wp.max(-local[2], 1e-6)
        normal = wp.vec3()
        hit = int(-1)
        for i in range(geoms.shape[1]):
            along = wp.dot(geoms[world, i].centre, direction)
            bound = geoms[world, i].bound
            if bound <= 0.0 or (along > 0.0 and along * along >= bound):
                distance, outward = intersect(geoms[world, i], origin, direction)
                reach = nearest + ray.RAY_TOL_REL * wp.max(nearest, 1.0)  # of two, the later
                if distance >= 0.0 and distance <= reach and wp.dot(direction, outward) <= 0.0:
                    nearest, normal, hit = distance, outward, i
        if hit < 0:
            pixels[world, pixel] = BACKGROUND
            if sky >= 0:
                shade = 255.0 * render.sample_skybox(skies[sky], sky_texel, direction)
                pixels[world, pixel] = pack_rgba_to_uint32(shade[0], shade[1], shade[2], 255.0)
            continue
        point = origin + direction * nearest
        stray = strays[world]
        light = _shade(geoms, lights, stray, texels, world, hit, point, normal, -direction)
        if stray.mirror > 0.0 and geoms[world, hit].kind == GeomType.PLANE:
            mirrored = direction - 2.0 * wp.dot(direction, normal) * normal
            start = point + _OFF * normal
            seen, away, facing = first_hit(geoms, world, start, mirrored, _ENDLESS)
            if seen >= 0:
                image = start + mirrored * away
                its = _shade(geoms, lights, stray, texels, world, seen, image, facing, -mirrored)
                light = wp.lerp(light, its, stray.mirror)
        light = 255.0 * light
        pixels[world, pixel] = pack_rgba_to_uint32(light[0], light[1], light[2], 255.0)
