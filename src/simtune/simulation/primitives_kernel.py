# type: ignore
# ruff: noqa: RUF046, UP018
# This is Warp's language, not Python: its types are others, and float(1.0) is a variable.
"""The kernel that draws pixels: each looks for the nearest geom and adds the lights up."""

import warp as wp
from mujoco_warp import GeomType
from mujoco_warp._src import ray, render
from mujoco_warp._src.render_util import pack_rgba_to_uint32

from simtune.simulation.packing import NOTHING
from simtune.simulation.primitives_geoms import Geom, first_hit, intersect, texture_at

SPOT, DIRECTIONAL = wp.constant(0), wp.constant(1)  # the other kinds shine everywhere
_OFF = wp.constant(1e-4)  # m, by which rays begin off a surface, not to meet it at once
_ENDLESS = wp.constant(1e6)
# In cells that are small from a lamp, interpolation changes no pixel: (1 + exponent) · (cell /
# distance)² is four times what a cone's light is off by
_FINE = wp.constant(0.05)

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
def _towards(light: Light, point: wp.vec3):
    """Direction and distance of a light."""
    to_light = -light.direction
    distance = float(_ENDLESS)
    if light.kind != DIRECTIONAL:
        distance = wp.length(light.pos - point)
        to_light = (light.pos - point) / distance
    return to_light, distance


@wp.func
def _reflect(light: Light, geom: Geom, rgb: wp.vec3, point: wp.vec3, normal: wp.vec3, eye: wp.vec3):
    """What of a light reaches the eye: Blinn and Phong's model, as OpenGL's."""
    to_light, distance = _towards(light, point)
    facing = wp.dot(normal, to_light)
    cos = -wp.dot(to_light, light.direction)
    if facing <= 0.0 or (light.kind == SPOT and cos < light.cos_cutoff):
        return wp.vec3()
    strength = float(1.0)
    if light.kind != DIRECTIONAL:
        powers = wp.vec3(1.0, distance, distance * distance)
        strength = 1.0 / wp.max(wp.dot(light.attenuation, powers), 1e-15)
        if light.kind == SPOT:
            strength *= wp.pow(wp.max(cos, 0.0), light.exponent)
    reflected = wp.cw_mul(rgb, light.diffuse) * (facing * strength)
    half = to_light + wp.normalize(eye - point)
    cos = wp.max(wp.dot(normal, half), 0.0)
    squared = cos * cos / wp.dot(half, half)
    if squared > geom.shiny_from:
        shine = wp.pow(squared, 0.5 * geom.shininess)
        reflected += light.specular * (geom.specular * shine * strength)
    return reflected


@wp.func
def _cell(geom: Geom, axis: int, at: float):
    """Start and end of the cell of a flat face's grid that holds `at`, along an axis."""
    start = geom.first_line[axis]
    start += wp.floor((at - start) / geom.lines[axis]) * geom.lines[axis]
    end = start + geom.lines[axis]
    if geom.size[axis] > 0.0:
        start = wp.max(start, -geom.size[axis])
        end = wp.min(end, geom.size[axis])
    return start, end


@wp.func
def _on_face(geom: Geom, local: wp.vec3, one: int, other: int, x: float, y: float):
    """The point of a flat face with other coordinates than `local` along two axes."""
    at = wp.vec3(local[0], local[1], local[2])
    at[one] = x
    at[other] = y
    return geom.pos + geom.mat @ at


@wp.func
def _reflect_flat(
    light: Light, geom: Geom, rgb: wp.vec3, point: wp.vec3, normal: wp.vec3, eye: wp.vec3
):
    """The same on a flat face: as OpenGL interpolates it between corners of a grid's cells.

    A lamp's cone that is narrower than a cell is hardly seen there. A cell is halved to triangles.
    """
    inward = wp.transpose(geom.mat)
    local = inward @ (point - geom.pos)
    facing = inward @ normal
    outward = int(2)
    for axis in range(2):
        if wp.abs(facing[axis]) > 0.7:
            outward = axis
    one, other = (outward + 1) % 3, (outward + 2) % 3
    longest = wp.max(geom.lines[one], geom.lines[other])
    if longest * longest * (1.0 + light.exponent) < _FINE * wp.length_sq(light.pos - point):
        return _reflect(light, geom, rgb, point, normal, eye)
    left, right = _cell(geom, one, local[one])
    low, high = _cell(geom, other, local[other])
    u = (local[one] - left) / wp.max(right - left, 1e-6)
    v = (local[other] - low) / wp.max(high - low, 1e-6)
    x, y, beside, above = left, low, u, v
    if u + v > 1.0:
        x, y, beside, above = right, high, 1.0 - v, 1.0 - u
    here = _on_face(geom, local, one, other, x, y)
    right_below = _on_face(geom, local, one, other, right, low)
    left_above = _on_face(geom, local, one, other, left, high)
    total = (1.0 - beside - above) * _reflect(light, geom, rgb, here, normal, eye)
    total += beside * _reflect(light, geom, rgb, right_below, normal, eye)
    return total + above * _reflect(light, geom, rgb, left_above, normal, eye)


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
    to_light, far = _towards(light, point)
    towards = wp.normalize(to_light + stray.aside)
    hidden_by, _there, _normal = first_hit(geoms, world, point + _OFF * normal, towards, far)
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
    """What reaches the eye from a point of a geom, 1 for the full scale."""
    geom = geoms[world, hit]
    rgb = geom.rgb
    if geom.texture[0] >= 0:
        rgb = wp.cw_mul(rgb, texture_at(geom, texels, point, normal))
    light = wp.cw_mul(rgb, geom.glow)
    for i in range(lights.shape[1]):
        lamp = lights[world, i]
        if geom.is_flat and lamp.kind != DIRECTIONAL:
            reflected = _reflect_flat(lamp, geom, rgb, point, normal, eye)
        else:
            reflected = _reflect(lamp, geom, rgb, point, normal, eye)
        if wp.dot(reflected, reflected) > 0.0:
            light += reflected * _left_by_shadows(lamp, stray, geoms, world, point, normal)
    return wp.max(wp.min(light, wp.vec3(1.0)), wp.vec3(0.0))


@wp.kernel
def draw(
    rays: wp.array[wp.vec3],
    zooms: wp.array[float],
    run: int,
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
    for pixel in range(part * run, (part + 1) * run):
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
            pixels[world, pixel] = NOTHING
            if sky >= 0:
                shade = 255.0 * render.sample_skybox(skies[sky], sky_texel, direction)
                pixels[world, pixel] = pack_rgba_to_uint32(shade[0], shade[1], shade[2], 255.0)
            continue
        point = origin + direction * nearest
        stray = strays[world]
        light = _shade(geoms, lights, stray, texels, world, hit, point, normal, origin)
        if stray.mirror > 0.0 and geoms[world, hit].kind == GeomType.PLANE:
            mirrored = direction - 2.0 * wp.dot(direction, normal) * normal
            start = point + _OFF * normal
            seen, away, facing = first_hit(geoms, world, start, mirrored, _ENDLESS)
            if seen >= 0:
                image = start + mirrored * away
                its = _shade(geoms, lights, stray, texels, world, seen, image, facing, start)
                light = wp.lerp(light, its, stray.mirror)
        light = 255.0 * light
        pixels[world, pixel] = pack_rgba_to_uint32(light[0], light[1], light[2], 255.0)
