"""Rough patches: where the rays of one end of a link hit surfaces, in float64, and which other ends see the patch."""

import warp as wp

from mmw.kernels.channel.segments import END_SLACK, LIFT, MIN_LEG, SPECULAR, TRANSMISSION, HitBuffers, walk_leg
from mmw.kernels.channel.surfaces import LinkEnds, Surfaces, largest, mean_plane, single, triangle_at, triangle_plane
from mmw.kernels.core.geometry import fibonacci_direction_64
from mmw.kernels.core.structs import MISS_ID, Scene
from mmw.kernels.core.trace import closest_hit_raw, surface_of

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})


@wp.kernel
def scatter_kernel(
    scene: Scene,
    surfaces: Surfaces,
    pose: wp.array2d[wp.transformd],
    origin: wp.vec3d,
    slot: wp.array[int],
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
    own_slot = slot[source]
    place = start[source]
    begin = place
    direction = fibonacci_direction_64(ray, ray_count)
    met = wp.int32(0)
    is_open = wp.bool(True)
    while is_open and met < depth:
        near = closest_hit_raw(scene, own_slot, single(begin - origin), single(direction), wp.inf, MISS_ID)
        surface = surface_of(scene, near)
        is_open = surface != MISS_ID
        if is_open:
            at = begin + wp.float64(near.t) * direction
            plane = mean_plane(surfaces, pose, own_slot, surface)
            corner = triangle_at(surfaces, pose, own_slot, surface, at)
            if corner >= 0:
                plane = triangle_plane(surfaces, pose, own_slot, surface, corner)
            along = wp.dot(plane.normal, direction)
            leg = (plane.offset - wp.dot(plane.normal, place)) / along
            is_open = wp.abs(along) > wp.float64(1e-6) and leg > MIN_LEG
            if is_open:
                normal = wp.where(along > wp.float64(0.0), -plane.normal, plane.normal)
                place = place + leg * direction
                lift = LIFT * (wp.float64(5.0) + largest(place - origin))
                surface_out[source, ray, met] = surface
                point_out[source, ray, met] = place
                normal_out[source, ray, met] = normal
                if (passes >> met) & 1 == 1:
                    kind_out[source, ray, met] = TRANSMISSION
                    is_open = surfaces.is_open[surface] != wp.uint8(0)
                    begin = place - lift * normal
                else:
                    kind_out[source, ray, met] = SPECULAR
                    is_open = is_mirroring == 1
                    direction = wp.normalize(direction - wp.float64(2.0) * wp.dot(normal, direction) * normal)
                    begin = place + lift * normal
                met = met + 1
    while met < depth:
        surface_out[source, ray, met] = MISS_ID
        met = met + 1


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
    room: wp.array[int],
    # out
    count_out: wp.array[int],
    met_out: HitBuffers,
):
    """Go from a patch straight to the far end (`rx`) of a link, on the side of the patch's normal.

    `count_out` is the number of slabs on the way, at most `room` of the row, -1 where the end does not see the patch;
    the slabs themselves fill `met_out`, from the patch on. Launch: dim=B, block_dim=64.
    """
    row = wp.tid()
    world = ends.tx.shape[1] - 1
    rx = ends.rx[link[row], world]
    begin = point[row]
    count_out[row] = -1
    if wp.dot(normal[row], rx - begin) > wp.float64(0.0):
        start = begin + LIFT * (wp.float64(5.0) + largest(begin - origin)) * normal[row]
        stop = rx + END_SLACK * (begin - rx)
        own = wp.vec4i(surface[row], MISS_ID, MISS_ID, MISS_ID)
        count_out[row] = walk_leg(
            scene,
            surfaces,
            pose,
            origin,
            ends.slot[link[row]],
            begin,
            rx,
            start,
            stop,
            own,
            row,
            0,
            room[row],
            met_out,
        )
