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
    all. The outputs have a row a source, ray and interaction, surface -1 from where a ray hits nothing. `origin` is the
    world position of the scene frame's origin; `start` is in the world frame [m]. Launch: dim=(A, ray_count),
    block_dim=64.
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
        near = closest_hit_raw(scene, own_batch_index, single(begin - origin), single(direction), wp.inf, MISS_ID)
        surface = surface_of(scene, near)
        is_active = surface != MISS_ID
        if is_active:
            at = begin + wp.float64(near.t) * direction
            plane = plane_at(surfaces, pose, own_batch_index, surface, at)
            along = wp.dot(plane.normal, direction)
            distance = (plane.offset - wp.dot(plane.normal, vertex)) / along
            is_active = wp.abs(along) > wp.float64(1e-6) and distance > MIN_PATH_M
            if is_active:
                normal = wp.where(along > wp.float64(0.0), -plane.normal, plane.normal)
                vertex = vertex + distance * direction
                lift = lift_at(vertex - origin)
                surface_out[source, ray, hit_count] = surface
                point_out[source, ray, hit_count] = vertex
                normal_out[source, ray, hit_count] = normal
                if (passes >> hit_count) & 1 == 1:
                    kind_out[source, ray, hit_count] = TRANSMISSION
                    is_active = surfaces.is_slab[surface] != wp.uint8(0)
                    begin = vertex - lift * normal
                else:
                    kind_out[source, ray, hit_count] = SPECULAR
                    is_active = is_mirroring == 1
                    direction = wp.normalize(direction - wp.float64(2.0) * wp.dot(normal, direction) * normal)
                    begin = vertex + lift * normal
                hit_count = hit_count + 1
    while hit_count < depth:
        surface_out[source, ray, hit_count] = MISS_ID
        hit_count = hit_count + 1


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
