# type: ignore
# ruff: noqa: RUF046, UP018
# This is Warp's language, not Python: its types are others, and float(1.0) is a variable.
"""The kernel that draws pixels: each looks for the nearest geom and adds the lights up."""

import warp as wp
from mujoco_warp import GeomType
from mujoco_warp._src import ray, render
from mujoco_warp._src.render_util import pack_rgba_to_uint32

from simtune.simulation.rendering.packing import NOTHING
from simtune.simulation.rendering.primitives.geoms import (
    ENDLESS,
    Geom,
    first_hit,
    intersect,
    texture_at,
)
from simtune.simulation.rendering.primitives.light import (
    DIRECTIONAL,
    Light,
    reflect,
    reflect_flat,
    way_to,
)

_OFFSET_M = wp.constant(1e-4)  # off a surface, not to meet it at once

wp.set_module_options({"enable_backward": False, "fast_math": True})


@wp.struct
class Stray:
    """Of one world; see `StrayLight`."""

    shadow: float
    mirror: float
    aside: wp.vec3


@wp.func
def _left_by_shadows(
    light: Light,
    stray: Stray,
    geoms: wp.array2d[Geom],
    world: int,
    point: wp.vec3,
    normal: wp.vec3,
):
    """The share of a light that reaches a point."""
    if stray.shadow <= 0.0 or not light.casts:
        return float(1.0)
    to_light, far = way_to(light, point)
    towards = wp.normalize(to_light + stray.aside)
    hidden_by, _there, _normal = first_hit(geoms, world, point + _OFFSET_M * normal, towards, far)
    if hidden_by >= 0:
        return 1.0 - stray.shadow
    return float(1.0)


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
    eye: wp.vec3,
):
    """What reaches the eye from a point of a geom, 1 for the full scale.

    OpenGL draws a picture in the light of each lamp that casts shadows, and one in all the others',
    and adds them up. In each, what meets a texture is at most 1: `full`, times the texture.
    """
    geom = geoms[world, hit]
    rgb = geom.rgb
    full = wp.vec3(1.0)
    if geom.texture[0] >= 0:
        texel = texture_at(geom, texels, point, normal)
        rgb = wp.cw_mul(rgb, texel)
        if geom.texture_last:
            full = texel
    light = wp.cw_mul(rgb, geom.glow)
    together = wp.cw_mul(rgb, geom.glow)
    for i in range(lights.shape[1]):
        lamp = lights[world, i]
        if geom.is_flat and lamp.kind != DIRECTIONAL:
            reflected = reflect_flat(lamp, geom, rgb, full, point, normal, eye)
        else:
            reflected = reflect(lamp, geom, rgb, full, point, normal, eye)
        if wp.dot(reflected, reflected) > 0.0:
            reflected *= _left_by_shadows(lamp, stray, geoms, world, point, normal)
            if lamp.casts:
                reflected = wp.min(reflected, full)
            else:
                together += reflected
            light += reflected
    light -= wp.max(together - full, wp.vec3(0.0))
    return wp.max(wp.min(light, wp.vec3(1.0)), wp.vec3(0.0))


@wp.func
def _pack(light: wp.vec3):
    """0 to 1 to the nearest level of 255, as OpenGL does; packing alone cuts off."""
    return pack_rgba_to_uint32(
        255.0 * light[0] + 0.5, 255.0 * light[1] + 0.5, 255.0 * light[2] + 0.5, 255.0
    )


@wp.func
def _met_by_row(geoms: wp.array2d[Geom], world: int, across: wp.vec3):
    """A bit for each geom that a row's rays may meet; `across` is normal to the plane of these."""
    met = wp.uint64(0)
    for i in range(geoms.shape[1]):
        centre = geoms[world, i].centre
        off = wp.dot(centre, across)
        if off * off <= wp.length_sq(centre) - geoms[world, i].bound:
            met = met | (wp.uint64(1) << wp.uint64(i))
    return met


@wp.func
def _nearest(
    geoms: wp.array2d[Geom],
    world: int,
    met: wp.uint64,
    origin: wp.vec3,
    direction: wp.vec3,
    closest: float,
    farthest: float,
):
    """The nearest geom that a ray from the camera meets (-1: none), its distance and normal.

    `met`: the bits of those that it may meet.
    """
    nearest = farthest
    normal = wp.vec3()
    hit = int(-1)
    for i in range(geoms.shape[1]):
        if ((met >> wp.uint64(i)) & wp.uint64(1)) == wp.uint64(0):
            continue
        along = wp.dot(geoms[world, i].centre, direction)
        bound = geoms[world, i].bound
        if bound <= 0.0 or (along > 0.0 and along * along >= bound):
            distance, outward = intersect(geoms[world, i], origin, direction)
            reach = nearest + ray.RAY_TOL_REL * wp.max(nearest, 1.0)  # of two, the later
            is_seen = distance >= closest and distance <= reach
            if is_seen and wp.dot(direction, outward) <= 0.0:
                nearest, normal, hit = distance, outward, i
    return hit, nearest, normal


@wp.func
def _zoomed(ray: wp.vec3, zoom: float):
    """A camera's ray, in its frame, at another field of view than the nominal one."""
    if zoom == 1.0:
        return ray
    return wp.normalize(wp.vec3(ray[0] * zoom, ray[1] * zoom, ray[2]))


@wp.func
def _seen(
    geoms: wp.array2d[Geom],
    lights: wp.array2d[Light],
    stray: Stray,
    texels: wp.array[wp.vec3],
    world: int,
    hit: int,
    point: wp.vec3,
    normal: wp.vec3,
    direction: wp.vec3,
    eye: wp.vec3,
):
    """What reaches the eye along a ray that meets a geom; a plane mirrors others."""
    light = _shade(geoms, lights, stray, texels, world, hit, point, normal, eye)
    if stray.mirror > 0.0 and geoms[world, hit].kind == GeomType.PLANE:
        mirrored = direction - 2.0 * wp.dot(direction, normal) * normal
        start = point + _OFFSET_M * normal
        seen, away, facing = first_hit(geoms, world, start, mirrored, ENDLESS)
        if seen >= 0:
            image = start + mirrored * away
            its = _shade(geoms, lights, stray, texels, world, seen, image, facing, start)
            light = wp.lerp(light, its, stray.mirror)
    return light


@wp.kernel
def draw(
    rays: wp.array[wp.vec3],
    zooms: wp.array[float],
    run: int,
    near: float,
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
    """A run of pixels of each world's picture: the nearest geom of each ray, lit; else the sky.

    On a CPU a run is a row, on a GPU a pixel.
    """
    world, part = wp.tid()
    origin = cam_xpos[world, camera]
    orientation = cam_xmat[world, camera]
    met = ~wp.uint64(0)
    if run > 1:
        first = rays[part * run]
        across = wp.normalize(wp.vec3(0.0, -first[2], zooms[world] * first[1]))
        met = _met_by_row(geoms, world, orientation @ across)
    for pixel in range(part * run, (part + 1) * run):
        local = _zoomed(rays[pixel], zooms[world])
        direction = orientation @ local
        ahead = wp.max(-local[2], 1e-6)
        hit, distance, normal = _nearest(
            geoms, world, met, origin, direction, near / ahead, far / ahead
        )
        if hit >= 0:
            point = origin + direction * distance
            stray = strays[world]
            light = _seen(
                geoms, lights, stray, texels, world, hit, point, normal, direction, origin
            )
            pixels[world, pixel] = _pack(light)
        elif sky >= 0:
            pixels[world, pixel] = _pack(render.sample_skybox(skies[sky], sky_texel, direction))
        else:
            pixels[world, pixel] = NOTHING
