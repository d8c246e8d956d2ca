"""Trace rays to rough patches in float64, and connect the patches with the other end of their links."""

import warp as wp

from mmw.kernels.channel.segments import (
    END_SLACK,
    MIN_PATH_M,
    SPECULAR,
    TRANSMISSION,
    HitBuffers,
    Segment,
    trace_segment,
)
from mmw.kernels.channel.surfaces import LinkEnds, Surfaces, lift_at, plane_at
from mmw.kernels.core.compiler import DOUBLE_PRECISION
from mmw.kernels.core.geometry import fibonacci_direction_64, single
from mmw.kernels.core.structs import MISS_ID, Scene
from mmw.kernels.core.trace import closest_hit_raw, surface_of

wp.set_module_options(DOUBLE_PRECISION)


ROOT_2 = wp.constant(wp.float64(1.4142135623730951))
ROOT_3 = wp.constant(wp.float64(1.7320508075688772))


@wp.struct
class RayHit:
    """Surface that a ray meets."""

    surface: int
    """Global surface, -1 for none."""
    distance: wp.float64
    """Distance to its plane from the point that the ray comes from [m]."""
    normal: wp.vec3d
    """Its unit normal, turned against the ray."""


@wp.func
def next_hit(
    scene: Scene, surfaces: Surfaces, pose: wp.array2d[wp.transformd], origin: wp.vec3d, batch_index: int,
    begin: wp.vec3d, vertex: wp.vec3d, direction: wp.vec3d,
) -> RayHit:  # fmt: skip
    """Return the surface that a ray from `vertex`, which starts at `begin` off its surface, meets next."""
    hit = RayHit()
    near = closest_hit_raw(scene, batch_index, single(begin - origin), single(direction), wp.inf, MISS_ID)
    hit.surface = MISS_ID
    surface = surface_of(scene, near)
    if surface != MISS_ID:
        at = begin + wp.float64(near.t) * direction
        plane = plane_at(surfaces, pose, batch_index, surface, at)
        along = wp.dot(plane.normal, direction)
        hit.distance = (plane.offset - wp.dot(plane.normal, vertex)) / along
        if wp.abs(along) > wp.float64(1e-6) and hit.distance > MIN_PATH_M:
            hit.surface = surface
            hit.normal = wp.where(along > wp.float64(0.0), -plane.normal, plane.normal)
    return hit


@wp.func
def hemisphere_direction(ray: int, normal: wp.vec3d) -> wp.vec3d:
    """Return a direction of ray `ray` on the side of a unit normal; those of all rays are even over solid angle.

    Source: R. D. Richtmyer, "The evaluation of definite integrals, and a quasi-Monte-Carlo method based on the
    properties of algebraic numbers", Los Alamos report LA-1342, 1951: fractional parts of multiples of roots, which
    have no relation to those of the golden ratio, by which rays leave the transmitter.
    """
    height = wp.float64(ray) * ROOT_2
    turn = wp.float64(ray) * ROOT_3
    z = height - wp.floor(height)
    azimuth = wp.float64(2.0) * wp.float64(wp.PI) * (turn - wp.floor(turn))
    axis = wp.vec3d(wp.float64(1.0), wp.float64(0.0), wp.float64(0.0))
    if wp.abs(normal[0]) > wp.float64(0.9):
        axis = wp.vec3d(wp.float64(0.0), wp.float64(1.0), wp.float64(0.0))
    one = wp.normalize(wp.cross(normal, axis))
    other = wp.cross(normal, one)
    across = wp.sqrt(wp.max(wp.float64(1.0) - z * z, wp.float64(0.0)))
    return across * wp.cos(azimuth) * one + across * wp.sin(azimuth) * other + z * normal


@wp.kernel
def scatter_kernel(
    scene: Scene,
    surfaces: Surfaces,
    pose: wp.array2d[wp.transformd],
    origin: wp.vec3d,
    batch_index: wp.array[int],
    start: wp.array[wp.vec3d],
    ray_count: int,
    is_mirroring: int,
    passes: int,
    # out
    kind_out: wp.array3d[int],
    surface_out: wp.array3d[int],
    point_out: wp.array3d[wp.vec3d],
    normal_out: wp.array3d[wp.vec3d],
):
    """Follow each ray and write its hits: surface, exact point, normal against the ray, and how it goes on.

    It goes on as a mirror reflection, through the slab where bit k of `passes` is set for its k-th surface, or not at
    all. The outputs have a row a source, ray and interaction; `surface_out` starts as -1, which stays from where a ray
    hits nothing. `origin` is the world position of the scene frame's origin; `start` is in the world frame [m]. Launch:
    dim=(A, ray_count), block_dim=64.

    Nothing follows the loop over the hits. On an H100, code behind it ran for some threads of a warp while others were
    still in the loop, and loaded uniform registers that the compiler (NVRTC of Warp 1.19) had given to the loop: its
    addresses were wrong then.
    """
    source, ray = wp.tid()
    depth = surface_out.shape[2]
    own_batch_index = batch_index[source]
    vertex = start[source]
    begin = vertex
    direction = fibonacci_direction_64(ray, ray_count)
    hit_count = wp.int32(0)
    is_active = wp.bool(True)
    while is_active and hit_count < depth:
        hit = next_hit(scene, surfaces, pose, origin, own_batch_index, begin, vertex, direction)
        is_active = hit.surface != MISS_ID
        if is_active:
            vertex = vertex + hit.distance * direction
            lift = lift_at(vertex - origin)
            surface_out[source, ray, hit_count] = hit.surface
            point_out[source, ray, hit_count] = vertex
            normal_out[source, ray, hit_count] = hit.normal
            if (passes >> hit_count) & 1 == 1:
                kind_out[source, ray, hit_count] = TRANSMISSION
                is_active = surfaces.is_slab[hit.surface] != wp.uint8(0)
                begin = vertex - lift * hit.normal
            else:
                kind_out[source, ray, hit_count] = SPECULAR
                is_active = is_mirroring == 1
                direction = wp.normalize(direction - wp.float64(2.0) * wp.dot(hit.normal, direction) * hit.normal)
                begin = vertex + lift * hit.normal
            hit_count = hit_count + 1


@wp.kernel
def second_patch_kernel(
    scene: Scene,
    surfaces: Surfaces,
    pose: wp.array2d[wp.transformd],
    origin: wp.vec3d,
    batch_index: wp.array[int],
    ray: wp.array[int],
    point: wp.array[wp.vec3d],
    normal: wp.array[wp.vec3d],
    # out
    surface_out: wp.array[int],
    point_out: wp.array[wp.vec3d],
    normal_out: wp.array[wp.vec3d],
):
    """Send one ray from each patch, in a direction of its hemisphere, and write what it meets.

    `surface_out` is -1 where it meets nothing; `normal_out` is turned against the ray. Launch: dim=B, block_dim=64.
    """
    row = wp.tid()
    direction = hemisphere_direction(ray[row], normal[row])
    begin = point[row] + lift_at(point[row] - origin) * normal[row]
    hit = next_hit(scene, surfaces, pose, origin, batch_index[row], begin, point[row], direction)
    surface_out[row] = hit.surface
    point_out[row] = point[row] + hit.distance * direction
    normal_out[row] = hit.normal


@wp.kernel
def connect_kernel(
    scene: Scene,
    ends: LinkEnds,
    surfaces: Surfaces,
    pose: wp.array2d[wp.transformd],
    origin: wp.vec3d,
    link: wp.array[int],
    surface: wp.array[int],
    point: wp.array[wp.vec3d],
    normal: wp.array[wp.vec3d],
    max_slabs: wp.array[int],
    # out
    count_out: wp.array[int],
    hits_out: HitBuffers,
):
    """Go from a patch straight to the far end (`rx`) of a link, on the side of the patch's normal.

    `count_out` is the number of slabs in between, at most `max_slabs` of the row, -1 where the end does not see the
    patch; the slabs themselves fill `hits_out`, from the patch on. Launch: dim=B, block_dim=64.
    """
    row = wp.tid()
    world = ends.tx.shape[1] - 1
    rx = ends.rx[link[row], world]
    segment = Segment()
    segment.begin = point[row]
    segment.end = rx
    count_out[row] = -1
    is_far = wp.length(rx - segment.begin) > MIN_PATH_M
    if is_far and wp.dot(normal[row], rx - segment.begin) > wp.float64(0.0):
        segment.start = segment.begin + lift_at(segment.begin - origin) * normal[row]
        segment.stop = rx + END_SLACK * (segment.begin - rx)
        segment.own = wp.vec4i(surface[row], MISS_ID, MISS_ID, MISS_ID)
        index = ends.batch_index[link[row]]
        count_out[row] = trace_segment(scene, surfaces, pose, origin, index, segment, row, 0, max_slabs[row], hits_out)


@wp.kernel
def mirror_kernel(
    scene: Scene,
    ends: LinkEnds,
    surfaces: Surfaces,
    pose: wp.array2d[wp.transformd],
    origin: wp.vec3d,
    link: wp.array[int],
    point: wp.array[wp.vec3d],
    normal: wp.array[wp.vec3d],
    image: wp.array[wp.vec3d],
    planes: wp.array2d[int],
    # out
    is_seen_out: wp.array[int],
    hits_out: HitBuffers,
):
    """Go from a patch over mirrors to the near end (`tx`) of a link.

    `image` is that end behind the mirrors, `planes` those from the end on, -1 behind the last. `is_seen_out` is 1 if
    the ray to the image meets them in turn and its last segment is free; then `hits_out` has the mirrors in their
    order from the end on. Launch: dim=B, block_dim=64.
    """
    row = wp.tid()
    index = ends.batch_index[link[row]]
    near = ends.tx[link[row], ends.tx.shape[1] - 1]
    is_seen_out[row] = 0
    vertex = point[row]
    begin = vertex + lift_at(vertex - origin) * normal[row]
    direction = wp.normalize(image[row] - vertex)
    mirror = wp.int32(0)
    while mirror < planes.shape[1] and planes[row, mirror] != MISS_ID:
        mirror = mirror + 1
    is_open = wp.bool(True)
    own = wp.int32(MISS_ID)
    while is_open and mirror > 0:
        mirror = mirror - 1
        hit = next_hit(scene, surfaces, pose, origin, index, begin, vertex, direction)
        own = hit.surface
        is_open = own != MISS_ID
        if is_open:
            is_open = surfaces.plane[own] == planes[row, mirror]
        if is_open:
            vertex = vertex + hit.distance * direction
            hits_out.kind[row, mirror] = SPECULAR
            hits_out.surface[row, mirror] = own
            hits_out.vertex[row, mirror] = vertex
            hits_out.normal[row, mirror] = hit.normal
            direction = wp.normalize(direction - wp.float64(2.0) * wp.dot(hit.normal, direction) * hit.normal)
            begin = vertex + lift_at(vertex - origin) * hit.normal
    if is_open:
        segment = Segment()
        segment.begin = vertex
        segment.end = near
        segment.start = begin
        segment.stop = near + END_SLACK * (vertex - near)
        segment.own = wp.vec4i(own, MISS_ID, MISS_ID, MISS_ID)
        is_open = wp.dot(direction, near - vertex) > wp.float64(0.0)
        if is_open and trace_segment(scene, surfaces, pose, origin, index, segment, row, 0, 0, hits_out) == 0:
            is_seen_out[row] = 1
