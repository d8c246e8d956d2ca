"""Image method in float64 and visibility: from candidate surfaces to exact points of reflection."""

import warp as wp

from mmw.kernels.geometry import is_inside, reflection_point
from mmw.kernels.structs import MISS_ID, Scene
from mmw.kernels.trace import closest_hit, is_blocked

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})

EDGE_MARGIN = wp.constant(wp.float64(1e-9))
"""A point this close to a triangle's edge is in the triangle [m]: no gap opens between neighbours."""
BOX_MARGIN = wp.constant(wp.float64(1e-6))
"""Slack of the box test, which only has to be generous [m]."""
MIN_LEG = wp.constant(wp.float64(0.01))
"""Shortest leg of a path [m]; nearer than this the far field means nothing. Source: Sionna RT 2.2 uses the same."""
LIFT = wp.constant(wp.float64(2e-6))
"""A leg starts off its surface by this times (5 m + largest coordinate): 16 roundings of float32."""
COVER_SHARE = wp.constant(wp.float64(0.75))
"""Share of the lift, from its upper end, that is searched for a surface that lies on the reflecting one."""
LINKS_AT_ONCE = wp.constant(8)
"""Links that one thread tests against its surface: the plane is read once for them."""
END_SLACK = wp.constant(wp.float64(6e-6))
"""Share of a leg at each antenna that is not searched for obstacles: an antenna may lie on a surface."""


@wp.struct
class Surfaces:
    """Flat surfaces of town and instances; geometry rows are in the frame of what carries them, float64."""

    row: wp.array[int]
    """Geometry row of each surface, shape [G]."""
    carrier: wp.array[int]
    """Instance that carries the surface, V (the number of instances) for the town, shape [G]."""
    normal: wp.array[wp.vec3d]
    """Mean plane of each row: unit normal, shape [K]."""
    offset: wp.array[wp.float64]
    """Mean plane of each row: normal . p [m], shape [K]."""
    lower: wp.array[wp.vec3d]
    """Low corner of the row's box [m], shape [K]."""
    upper: wp.array[wp.vec3d]
    """High corner of the row's box [m], shape [K]."""
    first: wp.array[int]
    """First triangle of each row, shape [K]."""
    triangle_count: wp.array[int]
    """Triangles of each row, shape [K]."""
    corner: wp.array[wp.vec3d]
    """Corners of all triangles [m], shape [3 T]."""


@wp.struct
class LinkEnds:
    """Both ends of every link in the frame of every instance, and in the world frame (column V), float64."""

    slot: wp.array[int]
    """Slot of the link's frame, shape [L]."""
    source: wp.array[int]
    """Row of the link's transmitter among the launched ones, shape [L]."""
    tx: wp.array2d[wp.vec3d]
    """Transmitter [m], shape [L, V + 1]."""
    rx: wp.array2d[wp.vec3d]
    """Receiver [m], shape [L, V + 1]."""


@wp.func
def largest(v: wp.vec3d) -> wp.float64:
    """Return the largest magnitude among the components."""
    return wp.max(wp.max(wp.abs(v[0]), wp.abs(v[1])), wp.abs(v[2]))


@wp.func
def single(v: wp.vec3d) -> wp.vec3:
    """Return a vector in the precision of the tracer."""
    return wp.vec3(wp.float32(v[0]), wp.float32(v[1]), wp.float32(v[2]))


@wp.func
def is_covered(
    scene: Scene, slot: int, start: wp.vec3d, normal: wp.vec3d, lift: wp.float64, origin: wp.vec3d, surface: int
) -> bool:
    """Return whether another surface lies between a point of reflection and `start`, its legs' start above it."""
    reach = wp.float32(lift * COVER_SHARE)
    hit = closest_hit(scene, slot, single(start - origin), -single(normal), reach, MISS_ID)
    return hit.surface != MISS_ID and hit.surface != surface


@wp.func
def has_leg(scene: Scene, slot: int, start: wp.vec3d, end: wp.vec3d, origin: wp.vec3d, surface: int) -> bool:
    """Return whether nothing stands between two points; `surface` itself, being flat, cannot stand in its own light."""
    leg = end - start
    length = wp.length(leg)
    if not length > MIN_LEG:
        return False
    place = single(start - origin)
    direction = wp.normalize(single(leg / length))
    left = wp.float32(length * (wp.float64(1.0) - END_SLACK))
    is_clear = not is_blocked(scene, slot, place, direction, left, MISS_ID)
    tries = wp.int32(4)
    while not is_clear and tries > 0:  # rarely entered: a surface that is flat to its tolerance only, at grazing angles
        hit = closest_hit(scene, slot, place, direction, left, MISS_ID)
        if hit.surface == MISS_ID:
            is_clear = True
        elif hit.surface == surface:
            step = hit.t + 1e-5 * (1.0 + hit.t)
            place = place + step * direction
            left = left - step
            tries = tries - 1
        else:
            tries = 0
    return is_clear


@wp.kernel
def sight_kernel(
    scene: Scene,
    ends: LinkEnds,
    origin: wp.vec3d,
    # out
    is_clear_out: wp.array[wp.uint8],
):
    """Test the line of sight of every link; `origin` is the world position of the scene frame's origin.

    Launch: dim=L, block_dim=64.
    """
    link = wp.tid()
    world = scene.instance_count
    tx = ends.tx[link, world]
    rx = ends.rx[link, world]
    is_clear = has_leg(scene, ends.slot[link], tx + END_SLACK * (rx - tx), rx, origin, MISS_ID)
    is_clear_out[link] = wp.where(is_clear, wp.uint8(1), wp.uint8(0))


@wp.func
def is_mirror(normal: wp.vec3d, offset: wp.float64, tx: wp.vec3d, rx: wp.vec3d) -> bool:
    """Return whether both ends lie on one side of a plane, off it. False for the NaN pose of an absent instance."""
    tx_height = wp.dot(normal, tx) - offset
    rx_height = wp.dot(normal, rx) - offset
    return tx_height * rx_height > wp.float64(0.0) and wp.abs(tx_height + rx_height) > wp.float64(1e-9)


@wp.kernel
def cull_kernel(
    ends: LinkEnds,
    surfaces: Surfaces,
    first_link: int,
    first_source: int,
    is_seen: wp.array2d[wp.uint8],
    # out
    is_candidate_out: wp.array2d[wp.uint8],
):
    """Keep the (link, surface) pairs whose point of reflection falls into the surface's box.

    A thread takes one surface and `LINKS_AT_ONCE` links. `is_seen` has a row for each source from `first_source`.
    Launch: dim=(ceil(L / LINKS_AT_ONCE), G).
    """
    block, surface = wp.tid()
    plane = surfaces.row[surface]
    normal = surfaces.normal[plane]
    offset = surfaces.offset[plane]
    carrier = surfaces.carrier[surface]
    row = block * LINKS_AT_ONCE
    stop = wp.min(row + LINKS_AT_ONCE, is_candidate_out.shape[0])
    while row < stop:
        link = first_link + row
        keep = wp.uint8(0)
        if is_seen[ends.source[link] - first_source, surface] != wp.uint8(0):
            tx = ends.tx[link, carrier]
            rx = ends.rx[link, carrier]
            if is_mirror(normal, offset, tx, rx):
                point = reflection_point(tx, rx, normal, offset)
                low = point - surfaces.lower[plane]
                high = surfaces.upper[plane] - point
                slack = -BOX_MARGIN * (wp.float64(1.0) + largest(point))
                if wp.min(low) >= slack and wp.min(high) >= slack:
                    keep = wp.uint8(1)
        is_candidate_out[row, surface] = keep
        row = row + 1


@wp.kernel
def refine_kernel(
    scene: Scene,
    ends: LinkEnds,
    surfaces: Surfaces,
    pose: wp.array2d[wp.transformd],
    origin: wp.vec3d,
    pair_link: wp.array[int],
    pair_surface: wp.array[int],
    # out
    is_path_out: wp.array[wp.uint8],
    vertex_out: wp.array[wp.vec3d],
    normal_out: wp.array[wp.vec3d],
):
    """Find the triangle that reflects, take the exact point on its plane, and test both legs.

    The mean plane of the surface picks the triangle, without gaps at inner edges; the plane of that triangle then gives
    point and normal. Launch: dim=C, block_dim=64.
    """
    pair = wp.tid()
    link = pair_link[pair]
    surface = pair_surface[pair]
    slot = ends.slot[link]
    carrier = surfaces.carrier[surface]
    world = scene.instance_count
    row = surfaces.row[surface]
    tx = ends.tx[link, carrier]
    rx = ends.rx[link, carrier]
    point = reflection_point(tx, rx, surfaces.normal[row], surfaces.offset[row])
    corner = 3 * surfaces.first[row]
    last = corner + 3 * surfaces.triangle_count[row]
    is_path_out[pair] = wp.uint8(0)
    is_found = wp.bool(False)
    while corner < last and not is_found:
        is_found = is_inside(
            point, surfaces.corner[corner], surfaces.corner[corner + 1], surfaces.corner[corner + 2], EDGE_MARGIN
        )
        corner = corner + 3
    if is_found:
        a = surfaces.corner[corner - 3]
        normal = wp.normalize(wp.cross(surfaces.corner[corner - 2] - a, surfaces.corner[corner - 1] - a))
        offset = wp.dot(normal, a)
        if is_mirror(normal, offset, tx, rx):
            point = reflection_point(tx, rx, normal, offset)
            if wp.dot(normal, tx) < offset:
                normal = -normal
            if carrier < world:
                point = wp.transform_point(pose[slot, carrier], point)
                normal = wp.transform_vector(pose[slot, carrier], normal)
            lift = LIFT * (wp.float64(5.0) + largest(point - origin))
            start = point + lift * normal
            if (
                not is_covered(scene, slot, start, normal, lift, origin, surface)
                and has_leg(scene, slot, start, ends.tx[link, world], origin, surface)
                and has_leg(scene, slot, start, ends.rx[link, world], origin, surface)
            ):
                is_path_out[pair] = wp.uint8(1)
                vertex_out[pair] = point
                normal_out[pair] = normal
