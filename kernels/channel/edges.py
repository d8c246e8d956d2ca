"""Describe wedges, convex edges of two flat surfaces or of an open sheet, and find points of diffraction on them."""

import warp as wp

from mmw.kernels.channel.selected_pairs import select_pair
from mmw.kernels.core.compiler import DOUBLE_PRECISION

wp.set_module_options(DOUBLE_PRECISION)

EDGE_SLACK = wp.constant(wp.float64(1e-9))
"""A point this close beyond an end of an edge is on it [m]: no gap opens between the edges of one line."""


@wp.struct
class Wedges:
    """Straight convex edges of town and instances, in the frame of what carries them, float64."""

    carrier: wp.array[int]
    """Instance that carries the wedge, V for the town, shape [E]."""
    begin: wp.array[wp.vec3d]
    """One end of the edge [m], shape [E]."""
    end: wp.array[wp.vec3d]
    """Other end [m], shape [E]."""
    normal_0: wp.array[wp.vec3d]
    """Outward normal of one face, shape [E]."""
    normal_n: wp.array[wp.vec3d]
    """Outward normal of the other face, shape [E]."""
    away: wp.array[wp.vec3d]
    """Unit vector across the edge into the open, between the two normals, shape [E]."""
    surface_0: wp.array[int]
    """Surface of the first face, shape [E]."""
    surface_n: wp.array[int]
    """Surface of the second face, shape [E]."""
    reach: wp.array[wp.float64]
    """Length of the line of edges that each belongs to [m], shape [E]."""
    is_curved: wp.array[wp.uint8]
    """1 between two facets of one curved surface, shape [E]."""
    first: wp.array[int]
    """First entry of each plane in `of_plane`, and the number of entries, shape [K + 1]."""
    of_plane: wp.array[int]
    """The wedges at the surfaces of each plane, one plane after the other, shape [2 E]."""


@wp.struct
class Edge:
    """One wedge in the world frame."""

    begin: wp.vec3d
    along: wp.vec3d
    """Unit vector from `begin` to the other end."""
    length: wp.float64
    normal_0: wp.vec3d
    normal_n: wp.vec3d
    away: wp.vec3d
    """Unit vector across the edge into the open, between the two normals."""


@wp.func
def edge_world(wedges: Wedges, pose: wp.array2d[wp.transformd], batch_index: int, wedge: int) -> Edge:
    """Return a wedge in the world frame; `pose` has a column an instance."""
    begin = wedges.begin[wedge]
    end = wedges.end[wedge]
    edge = Edge()
    edge.normal_0 = wedges.normal_0[wedge]
    edge.normal_n = wedges.normal_n[wedge]
    edge.away = wedges.away[wedge]
    carrier = wedges.carrier[wedge]
    if carrier < pose.shape[1]:
        begin = wp.transform_point(pose[batch_index, carrier], begin)
        end = wp.transform_point(pose[batch_index, carrier], end)
        edge.normal_0 = wp.transform_vector(pose[batch_index, carrier], edge.normal_0)
        edge.normal_n = wp.transform_vector(pose[batch_index, carrier], edge.normal_n)
        edge.away = wp.transform_vector(pose[batch_index, carrier], edge.away)
    edge.begin = begin
    edge.length = wp.length(end - begin)
    edge.along = (end - begin) / edge.length
    return edge


@wp.func
def edge_point(edge: Edge, tx: wp.vec3d, rx: wp.vec3d) -> wp.vec4d:
    """Return the point of the edge on the shortest path from `tx` to `rx` over it, and 1; 0 if that is off the edge.

    Turning both ends about the edge into one plane makes the path a straight line (Fermat; the law of diffraction).
    Source: J. B. Keller, Geometrical theory of diffraction, J. Opt. Soc. Am. 52 (1962), section 2.
    """
    tx_along = wp.dot(edge.along, tx - edge.begin)
    rx_along = wp.dot(edge.along, rx - edge.begin)
    tx_away = wp.length(tx - edge.begin - tx_along * edge.along)
    rx_away = wp.length(rx - edge.begin - rx_along * edge.along)
    at = (tx_along * rx_away + rx_along * tx_away) / (tx_away + rx_away)
    is_on = at >= -EDGE_SLACK and at <= edge.length + EDGE_SLACK and wp.min(tx_away, rx_away) > wp.float64(1e-6)
    point = edge.begin + at * edge.along
    return wp.vec4d(point[0], point[1], point[2], wp.where(is_on, wp.float64(1.0), wp.float64(0.0)))


@wp.func
def is_outside(edge: Edge, point: wp.vec3d) -> bool:
    """Return whether a point lies in front of one of the two faces, that is, not inside the wedge."""
    to_point = point - edge.begin
    return wp.dot(edge.normal_0, to_point) > wp.float64(1e-9) or wp.dot(edge.normal_n, to_point) > wp.float64(1e-9)


@wp.func
def is_rim(edge: Edge, point: wp.vec3d) -> bool:
    """Return whether just one face of a wedge looks to a point, so that the edge is on the rim of what it sees."""
    to_point = point - edge.begin
    return (wp.dot(edge.normal_0, to_point) > wp.float64(0.0)) != (wp.dot(edge.normal_n, to_point) > wp.float64(0.0))


@wp.func
def can_diffract(wedges: Wedges, wedge: int, edge: Edge, tx: wp.vec3d, rx: wp.vec3d) -> bool:
    """Return whether a wedge has a wave from `tx` to `rx`: both outside of it, and on a curved surface at its rim."""
    is_able = is_outside(edge, tx) and is_outside(edge, rx)
    if is_able and wedges.is_curved[wedge] != wp.uint8(0):
        is_able = is_rim(edge, tx) or is_rim(edge, rx)
    return is_able


@wp.func
def most_edge_share(reach: wp.float64, shortest: wp.float64, point: wp.vec3d, tx: wp.vec3d, rx: wp.vec3d) -> wp.float64:
    """Return more than the share of its wave that an edge of a length `reach` [m] has at a wavelength or longer ones.

    Its Fresnel integral is below the length in Fresnel coordinates over sqrt(2).
    """
    before = wp.length(tx - point)
    behind = wp.length(rx - point)
    return reach * wp.sqrt((before + behind) / (shortest * before * behind))


@wp.kernel
def cull_wedges_kernel(
    batch_index: wp.array[int],
    tx: wp.array[wp.vec3d],
    rx: wp.array[wp.vec3d],
    wedges: Wedges,
    pose: wp.array2d[wp.transformd],
    shortest_m: wp.float64,
    weakest: wp.float64,
    # out
    count_out: wp.array[int],
    pair_out: wp.array2d[int],
):
    """Select the (link, wedge) pairs whose point of diffraction is on the edge, with both ends outside the wedge.

    `batch_index`, `tx` and `rx` have a row a link. With finite edges, of a shortest wavelength above 0, those that have
    less than a share `weakest` of their wave are left out. Launch: dim=(L, E).
    """
    link, wedge = wp.tid()
    edge = edge_world(wedges, pose, batch_index[link], wedge)
    is_diffracted = can_diffract(wedges, wedge, edge, tx[link], rx[link])
    if is_diffracted:
        found = edge_point(edge, tx[link], rx[link])
        is_diffracted = found[3] > wp.float64(0.0)
        if is_diffracted and shortest_m > wp.float64(0.0):
            point = wp.vec3d(found[0], found[1], found[2])
            is_diffracted = most_edge_share(wedges.reach[wedge], shortest_m, point, tx[link], rx[link]) >= weakest
    if is_diffracted:
        select_pair(link, wedge, count_out, pair_out)
