# type: ignore
# ruff: noqa: RUF046, UP018
# This is Warp's language, not Python: its types are others, and float(1.0) is a variable.
"""Lights as the kernel knows them, and what surfaces reflect of them: as in OpenGL."""

import warp as wp

from simtune.simulation.rendering.primitives.geoms import ENDLESS, Geom

SPOT, DIRECTIONAL = wp.constant(0), wp.constant(1)  # the other kinds shine everywhere
# In cells that are small from a lamp, interpolation changes no pixel: (1 + exponent) · (cell /
# distance)² is four times what a cone's light is off by
_FINE_ERROR = wp.constant(0.05)

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
    fills: bool  # has ambient light
    ambient: wp.vec3  # none of a headlight, see `Geom.glow`
    diffuse: wp.vec3
    specular: wp.vec3


@wp.func
def way_to(light: Light, point: wp.vec3):
    """Direction and distance of a light."""
    to_light = -light.direction
    distance = float(ENDLESS)
    if light.kind != DIRECTIONAL:
        distance = wp.length(light.pos - point)
        to_light = (light.pos - point) / distance
    return to_light, distance


@wp.func
def reflect(
    light: Light,
    geom: Geom,
    rgb: wp.vec3,
    full: wp.vec3,
    point: wp.vec3,
    normal: wp.vec3,
    eye: wp.vec3,
):
    """What of a light reaches the eye: its ambient, and Blinn and Phong's model, as in OpenGL."""
    to_light, distance = way_to(light, point)
    facing = wp.dot(normal, to_light)
    cos = -wp.dot(to_light, light.direction)
    if light.kind == SPOT and cos < light.cos_cutoff:
        return wp.vec3()
    if facing <= 0.0 and not light.fills:
        return wp.vec3()
    strength = float(1.0)
    if light.kind != DIRECTIONAL:
        powers = wp.vec3(1.0, distance, distance * distance)
        strength = 1.0 / wp.max(wp.dot(light.attenuation, powers), 1e-15)
        if light.kind == SPOT:
            strength *= wp.pow(wp.max(cos, 0.0), light.exponent)
    reflected = wp.vec3()
    if light.fills:
        reflected = wp.cw_mul(rgb, light.ambient) * strength
        if facing <= 0.0:
            return reflected
    reflected += wp.cw_mul(rgb, light.diffuse) * (facing * strength)
    half = to_light + wp.normalize(eye - point)
    cos = wp.max(wp.dot(normal, half), 0.0)
    squared = cos * cos / wp.dot(half, half)
    if squared > geom.shiny_from:
        shine = wp.pow(squared, 0.5 * geom.shininess)
        reflected += wp.cw_mul(light.specular, full) * (geom.specular * shine * strength)
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
def reflect_flat(
    light: Light,
    geom: Geom,
    rgb: wp.vec3,
    full: wp.vec3,
    point: wp.vec3,
    normal: wp.vec3,
    eye: wp.vec3,
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
    if longest * longest * (1.0 + light.exponent) < _FINE_ERROR * wp.length_sq(light.pos - point):
        return reflect(light, geom, rgb, full, point, normal, eye)
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
    total = (1.0 - beside - above) * reflect(light, geom, rgb, full, here, normal, eye)
    total += beside * reflect(light, geom, rgb, full, right_below, normal, eye)
    return total + above * reflect(light, geom, rgb, full, left_above, normal, eye)
