"""Describe flat surfaces and link ends for the channel kernels, in float64, with their geometric tests."""

import warp as wp

from mmw.kernels.channel.box_tree import BoxTrees, in_box, largest, next_leaf
from mmw.kernels.core.compiler import DOUBLE_PRECISION
from mmw.kernels.core.geometry import is_inside, reflection_point

wp.set_module_options(DOUBLE_PRECISION)

EDGE_MARGIN = wp.constant(wp.float64(1e-9))
"""A point this close to a triangle's edge is in the triangle [m]: no gap opens between neighbors."""
LIFT = wp.constant(wp.float64(2e-6))
"""A ray starts off its surface by this times (5 m + largest coordinate): 16 roundings of float32."""

BOX_TOLERANCE = wp.constant(wp.vec3d(1e-3, 1e-3, 1e-3))
"""Tolerance of a traced point against the box of its surface [m]."""


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
    triangles: BoxTrees
    """Trees of the triangles of each row; boxes have what counts as in its triangles too."""
    is_slab: wp.array[wp.uint8]
    """1 where a wave can pass through the surface in some weather, shape [G]."""
    plane: wp.array[int]
    """Plane that each surface lies in: coplanar surfaces of one carrier have one, shape [G]."""
    lead: wp.array[int]
    """Largest surface of each plane, whose mean plane it has, shape [K]."""
    plane_lower: wp.array[wp.vec3d]
    """Low corner of the box of each plane's surfaces, in the carrier's frame [m], shape [K]."""
    plane_upper: wp.array[wp.vec3d]
    """High corner of that box [m], shape [K]."""
    first_member: wp.array[int]
    """First entry of each plane in `member`, and the number of entries, shape [K + 1]."""
    member: wp.array[int]
    """Surfaces of each plane, the smallest first, one plane after the other, shape [G]."""
    members: BoxTrees
    """Trees of the entries of `member` of each plane."""


@wp.struct
class LinkEnds:
    """Both ends of every link in the frame of every instance, and in the world frame (column V), float64."""

    batch_index: wp.array[int]
    """Position of the link's frame in the batch, shape [L]."""
    source: wp.array[int]
    """Row of the link's transmitter among the launched ones, shape [L]."""
    tx: wp.array2d[wp.vec3d]
    """Transmitter [m], shape [L, V + 1]."""
    rx: wp.array2d[wp.vec3d]
    """Receiver [m], shape [L, V + 1]."""


@wp.struct
class Plane:
    """A plane normal . p = offset in the world frame."""

    normal: wp.vec3d
    offset: wp.float64


@wp.func
def lift_at(point: wp.vec3d) -> wp.float64:
    """Return how far off a surface at a point of the scene frame a ray starts [m]."""
    return LIFT * (wp.float64(5.0) + largest(point))


@wp.func
def is_mirror(normal: wp.vec3d, offset: wp.float64, tx: wp.vec3d, rx: wp.vec3d) -> bool:
    """Return whether both ends lie on one side of a plane, off it. False for the NaN pose of an absent instance."""
    tx_height = wp.dot(normal, tx) - offset
    rx_height = wp.dot(normal, rx) - offset
    return tx_height * rx_height > wp.float64(0.0) and wp.abs(tx_height + rx_height) > wp.float64(1e-9)


@wp.func
def mirrored(point: wp.vec3d, plane: Plane) -> wp.vec3d:
    """Return the image of a point behind a plane."""
    return point - wp.float64(2.0) * (wp.dot(plane.normal, point) - plane.offset) * plane.normal


@wp.func
def to_world(plane: Plane, pose: wp.array2d[wp.transformd], batch_index: int, carrier: int) -> Plane:
    """Return a plane of an instance's frame in the world frame; the town's (carrier = number of instances) as it is."""
    moved = Plane()
    moved.normal = plane.normal
    moved.offset = plane.offset
    if carrier < pose.shape[1]:
        moved.normal = wp.transform_vector(pose[batch_index, carrier], plane.normal)
        moved.offset = plane.offset + wp.dot(moved.normal, wp.transform_get_translation(pose[batch_index, carrier]))
    return moved


@wp.func
def mean_plane(surfaces: Surfaces, pose: wp.array2d[wp.transformd], batch_index: int, surface: int) -> Plane:
    """Return the mean plane of a surface in the world frame. `pose` has V columns, none for a scene of a town only."""
    row = surfaces.row[surface]
    plane = Plane()
    plane.normal = surfaces.normal[row]
    plane.offset = surfaces.offset[row]
    return to_world(plane, pose, batch_index, surfaces.carrier[surface])


@wp.func
def to_carrier(point: wp.vec3d, pose: wp.array2d[wp.transformd], batch_index: int, carrier: int) -> wp.vec3d:
    """Return a world point in the frame of what carries a surface."""
    local = point
    if carrier < pose.shape[1]:
        local = wp.transform_point(wp.transform_inverse(pose[batch_index, carrier]), point)
    return local


@wp.func
def from_carrier(point: wp.vec3d, pose: wp.array2d[wp.transformd], batch_index: int, carrier: int) -> wp.vec3d:
    """Return a point in the frame of what carries a surface in the world frame."""
    world = point
    if carrier < pose.shape[1]:
        world = wp.transform_point(pose[batch_index, carrier], point)
    return world


@wp.func
def in_plane_box(
    surfaces: Surfaces, pose: wp.array2d[wp.transformd], batch_index: int, plane: int, point: wp.vec3d
) -> bool:
    """Return whether a world point lies in the box of a plane's surfaces, or very near it."""
    local = to_carrier(point, pose, batch_index, surfaces.carrier[surfaces.lead[plane]])
    return in_box(surfaces.plane_lower[plane], surfaces.plane_upper[plane], local)


@wp.func
def in_triangle(surfaces: Surfaces, corner: int, local: wp.vec3d) -> bool:
    """Return whether a triangle, given by its first corner, holds a point in its own frame."""
    return is_inside(
        local, surfaces.corner[corner], surfaces.corner[corner + 1], surfaces.corner[corner + 2], EDGE_MARGIN
    )


@wp.func
def local_triangle(surfaces: Surfaces, surface: int, local: wp.vec3d) -> int:
    """Return the first corner of the triangle of a surface that holds a point in its own frame, -1 if none does."""
    row = surfaces.row[surface]
    found = wp.int32(-1)
    node = surfaces.triangles.root[row]
    if node < 0:
        corner = 3 * surfaces.first[row]
        end = corner + 3 * surfaces.triangle_count[row]
        while corner < end and found < 0:
            if in_triangle(surfaces, corner, local):
                found = corner
            corner = corner + 3
        return found
    end = surfaces.triangles.node[node][0]
    while node < end:
        node = next_leaf(surfaces.triangles, node, end, local, wp.vec3d())
        if node < end:
            leaf = surfaces.triangles.node[node]
            for place in range(leaf[1], leaf[2]):
                corner = 3 * surfaces.triangles.order[place]
                if (found < 0 or corner < found) and in_triangle(surfaces, corner, local):
                    found = corner
            node = node + 1
    return found


@wp.func
def triangle_at(
    surfaces: Surfaces, pose: wp.array2d[wp.transformd], batch_index: int, surface: int, point: wp.vec3d
) -> int:
    """Return the first corner of the triangle of a surface that holds a world point, -1 if none does."""
    return local_triangle(surfaces, surface, to_carrier(point, pose, batch_index, surfaces.carrier[surface]))


@wp.func
def holds(surfaces: Surfaces, surface: int, local: wp.vec3d, slack: wp.vec3d) -> bool:
    """Return whether a surface holds a point of its plane in its carrier's frame; its box counts with some slack."""
    row = surfaces.row[surface]
    is_near = in_box(surfaces.lower[row] - slack, surfaces.upper[row] + slack, local)
    return is_near and local_triangle(surfaces, surface, local) >= 0


@wp.func
def next_member(surfaces: Surfaces, plane: int, after: int, local: wp.vec3d, slack: wp.vec3d) -> int:
    """Return the first entry of `member` behind `after` whose surface holds a point of a plane, -1 if none does.

    Args:
        surfaces: The surfaces.
        plane: The plane.
        after: Entry of `member` of the plane, or the one before its first.
        local: The point in the frame of the plane's carrier [m].
        slack: Slack of the boxes of the surfaces [m].
    """
    found = wp.int32(-1)
    node = surfaces.members.root[plane]
    if node < 0:
        index = after + 1
        while index < surfaces.first_member[plane + 1] and found < 0:
            if holds(surfaces, surfaces.member[index], local, slack):
                found = index
            index = index + 1
        return found
    end = surfaces.members.node[node][0]
    while node < end:
        node = next_leaf(surfaces.members, node, end, local, slack)
        if node < end:
            leaf = surfaces.members.node[node]
            for place in range(leaf[1], leaf[2]):
                index = surfaces.members.order[place]
                is_sooner = index > after and (found < 0 or index < found)
                if is_sooner and holds(surfaces, surfaces.member[index], local, slack):
                    found = index
            node = node + 1
    return found


@wp.func
def surface_at(
    surfaces: Surfaces, pose: wp.array2d[wp.transformd], batch_index: int, plane: int, point: wp.vec3d
) -> int:
    """Return the smallest surface of a plane that holds a world point, -1 if none does."""
    local = to_carrier(point, pose, batch_index, surfaces.carrier[surfaces.lead[plane]])
    index = next_member(surfaces, plane, surfaces.first_member[plane] - 1, local, wp.vec3d())
    if index < 0:
        return -1
    return surfaces.member[index]


@wp.func
def triangle_plane(
    surfaces: Surfaces, pose: wp.array2d[wp.transformd], batch_index: int, surface: int, corner: int
) -> Plane:
    """Return the plane of a triangle, given by its first corner, in the world frame."""
    a = surfaces.corner[corner]
    plane = Plane()
    plane.normal = wp.normalize(wp.cross(surfaces.corner[corner + 1] - a, surfaces.corner[corner + 2] - a))
    plane.offset = wp.dot(plane.normal, a)
    return to_world(plane, pose, batch_index, surfaces.carrier[surface])


@wp.func
def plane_at(
    surfaces: Surfaces, pose: wp.array2d[wp.transformd], batch_index: int, surface: int, point: wp.vec3d
) -> Plane:
    """Return the plane of the triangle of a surface that holds a world point, its mean plane if none does."""
    plane = mean_plane(surfaces, pose, batch_index, surface)
    corner = triangle_at(surfaces, pose, batch_index, surface, point)
    if corner >= 0:
        plane = triangle_plane(surfaces, pose, batch_index, surface, corner)
    return plane


@wp.func
def mirror_point(plane: Plane, image: wp.vec3d, target: wp.vec3d) -> wp.vec3d:
    """Return where a plane reflects what comes from `image` to `target`; both on one side, see `is_mirror`."""
    return reflection_point(image, target, plane.normal, plane.offset)
