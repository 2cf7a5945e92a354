# type: ignore
# ruff: noqa: RUF046, UP018
# This is Warp's language, not Python: its types are others, and float(1.0) is a variable.
"""Geoms as the kernel knows them: where rays meet them, and their textures.

Intersections and texture coordinates are mujoco_warp's own functions, so that the pictures are.
"""

import warp as wp
from mujoco_warp import GeomType
from mujoco_warp._src import ray, render

ENDLESS = wp.constant(1e6)  # m: how far away lamps, and ends of unbounded geoms, are

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
    radius: float  # of a bounding sphere, negative of what is never seen
    rgb: wp.vec3
    glow: wp.vec3  # emitted, and reflected of the headlight's ambient, as a factor on the colour
    specular: float
    shininess: float
    shiny_from: float  # cos² of the angle to a light's mirror image
    texture: wp.vec3i  # first texel (-1: none), width, height
    repeat: wp.vec2
    uniform: bool
    texture_last: bool  # all light is multiplied by it, also highlights
    is_flat: bool  # lit by lamps at the lines of a grid, in its own frame
    lines: wp.vec3  # distances of these lines
    first_line: wp.vec3


@wp.func
def intersect(geom: Geom, origin: wp.vec3, direction: wp.vec3):
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
def texture_at(geom: Geom, texels: wp.array[wp.vec3], point: wp.vec3, normal: wp.vec3):
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
def first_hit(
    geoms: wp.array2d[Geom], world: int, origin: wp.vec3, direction: wp.vec3, farthest: float
):
    """The nearest geom that a ray from anywhere meets (-1: none), its distance and normal."""
    nearest = farthest
    normal = wp.vec3()
    hit = int(-1)
    for i in range(geoms.shape[1]):
        radius = geoms[world, i].radius
        away = geoms[world, i].pos - origin
        along = wp.dot(away, direction)
        beside = wp.dot(away, away) - along * along
        if radius >= 0.0 and along > -radius and beside <= radius * radius:
            distance, outward = intersect(geoms[world, i], origin, direction)
            if distance >= 0.0 and distance < nearest and wp.dot(direction, outward) <= 0.0:
                nearest, normal, hit = distance, outward, i
    return hit, nearest, normal
