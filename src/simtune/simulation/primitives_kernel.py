# type: ignore
# ruff: noqa: RUF046, UP018
# This is Warp's language, not Python: its types are others, and float(1.0) is a variable.
"""The kernel that draws rows of pixels: each looks for the nearest geom and adds the lights up.

Intersections and texture coordinates are mujoco_warp's own functions, so that the pictures are.
"""

import warp as wp
from mujoco_warp import GeomType
from mujoco_warp._src import ray, render
from mujoco_warp._src.render_util import pack_rgba_to_uint32

SPOT, DIRECTIONAL = wp.constant(0), wp.constant(1)  # the other kinds shine everywhere
BACKGROUND = wp.constant(wp.uint32(0))

wp.set_module_options({"enable_backward": False, "fast_math": True})


@wp.struct
class Geom:
    """A geom of one world, in the world's frame."""

    kind: int
    pos: wp.vec3
    mat: wp.mat33
    size: wp.vec3
    centre: wp.vec3  # from the camera
    bound: float  # rays with a smaller dot(centre, direction)² pass it by
    rgb: wp.vec3
    glow: wp.vec3  # emitted, and reflected of the ambient light, as a factor on the colour
    specular: float
    shininess: float
    shiny_from: float  # cos² of the angle to a light's mirror image
    texture: wp.vec3i  # first texel (-1: none), width, height
    repeat: wp.vec2
    uniform: bool


@wp.struct
class Light:
    """A light of one world, in the world's frame."""

    kind: int
    pos: wp.vec3
    direction: wp.vec3
    attenuation: wp.vec3
    cos_cutoff: float
    exponent: float
    diffuse: wp.vec3
    specular: wp.vec3


@wp.func
def _intersect(geom: Geom, origin: wp.vec3, direction: wp.vec3):
    """Distance, negative if there is none, and normal."""
    if geom.kind == GeomType.PLANE:
        return ray.ray_plane(geom.pos, geom.mat, geom.size, origin, direction)
    if geom.kind == GeomType.SPHERE:
        return ray.ray_sphere(geom.pos, geom.size[0] * geom.size[0], origin, direction)
    if geom.kind == GeomType.CAPSULE:
        return ray.ray_capsule(geom.pos, geom.mat, geom.size, origin, direction)
    if geom.kind == GeomType.ELLIPSOID:
        return ray.ray_ellipsoid(geom.pos, geom.mat, geom.size, origin, direction)
    if geom.kind == GeomType.CYLINDER:
        return ray.ray_cylinder(geom.pos, geom.mat, geom.size, origin, direction)
    distance, _sides, normal = ray.ray_box(geom.pos, geom.mat, geom.size, origin, direction)
    return distance, normal


@wp.func
def _unwrap(geom: Geom, local: wp.vec3, normal: wp.vec3):
    """Texture coordinates, their offset, and how often the texture is repeated."""
    size, repeat, uniform = geom.size, geom.repeat, geom.uniform
    if geom.kind == GeomType.PLANE:
        return render._texture_plane(local, size, repeat, uniform)
    if geom.kind == GeomType.CAPSULE:
        return render._texture_capsule(local, size, repeat, uniform)
    if geom.kind == GeomType.CYLINDER:
        return render._texture_cylinder(local, normal, size, repeat, uniform)
    if geom.kind == GeomType.BOX:
        return render._texture_box(local, normal, size, repeat, uniform)
    is_sphere = geom.kind == GeomType.SPHERE
    return render._texture_sphere_ellipsoid(local, size, repeat, uniform, is_sphere)


@wp.func
def _texture(geom: Geom, texels: wp.array[wp.vec3], point: wp.vec3, normal: wp.vec3):
    """The texture's colour at a point, between its four nearest texels."""
    inverse = wp.transpose(geom.mat)
    uv, offset, repeat = _unwrap(geom, inverse @ (point - geom.pos), inverse @ normal)
    uv = wp.cw_mul(uv, repeat) + offset
    width, height = geom.texture[1], geom.texture[2]
    x = wp.clamp((uv[0] - wp.floor(uv[0])) * float(width) - 0.5, 0.0, float(width - 1))
    y = wp.clamp((uv[1] - wp.floor(uv[1])) * float(height) - 0.5, 0.0, float(height - 1))
    left, top = int(x), int(y)
    right, below = wp.min(1, width - 1 - left), wp.min(1, height - 1 - top) * width
    texel = geom.texture[0] + top * width + left
    upper = wp.lerp(texels[texel], texels[texel + right], x - float(left))
    lower = wp.lerp(texels[texel + below], texels[texel + below + right], x - float(left))
    return wp.lerp(upper, lower, y - float(top))


@wp.func
def _reflect(
    light: Light, geom: Geom, rgb: wp.vec3, point: wp.vec3, normal: wp.vec3, to_eye: wp.vec3
):
    """What of a light reaches the eye: Blinn and Phong's model, as OpenGL's."""
    strength = float(1.0)
    to_light = -light.direction
    if light.kind != DIRECTIONAL:
        distance = wp.length(light.pos - point)
        to_light = (light.pos - point) / distance
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
    reflected = wp.cw_mul(rgb, light.diffuse) * facing
    half = to_light + to_eye
    cos = wp.max(wp.dot(normal, half), 0.0)
    squared = cos * cos / wp.dot(half, half)
    if squared > geom.shiny_from:
        shine = wp.pow(squared, 0.5 * geom.shininess)
        reflected += light.specular * (geom.specular * shine * strength)
    return reflected


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
                distance, outward = _intersect(geoms[world, i], origin, direction)
                reach = nearest + ray.RAY_TOL_REL * wp.max(nearest, 1.0)  # of two, the later
                if distance >= 0.0 and distance <= reach and wp.dot(direction, outward) <= 0.0:
                    nearest, normal, hit = distance, outward, i
        if hit < 0:
            pixels[world, pixel] = BACKGROUND
            if sky >= 0:
                shade = 255.0 * render.sample_skybox(skies[sky], sky_texel, direction)
                pixels[world, pixel] = pack_rgba_to_uint32(shade[0], shade[1], shade[2], 255.0)
            continue
        geom = geoms[world, hit]
        point = origin + direction * nearest
        rgb = geom.rgb
        if geom.texture[0] >= 0:
            rgb = wp.cw_mul(rgb, _texture(geom, texels, point, normal))
        light = wp.cw_mul(rgb, geom.glow)
        for i in range(lights.shape[1]):
            light += _reflect(lights[world, i], geom, rgb, point, normal, -direction)
        light = 255.0 * wp.max(wp.min(light, wp.vec3(1.0)), wp.vec3(0.0))
        pixels[world, pixel] = pack_rgba_to_uint32(light[0], light[1], light[2], 255.0)
