"""One mirrored ray from what reflects sharply: glass, clear coats, bare smooth metal, and water on the ground."""

import warp as wp

from mmw.kernels.camera import Camera
from mmw.kernels.candidates import SunGrid
from mmw.kernels.lighting import lift, sees_sun, stratum_point
from mmw.kernels.looks import Appearance, Extras, Look, Samples, Surfaces
from mmw.kernels.packing import unpack_unit
from mmw.kernels.structs import Candidates, Scene, Views
from mmw.kernels.surfaces import read_surface, write_surface
from mmw.kernels.surfel import surfel_of
from mmw.kernels.trace import TRACE_REGISTERS, nearest_surface
from mmw.kernels.visibility import pixel_direction, place_of, row_of_thread, store
from mmw.kernels.wet import WATER_REFLECTANCE, Wet, wetted

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": True})

SMOOTH = wp.constant(0.25)
"""Roughness below which glass and metal mirror their surroundings sharply [-]. Design value."""

MOST_ROUGH_COAT = wp.constant(0.2)
"""Roughness of a clear coat below which it mirrors its surroundings sharply [-]. Design value."""

LEAST_SHARE = wp.constant(0.03)
"""Share of the light that must be mirrored for a ray to be worth it [-]. Design value."""

LEAST_WATER_SHARE = wp.constant(0.03)
"""The same for the film on wet ground, whose sky is drawn without a ray: 0.03 is what water mirrors to an eye
37 deg above it; at four times it the ray alone counts. Design value."""

MIRROR_FAR_M = wp.constant(1.0e3)
"""Length of a mirrored ray [m]."""

SKY = wp.constant(-1)
"""Face of a mirrored ray that meets nothing."""

NOT_TRACED = wp.constant(-2)
"""Face where no mirrored ray was sent."""


@wp.func
def mirrored(direction: wp.vec3, normal: wp.vec3, face_normal: wp.vec3) -> wp.vec3:
    """Return the mirrored direction, kept above the face where a bent normal would send it below."""
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
def is_sharp(look: Look, roughness: float, metallic: float, opacity: float) -> wp.bool:
    """Return whether a dry surface mirrors sharply: smooth glass and metal, and clear coats."""
    if (opacity < 0.999 or metallic > 0.5) and roughness < SMOOTH:
        return True
    return look.clearcoat > LEAST_SHARE and look.clearcoat_roughness < MOST_ROUGH_COAT


@wp.func
def water_weight(film: float, normal: wp.vec3, to_viewer: wp.vec3) -> float:
    """Return how much of what the film on a wet surface mirrors comes by a ray of its own, 0 to 1 (Schlick, flat).

    The rest is the blurred sky. It rises smoothly, so that no line shows where rays begin.
    """
    x = 1.0 - wp.clamp(wp.dot(normal, to_viewer), 0.0, 1.0)
    share = film * (WATER_REFLECTANCE + (1.0 - WATER_REFLECTANCE) * x * x * x * x * x)
    weight = wp.clamp((share - LEAST_WATER_SHARE) / (3.0 * LEAST_WATER_SHARE), 0.0, 1.0)
    return weight * weight * (3.0 - 2.0 * weight)


@wp.func
def mirror_normal(sharp: wp.bool, shading_normal: wp.vec3, face_normal: wp.vec3) -> wp.vec3:
    """Return the normal that a ray is mirrored about: water lies flat over a rough surface."""
    return wp.where(sharp, shading_normal, face_normal)


@wp.kernel
def mirror_ray_kernel(
    appearance: Appearance,
    wet: Wet,
    views: Views,
    camera: Camera,
    extras: Extras,
    samples: Samples,
    surfaces: Surfaces,
    # out
    is_mirror_out: wp.array[int],
):
    """Find the samples that mirror: 1 for those.

    Launch: dim=threads of all tiles and further samples, block_dim=64; a thread's flag stands at its number.
    """
    thread = wp.tid()
    row = row_of_thread(camera, views.slot.shape[0], thread)
    is_mirror_out[thread] = 0
    if row < 0:
        return
    t = samples.t[row]
    if t == wp.inf:
        return
    look = appearance.looks[surfaces.material[row]]
    more = wp.cast(surfaces.more[row], wp.vec2h)
    color = wp.cast(surfaces.color[row], wp.vec4h)
    sharp = is_sharp(look, float(color[3]), float(more[0]), float(more[1]))
    if not sharp and wet.wetness + wet.puddles > 0.0:
        normal = unpack_unit(samples.normal[row])
        if normal[2] > 0.2:  # film and puddles lie on what faces upwards
            place = place_of(camera, extras, row)
            pose = views.pose[place.view]
            direction = pixel_direction(camera, pose, place.u, place.v)
            point = wp.transform_get_translation(pose) + t * direction
            surfel = read_surface(appearance, surfaces, row, point, normal)
            footprint = footprint_on(normal, direction, t / camera.fx)
            film = wetted(wet, look, surfel, 0.0, footprint).film
            sharp = water_weight(film, normal, -direction) > 0.0
    is_mirror_out[thread] = wp.where(sharp, 1, 0)


@wp.kernel
def mirror_number_kernel(
    row: wp.array[int],
    # out
    mirror_out: wp.array[int],
):
    """Write the number of each mirrored ray to the row of its sample. Launch: dim=mirrored rays."""
    ray = wp.tid()
    mirror_out[row[ray]] = ray


@wp.func
def mirror_direction(
    appearance: Appearance, samples: Samples, surfaces: Surfaces, row: int, direction: wp.vec3
) -> wp.vec3:
    """Return the direction of the mirrored ray of a sample, scene frame; it does not depend on the weather."""
    look = appearance.looks[surfaces.material[row]]
    more = wp.cast(surfaces.more[row], wp.vec2h)
    color = wp.cast(surfaces.color[row], wp.vec4h)
    sharp = is_sharp(look, float(color[3]), float(more[0]), float(more[1]))
    normal = unpack_unit(samples.normal[row])
    return mirrored(direction, mirror_normal(sharp, unpack_unit(surfaces.normal[row]), normal), normal)


@wp.func
def mirror_start(views: Views, samples: Samples, row: int, view: int, direction: wp.vec3) -> wp.vec3:
    """Return where the mirrored ray of a sample starts, scene frame [m]."""
    t = samples.t[row]
    point = wp.transform_get_translation(views.pose[view]) + t * direction
    return lift(point, unpack_unit(samples.normal[row]), t)


@wp.kernel(cuda_max_registers=TRACE_REGISTERS)
def mirror_trace_kernel(
    scene: Scene,
    appearance: Appearance,
    views: Views,
    camera: Camera,
    extras: Extras,
    samples: Samples,
    surfaces: Surfaces,
    row: wp.array[int],
    # out
    mirrored_out: Samples,
):
    """Trace mirrored rays.

    Launch: dim=mirrored rays, block_dim=64.
    """
    ray = wp.tid()
    source = row[ray]
    place = place_of(camera, extras, source)
    direction = pixel_direction(camera, views.pose[place.view], place.u, place.v)
    start = mirror_start(views, samples, source, place.view, direction)
    away = mirror_direction(appearance, samples, surfaces, source, direction)
    slot = views.slot[place.view]
    store(scene, slot, nearest_surface(scene, slot, start, away, MIRROR_FAR_M, -1), away, ray, mirrored_out)


@wp.kernel
def mirror_surface_kernel(
    scene: Scene,
    appearance: Appearance,
    views: Views,
    camera: Camera,
    extras: Extras,
    samples: Samples,
    surfaces: Surfaces,
    row: wp.array[int],
    mirrored_samples: Samples,
    # out
    surfaces_out: Surfaces,
):
    """Read colours, roughness and normals of what mirrored rays meet.

    Launch: dim=mirrored rays, block_dim=64.
    """
    ray = wp.tid()
    face = mirrored_samples.face[ray]
    if face < 0:
        return
    source = row[ray]
    place = place_of(camera, extras, source)
    direction = pixel_direction(camera, views.pose[place.view], place.u, place.v)
    start = mirror_start(views, samples, source, place.view, direction)
    away = mirror_direction(appearance, samples, surfaces, source, direction)
    surfel = surfel_of(
        scene, appearance, views.slot[place.view], start, away, mirrored_samples.t[ray], face,
        mirrored_samples.instance[ray], (1.0 + samples.t[source] / mirrored_samples.t[ray]) / camera.fx,
    )  # fmt: skip
    write_surface(surfel, ray, surfaces_out)


@wp.kernel(cuda_max_registers=TRACE_REGISTERS)
def mirror_sun_kernel(
    scene: Scene,
    appearance: Appearance,
    views: Views,
    camera: Camera,
    extras: Extras,
    samples: Samples,
    surfaces: Surfaces,
    row: wp.array[int],
    mirrored_samples: Samples,
    sun: wp.vec3,
    sun_radius: float,
    grid: SunGrid,
    candidates: Candidates,
    # out
    sun_out: wp.array[wp.uint8],
):
    """Send a ray to the sun from what mirrored rays meet: 255 where it arrives, else 0.

    Launch: dim=mirrored rays, block_dim=64.
    """
    ray = wp.tid()
    is_lit = wp.bool(False)
    if mirrored_samples.face[ray] >= 0:
        source = row[ray]
        place = place_of(camera, extras, source)
        direction = pixel_direction(camera, views.pose[place.view], place.u, place.v)
        start = mirror_start(views, samples, source, place.view, direction)
        away = mirror_direction(appearance, samples, surfaces, source, direction)
        t = mirrored_samples.t[ray]
        normal = unpack_unit(mirrored_samples.normal[ray])
        stratum = stratum_point(int(place.u), int(place.v), 4)
        is_lit = sees_sun(
            scene, views.slot[place.view], lift(start + t * away, normal, t), normal, sun, sun_radius, stratum, grid,
            candidates,
        )  # fmt: skip
    sun_out[ray] = wp.where(is_lit, wp.uint8(255), wp.uint8(0))
