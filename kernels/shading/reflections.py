"""Trace one reflected ray from what reflects sharply: glass, clear coats, bare smooth metal, water on the ground.

Every second pixel sends one, as on a chessboard, and the others show the mean of their neighbors' images; one without
a neighbor that shows the same material shows the blurred sky. Wet ground sends a ray from every pixel: where water
stands depends on the weather, and no picture may depend on the other weathers that are made with it.
"""

import warp as wp

from mmw.kernels.camera.image_samples import Picture, SampleRay, ray_of, row_of_thread
from mmw.kernels.camera.instance_culling import Sun
from mmw.kernels.camera.visibility import store
from mmw.kernels.core.compiler import PICTURE_RAYS
from mmw.kernels.core.packing import unpack_unit
from mmw.kernels.core.structs import Scene
from mmw.kernels.core.trace import PICTURE_REGISTERS, closest_hit_raw
from mmw.kernels.shading.shadows import lift, sees_sun, stratum_point
from mmw.kernels.shading.structs import MATT, AppearanceTable, Samples, Surfaces
from mmw.kernels.shading.surface_point import ray_hit, surface_point_of
from mmw.kernels.shading.surface_samples import read_surface, schlick, write_surface
from mmw.kernels.shading.wet_surfaces import WATER_REFLECTANCE, Wet, smoothstep, wetted

wp.set_module_options(PICTURE_RAYS)

MIN_WATER_SHARE = wp.constant(0.03)
"""Share of the light that the film on wet ground must reflect for a ray to be worth it [-]: that of water to an eye
37 deg above it. Design value."""

FULL_WATER_SHARE = wp.constant(0.12)
"""Share of the light that water reflects from which the ray alone counts [-]. Design value."""

REFLECTION_LENGTH_M = wp.constant(1.0e3)
"""Length of a reflected ray [m]."""

ALIKE = wp.constant(0.95)
"""Cosine between the normals of neighbors that can show the mean of each other's images [-]. Design value."""


@wp.struct
class Reflections:
    """Reflected rays and their hits."""

    row: wp.array[int]
    """Sample that each was sent from; there is room for more."""
    count: wp.array[int]
    """Number of reflected rays, shape [1]; threads beyond do nothing."""
    samples: Samples
    surfaces: Surfaces
    sun: wp.array[wp.uint8]
    """255 where the sun lights what was hit, else 0; empty where it always does."""


@wp.struct
class ReflectedRay:
    """A reflected ray."""

    source: SampleRay
    """The ray that was reflected."""
    t: float
    """Distance from the camera to the reflecting surface [m]."""
    start: wp.vec3
    """Origin, scene frame [m]."""
    direction: wp.vec3
    """Unit direction, scene frame."""


@wp.func
def reflect(direction: wp.vec3, normal: wp.vec3, face_normal: wp.vec3) -> wp.vec3:
    """Return the reflected direction, kept above the face where a bent normal would send it below."""
    away = direction - 2.0 * wp.dot(direction, normal) * normal
    below = wp.dot(away, face_normal)
    if below < 0.02:
        away = wp.normalize(away + (0.02 - below) * face_normal)
    return away


@wp.func
def footprint_on(normal: wp.vec3, direction: wp.vec3, width: float) -> float:
    """Return the longest side of what a pixel covers on a surface [m], from its width square to the ray [m]."""
    return width / wp.max(-wp.dot(normal, direction), 0.05)


@wp.func
def water_weight(film: float, normal: wp.vec3, to_viewer: wp.vec3) -> float:
    """Return how much of what the film on a wet surface reflections comes by a ray of its own, 0 to 1 (Schlick, flat).

    The rest is the blurred sky. It rises smoothly, so that no line shows where rays begin.
    """
    return smoothstep(MIN_WATER_SHARE, FULL_WATER_SHARE, film * schlick(WATER_REFLECTANCE, normal, to_viewer))


@wp.func
def reflected_ray(picture: Picture, surfaces: Surfaces, row: int) -> ReflectedRay:
    """Return the reflected ray of a sample. It does not depend on the weather: water lies flat over a rough surface."""
    ray = ReflectedRay()
    ray.source = ray_of(picture, row)
    ray.t = picture.samples.t[row]
    face_normal = unpack_unit(picture.samples.normal[row])
    normal = face_normal
    if surfaces.gloss[row] != MATT:
        normal = unpack_unit(surfaces.normal[row])
    ray.start = lift(ray.source.origin + ray.t * ray.source.direction, face_normal, ray.t)
    ray.direction = reflect(ray.source.direction, normal, face_normal)
    return ray


@wp.kernel
def water_kernel(
    table: AppearanceTable,
    wet: Wet,
    picture: Picture,
    surfaces: Surfaces,
    # out
    sends_ray_out: wp.array[wp.uint8],
):
    """Let the samples whose water reflections enough send a ray too: 1 for those; the other flags stay.

    Launch: dim=threads of all tiles and further samples that are shaded, block_dim=64; a thread's flag is at its
    number.
    """
    thread = wp.tid()
    row = row_of_thread(picture, thread)
    if row < 0:
        return
    if picture.samples.face[row] < 0 or surfaces.gloss[row] != MATT:
        return
    normal = unpack_unit(picture.samples.normal[row])
    if normal[2] < 0.2:  # film and puddles lie on what faces upward
        return
    t = picture.samples.t[row]
    ray = ray_of(picture, row)
    appearance = table.appearances[surfaces.material[row]]
    surface_point = read_surface(table, surfaces, row, ray.origin + t * ray.direction, normal)
    film = wetted(wet, appearance, surface_point, 0.0, footprint_on(normal, ray.direction, t / picture.camera.fx)).film
    if water_weight(film, normal, -ray.direction) > 0.0:
        sends_ray_out[thread] = wp.uint8(1)


@wp.func
def row_next_to(picture: Picture, row: int, side: int) -> int:
    """Return the row of the pixel to the right, to the left, below or above a pixel; -1 outside of the image."""
    camera = picture.camera
    line = row // camera.width
    u = row - line * camera.width
    v = line % camera.height
    if side == 0:
        return wp.where(u + 1 < camera.width, row + 1, -1)
    if side == 1:
        return wp.where(u > 0, row - 1, -1)
    if side == 2:
        return wp.where(v + 1 < camera.height, row + camera.width, -1)
    return wp.where(v > 0, row - camera.width, -1)


@wp.func
def alike_beside(picture: Picture, surfaces: Surfaces, row: int, side: int) -> int:
    """Return the row of the pixel on one side of a pixel if both show one material, bent alike; else -1."""
    beside = row_next_to(picture, row, side)
    if beside < 0:
        return -1
    if surfaces.material[row] != surfaces.material[beside]:
        return -1
    if wp.dot(unpack_unit(surfaces.normal[row]), unpack_unit(surfaces.normal[beside])) < ALIKE:
        return -1
    return beside


@wp.kernel
def reflection_number_kernel(
    reflections: Reflections,
    # out
    number_out: wp.array[int],
):
    """Write the number of each reflected ray to the row of its sample. Launch: dim=room for reflected rays."""
    ray = wp.tid()
    if ray < reflections.count[0]:
        number_out[reflections.row[ray]] = ray


@wp.func
def reflection_image(
    picture: Picture, surfaces: Surfaces, number: wp.array[int], image: wp.array[wp.vec3], row: int
) -> wp.vec4:
    """Return what a sample reflections [kcd/m2], and fourth 1, or 0 where no ray was sent for it.

    Args:
        picture: The images.
        surfaces: What their samples show.
        number: Reflected ray of each sample, -1 for none.
        image: What reflected rays bring [kcd/m2].
        row: The sample.
    """
    total = wp.vec3()
    count = wp.float32(0.0)
    ray = number[row]
    if ray >= 0:
        total = image[ray]
        count = wp.float32(1.0)
    elif row < picture.extras.first:
        for side in range(4):
            beside = alike_beside(picture, surfaces, row, side)
            if beside >= 0:
                ray = number[beside]
                if ray >= 0:
                    total += image[ray]
                    count += 1.0
    if count == 0.0:
        return wp.vec4()
    return wp.vec4(total[0] / count, total[1] / count, total[2] / count, 1.0)


@wp.kernel(cuda_max_registers=PICTURE_REGISTERS)
def reflection_trace_kernel(
    scene: Scene,
    picture: Picture,
    surfaces: Surfaces,
    reflections: Reflections,
    # out
    samples_out: Samples,
):
    """Trace reflected rays.

    Launch: dim=room for reflected rays, block_dim=64.
    """
    number = wp.tid()
    if number >= reflections.count[0]:
        return
    ray = reflected_ray(picture, surfaces, reflections.row[number])
    batch_index = ray.source.batch_index
    near = closest_hit_raw(scene, batch_index, ray.start, ray.direction, REFLECTION_LENGTH_M, -1)
    store(scene, batch_index, near, ray.direction, number, samples_out)


@wp.kernel(cuda_max_registers=80)
def reflection_surface_kernel(
    scene: Scene,
    table: AppearanceTable,
    picture: Picture,
    surfaces: Surfaces,
    reflections: Reflections,
    # out
    surfaces_out: Surfaces,
):
    """Read colors, roughness and normals of what reflected rays hit.

    Launch: dim=room for reflected rays, block_dim=64.
    """
    number = wp.tid()
    if number >= reflections.count[0]:
        return
    face = reflections.samples.face[number]
    if face < 0:
        return
    ray = reflected_ray(picture, surfaces, reflections.row[number])
    t = reflections.samples.t[number]
    instance = reflections.samples.instance[number]
    hit = ray_hit(ray.source.batch_index, ray.start, ray.direction, t, face, instance)
    surface_point = surface_point_of(scene, table, hit, (1.0 + ray.t / t) / picture.camera.fx)
    write_surface(table, surface_point, -ray.direction, number, surfaces_out)


@wp.kernel(cuda_max_registers=PICTURE_REGISTERS)
def reflection_sun_kernel(
    scene: Scene,
    picture: Picture,
    surfaces: Surfaces,
    reflections: Reflections,
    sun: Sun,
    # out
    sun_out: wp.array[wp.uint8],
):
    """Send a ray to the sun from what reflected rays hit: 255 where it arrives, else 0.

    Launch: dim=room for reflected rays, block_dim=64.
    """
    number = wp.tid()
    if number >= reflections.count[0]:
        return
    is_lit = wp.bool(False)
    if reflections.samples.face[number] >= 0:
        normal = unpack_unit(reflections.samples.normal[number])
        if wp.dot(normal, sun.direction) > -sun.radius:
            ray = reflected_ray(picture, surfaces, reflections.row[number])
            t = reflections.samples.t[number]
            start = lift(ray.start + t * ray.direction, normal, t)
            stratum = stratum_point(int(ray.source.u), int(ray.source.v), 4)
            is_lit = sees_sun(scene, ray.source.batch_index, start, normal, sun, stratum)
    sun_out[number] = wp.where(is_lit, wp.uint8(255), wp.uint8(0))
