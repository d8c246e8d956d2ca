"""Read surface samples before any light: textures are read once, and every weather shades the result."""

import warp as wp

from mmw.kernels.camera.image_samples import Picture, ray_of, row_of_thread
from mmw.kernels.core.compiler import FAST
from mmw.kernels.core.packing import pack_unit, unpack_unit
from mmw.kernels.core.structs import Scene
from mmw.kernels.shading.structs import (
    COATED,
    FAINT_COAT,
    MATT,
    SMOOTH,
    Appearance,
    AppearanceTable,
    SurfacePoint,
    Surfaces,
)
from mmw.kernels.shading.surface_point import ray_hit, surface_point_of
from mmw.kernels.shading.wet_surfaces import smoothstep

wp.set_module_options(
    {"enable_backward": False, "default_grid_stride": False, "fast_math": True, "cpu_compiler_flags": FAST}
)


MAX_ROUGH_BASE = wp.constant(0.25)
"""Roughness below which glass and metal reflect their surroundings sharply [-]. Design value."""

MAX_ROUGH_COAT = wp.constant(0.2)
"""Roughness of a clear coat below which it reflects its surroundings sharply [-]. Design value."""


COAT_REFLECTANCE = wp.constant(0.04)
"""Light that a clear coat reflects straight back [-]: a refractive index of 1.5."""

MIN_COAT_SHARE = wp.constant(0.045)
"""Share of the light that a coat must reflect for a ray to be worth it [-]: from 45 deg aslant on. Design value."""

FULL_COAT_SHARE = wp.constant(0.1)
"""Share from which the ray alone counts; in between the blurred sky fades out [-]. Design value."""


@wp.func
def schlick(reflectance: float, normal: wp.vec3, to_viewer: wp.vec3) -> float:
    """Return the share of the light that a surface reflects.

    Source: C. Schlick, "An inexpensive BRDF model for physically-based rendering", 1994.
    """
    x = 1.0 - wp.clamp(wp.dot(normal, to_viewer), 0.0, 1.0)
    return reflectance + (1.0 - reflectance) * x * x * x * x * x


@wp.func
def coat_weight(appearance: Appearance, normal: wp.vec3, to_viewer: wp.vec3) -> float:
    """Return how much of what a sharp coat reflects comes by a ray of its own, 0 to 1; the rest is the blurred sky."""
    return smoothstep(
        MIN_COAT_SHARE, FULL_COAT_SHARE, appearance.clearcoat * schlick(COAT_REFLECTANCE, normal, to_viewer)
    )


@wp.func
def gloss_of(surface_point: SurfacePoint, appearance: Appearance, to_viewer: wp.vec3) -> wp.uint8:
    """Return `SMOOTH`, `COATED`, `FAINT_COAT` or `MATT`."""
    if (surface_point.opacity < 0.999 or surface_point.metallic > 0.5) and surface_point.roughness < MAX_ROUGH_BASE:
        return SMOOTH
    if appearance.clearcoat > 0.0 and appearance.clearcoat_roughness < MAX_ROUGH_COAT:
        if coat_weight(appearance, surface_point.shading_normal, to_viewer) > 0.0:
            return COATED
        return FAINT_COAT
    return MATT


@wp.func
def write_surface(
    table: AppearanceTable, surface_point: SurfacePoint, to_viewer: wp.vec3, row: int,
    # out
    surfaces_out: Surfaces,
):  # fmt: skip
    """Store a surface_point that a ray hit, without its place, which follows from the ray."""
    surfaces_out.material[row] = surface_point.material
    color = surface_point.color
    halves = wp.vec4h(
        wp.float16(color[0]), wp.float16(color[1]), wp.float16(color[2]), wp.float16(surface_point.roughness)
    )
    surfaces_out.color[row] = wp.cast(halves, wp.uint64)
    surfaces_out.normal[row] = pack_unit(surface_point.shading_normal)
    more = wp.vec2h(wp.float16(surface_point.metallic), wp.float16(surface_point.opacity))
    surfaces_out.more[row] = wp.cast(more, wp.uint32)
    surfaces_out.gloss[row] = gloss_of(surface_point, table.appearances[surface_point.material], to_viewer)
    if surfaces_out.emission.shape[0] > 0:
        light = surface_point.emission
        emitted = wp.vec4h(wp.float16(light[0]), wp.float16(light[1]), wp.float16(light[2]), wp.float16(0.0))
        surfaces_out.emission[row] = wp.cast(emitted, wp.uint64)


@wp.func
def read_surface(table: AppearanceTable, surfaces: Surfaces, row: int, point: wp.vec3, normal: wp.vec3) -> SurfacePoint:
    """Return a stored surface_point.

    Args:
        table: Appearances of the materials.
        surfaces: What was stored.
        row: Its row.
        point: Where it is, scene frame [m].
        normal: Normal of its face, scene frame.
    """
    surface_point = SurfacePoint()
    surface_point.point = point
    surface_point.normal = normal
    surface_point.shading_normal = unpack_unit(surfaces.normal[row])
    surface_point.material = surfaces.material[row]
    color = wp.cast(surfaces.color[row], wp.vec4h)
    surface_point.color = wp.vec3(float(color[0]), float(color[1]), float(color[2]))
    surface_point.roughness = float(color[3])
    more = wp.cast(surfaces.more[row], wp.vec2h)
    surface_point.metallic = float(more[0])
    surface_point.opacity = float(more[1])
    if surfaces.emission.shape[0] > 0:
        light = wp.cast(surfaces.emission[row], wp.vec4h)
        surface_point.emission = wp.vec3(float(light[0]), float(light[1]), float(light[2]))
    else:
        surface_point.emission = table.appearances[surface_point.material].emission
    return surface_point


@wp.func
def sends_ray(picture: Picture, row: int, gloss: wp.uint8) -> wp.bool:
    """Return whether a sample sends a reflected ray for its own smoothness: further samples, and every second pixel as
    on a chessboard, whose images the pixels between them share."""
    line = row // picture.camera.width
    is_even = (row - line * picture.camera.width + line) % 2 == 0
    return gloss >= COATED and (is_even or row >= picture.extras.first)


@wp.kernel(cuda_max_registers=80)
def surface_kernel(
    scene: Scene,
    table: AppearanceTable,
    picture: Picture,
    # out
    surfaces_out: Surfaces,
    sends_ray_out: wp.array[wp.uint8],
):
    """Read colors, roughness and normals of what every sample shows, and choose those that send a reflected ray: 1.

    Launch: dim=threads of all tiles and further samples that are shaded, block_dim=256; a thread's flag is at its
    number.
    """
    thread = wp.tid()
    row = row_of_thread(picture, thread)
    sends_ray_out[thread] = wp.uint8(0)
    if row < 0:
        return
    face = picture.samples.face[row]
    if face < 0:
        surfaces_out.gloss[row] = MATT
        return
    ray = ray_of(picture, row)
    t = picture.samples.t[row]
    instance = picture.samples.instance[row]
    hit = ray_hit(ray.batch_index, ray.origin, ray.direction, t, face, instance)
    surface_point = surface_point_of(scene, table, hit, 1.0 / picture.camera.fx)
    write_surface(table, surface_point, -ray.direction, row, surfaces_out)
    if sends_ray(picture, row, surfaces_out.gloss[row]):
        sends_ray_out[thread] = wp.uint8(1)
