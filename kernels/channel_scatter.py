"""Rough patches: where the rays of a transmitter meet surfaces, in float64, and which receivers see the patch."""

import warp as wp

from mmw.kernels.channel_refine import END_SLACK, LIFT, walk_leg
from mmw.kernels.channel_surfaces import LinkEnds, Surfaces, largest, mean_plane, single, triangle_at, triangle_plane
from mmw.kernels.geometry import fibonacci_direction_64
from mmw.kernels.structs import MISS_ID, Scene
from mmw.kernels.trace import nearest_surface, surface_of

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})


@wp.kernel
def scatter_kernel(
    scene: Scene,
    surfaces: Surfaces,
    pose: wp.array2d[wp.transformd],
    origin: wp.vec3d,
    slot: wp.array[int],
    tx: wp.array[wp.vec3d],
    ray_count: int,
    # out
    surface_out: wp.array3d[int],
    point_out: wp.array3d[wp.vec3d],
    normal_out: wp.array3d[wp.vec3d],
):
    """Follow each ray from mirror to mirror and write what it meets: surface, exact point and normal against the ray.

    The outputs have a row a source, ray and interaction, surface -1 from where a ray meets nothing. `origin` is the
    world position of the scene frame's origin; `tx` are in the world frame [m].
    Launch: dim=(A, ray_count), block_dim=64.
    """
    source, ray = wp.tid()
    depth = surface_out.shape[2]
    own_slot = slot[source]
    place = tx[source]
    begin = place
    direction = fibonacci_direction_64(ray, ray_count)
    met = wp.int32(0)
    is_open = wp.bool(True)
    while is_open and met < depth:
        near = nearest_surface(scene, own_slot, single(begin - origin), single(direction), wp.inf, MISS_ID)
        surface = surface_of(scene, near)
        is_open = surface != MISS_ID
        if is_open:
            at = begin + wp.float64(near.t) * direction
            plane = mean_plane(surfaces, pose, own_slot, surface)
            corner = triangle_at(surfaces, pose, own_slot, surface, at)
            if corner >= 0:
                plane = triangle_plane(surfaces, pose, own_slot, surface, corner)
            along = wp.dot(plane.normal, direction)
            is_open = wp.abs(along) > wp.float64(1e-6)
            if is_open:
                normal = wp.where(along > wp.float64(0.0), -plane.normal, plane.normal)
                place = place + (plane.offset - wp.dot(plane.normal, place)) / along * direction
                surface_out[source, ray, met] = surface
                point_out[source, ray, met] = place
                normal_out[source, ray, met] = normal
                direction = wp.normalize(direction - wp.float64(2.0) * wp.dot(normal, direction) * normal)
                begin = place + LIFT * (wp.float64(5.0) + largest(place - origin)) * normal
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
    scratch: wp.array2d[int],
    scratch_points: wp.array2d[wp.vec3d],
    # out
    is_seen_out: wp.array[wp.uint8],
):
    """Test whether the receiver of a link sees a patch, from the side of its normal; the scratch arrays stay unused.

    Launch: dim=B, block_dim=64.
    """
    row = wp.tid()
    world = ends.tx.shape[1] - 1
    rx = ends.rx[link[row], world]
    begin = point[row]
    is_seen = wp.dot(normal[row], rx - begin) > wp.float64(0.0)
    if is_seen:
        start = begin + LIFT * (wp.float64(5.0) + largest(begin - origin)) * normal[row]
        stop = rx + END_SLACK * (begin - rx)
        own = wp.vec4i(surface[row], MISS_ID, MISS_ID, MISS_ID)
        is_seen = (
            walk_leg(
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
                0,
                0,
                0,
                scratch,
                scratch,
                scratch_points,
                scratch_points,
            )
            == 0
        )
    is_seen_out[row] = wp.where(is_seen, wp.uint8(1), wp.uint8(0))
