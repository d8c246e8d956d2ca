"""Test path candidates with a diffraction behind or between their reflections: links and wedges for the exact test."""

import warp as wp

from mmw.kernels.channel.edges import (
    Edge,
    Wedges,
    can_diffract,
    edge_point,
    edge_world,
    is_outside,
    most_edge_share,
)
from mmw.kernels.channel.finite_surfaces import fresnel_scale
from mmw.kernels.channel.ray_launch import EMPTY_CELL
from mmw.kernels.channel.reflection_candidates import (
    CandidateTree,
    candidate_depth,
    candidate_parent,
    candidate_plane,
    points_in_boxes,
    write_planes,
)
from mmw.kernels.channel.selected_pairs import select_pair
from mmw.kernels.channel.surfaces import (
    LinkEnds,
    Plane,
    Surfaces,
    from_carrier,
    in_plane_box,
    is_mirror,
    largest,
    mean_plane,
    mirror_point,
    mirrored,
    to_carrier,
)
from mmw.kernels.core.compiler import DOUBLE_PRECISION
from mmw.kernels.core.geometry import reflection_point

wp.set_module_options(DOUBLE_PRECISION)


@wp.struct
class ReverseCandidates:
    """Candidates of the receivers, sorted by (receiver, last plane), and the receiver of each link."""

    ends: LinkEnds
    """Ends of the links read backward, in the order of the receivers."""
    tree: CandidateTree
    """Candidates of the receivers."""
    key: wp.array[wp.int64]
    """receiver * K + last plane of each candidate, growing, shape [M]."""
    cell: wp.array[int]
    """Cell of each candidate, shape [M]."""
    link: wp.array[int]
    """Place of each link among the links read backward, shape [L]."""
    source: wp.array[int]
    """Receiver of each link among those that were launched, -1 if it is not one of them, shape [L]."""


@wp.func
def can_illuminate(
    ends: LinkEnds,
    surfaces: Surfaces,
    pose: wp.array2d[wp.transformd],
    tree: CandidateTree,
    code: int,
    link: int,
    edge: Edge,
) -> bool:
    """Return whether the last plane of a candidate could mirror the transmitter of a link to some point of an edge.

    Generous: the points for both ends of the edge span a box, which has to overlap that of the plane.
    """
    batch_index = ends.batch_index[link]
    own = wp.int32(0)
    plane = Plane()
    image = ends.tx[link, ends.tx.shape[1] - 1]
    if code >= tree.first:
        at = code - tree.first
        own = candidate_plane(tree.key[at])
        plane.normal = tree.normal[at]
        plane.offset = tree.offset[at]
        image = tree.image[at]
    else:
        own = code % tree.plane_count
        plane = mean_plane(surfaces, pose, batch_index, surfaces.lead[own])
    far = edge.begin + edge.length * edge.along
    is_begin = is_mirror(plane.normal, plane.offset, image, edge.begin)
    is_far = is_mirror(plane.normal, plane.offset, image, far)
    is_possible = is_begin or is_far
    if is_begin and is_far:
        carrier = surfaces.carrier[surfaces.lead[own]]
        one = to_carrier(mirror_point(plane, image, edge.begin), pose, batch_index, carrier)
        other = to_carrier(mirror_point(plane, image, far), pose, batch_index, carrier)
        slack = wp.float64(1e-6) * (wp.float64(1.0) + wp.max(largest(one), largest(other)))
        low = wp.min(one, other) - surfaces.plane_upper[own]
        high = surfaces.plane_lower[own] - wp.max(one, other)
        is_possible = wp.max(low) <= slack and wp.max(high) <= slack
    return is_possible


@wp.func
def reaches(
    ends: LinkEnds, surfaces: Surfaces, pose: wp.array2d[wp.transformd], tree: CandidateTree, parent: int, link: int,
    found: wp.vec4d,
) -> bool:  # fmt: skip
    """Return whether a candidate reaches a point of an edge from the transmitter of a link; see `edge_point`."""
    is_valid = found[3] > wp.float64(0.0)
    if is_valid:
        point = wp.vec3d(found[0], found[1], found[2])
        is_valid = points_in_boxes(ends, surfaces, pose, tree, parent, link, point)
    return is_valid


@wp.func
def is_far_aside(begin: wp.vec3d, end: wp.vec3d, tx: wp.vec3d, rx: wp.vec3d, detour: wp.float64) -> bool:
    """Return whether no path over an edge from `begin` to `end` is as short as the line from tx to rx plus a detour.

    Such paths lie in an ellipsoid about the line, whose small half axis is sqrt(d (d + 2 L)) / 2.
    """
    along = rx - tx
    size = wp.dot(along, along)
    middle = wp.float64(0.5) * (begin + end)
    off = middle - tx - (wp.dot(middle - tx, along) / size) * along
    half = wp.float64(0.5) * (end - begin)
    aside = wp.dot(off, off)
    reach = wp.dot(half, half)
    wide = wp.float64(0.25) * detour * (detour + wp.float64(2.0) * wp.sqrt(size))
    return aside > wp.float64(2.0) * (reach + wide)  # (a + b)^2 is at most 2 (a^2 + b^2)


@wp.kernel
def near_mirrors_kernel(
    ends: LinkEnds,
    surfaces: Surfaces,
    pose: wp.array2d[wp.transformd],
    link: wp.array[int],
    plane: wp.array[int],
    longest_m: wp.float64,
    farthest: wp.float64,
    # out
    is_near_out: wp.array[wp.uint8],
):
    """Select the pairs of a link and a plane whose point of reflection is in the plane's box, or near it.

    Near is at most `farthest` away, in Fresnel coordinates at the longest wavelength. Launch: dim=N.
    """
    pair = wp.tid()
    own = link[pair]
    lead = surfaces.lead[plane[pair]]
    carrier = surfaces.carrier[lead]
    normal = surfaces.normal[surfaces.row[lead]]
    offset = surfaces.offset[surfaces.row[lead]]
    tx = ends.tx[own, carrier]
    rx = ends.rx[own, carrier]
    is_near_out[pair] = wp.uint8(0)
    if is_mirror(normal, offset, tx, rx):
        point = reflection_point(tx, rx, normal, offset)
        before = wp.length(point - tx)
        behind = wp.length(rx - point)
        cosine = wp.abs(wp.dot(normal, tx) - offset) / before
        aside = wp.max(
            wp.max(surfaces.plane_lower[plane[pair]] - point, point - surfaces.plane_upper[plane[pair]]), wp.vec3d()
        )
        if cosine * wp.length(aside) * fresnel_scale(longest_m, before, behind) <= farthest:
            is_near_out[pair] = wp.uint8(1)


@wp.kernel
def near_edges_kernel(
    ends: LinkEnds,
    surfaces: Surfaces,
    wedges: Wedges,
    pose: wp.array2d[wp.transformd],
    link: wp.array[int],
    plane: wp.array[int],
    wedge: wp.array[int],
    is_behind: wp.bool,
    shortest_m: wp.float64,
    weakest: wp.float64,
    detour_m: wp.float64,
    # out
    count_out: wp.array[int],
    pair_out: wp.array2d[int],
):
    """Find the wedges past which a reflected path goes closely, before its plane or (`is_behind`) behind it.

    A pair of `link` and `plane` is a reflection; a path around a wedge next to it is at most `detour_m` longer. Wedges
    that have less than a share `weakest` of their wave at the shortest wavelength are left out.
    What is selected is the pair and the place in `wedge`. Launch: dim=(N, W).
    """
    pair, index = wp.tid()
    own = link[pair]
    batch_index = ends.batch_index[own]
    tx = ends.tx[own, ends.tx.shape[1] - 1]
    rx = ends.rx[own, ends.rx.shape[1] - 1]
    mirror = mean_plane(surfaces, pose, batch_index, surfaces.lead[plane[pair]])
    if not is_mirror(mirror.normal, mirror.offset, tx, rx):
        return
    begin = tx
    end = mirrored(rx, mirror)
    other = rx
    if is_behind:
        begin = mirrored(tx, mirror)
        end = rx
        other = tx
    carrier = wedges.carrier[wedge[index]]
    one = from_carrier(wedges.begin[wedge[index]], pose, batch_index, carrier)
    two = from_carrier(wedges.end[wedge[index]], pose, batch_index, carrier)
    if is_far_aside(one, two, begin, end, detour_m):
        return
    edge = edge_world(wedges, pose, batch_index, wedge[index])
    found = edge_point(edge, begin, end)
    if not found[3] > wp.float64(0.0):
        return
    point = wp.vec3d(found[0], found[1], found[2])
    longer = wp.length(point - begin) + wp.length(end - point) - wp.length(end - begin)
    if not (longer <= detour_m and is_mirror(mirror.normal, mirror.offset, point, other)):
        return
    if not can_diffract(wedges, wedge[index], edge, begin, end):
        return
    if most_edge_share(wedges.reach[wedge[index]], shortest_m, point, begin, end) < weakest:
        return
    on_plane = mirror_point(mirror, point, other)
    if in_plane_box(surfaces, pose, batch_index, plane[pair], on_plane):
        select_pair(pair, index, count_out, pair_out)


@wp.func
def write_to_wedge(
    tree: CandidateTree, key: wp.uint64, wedge: int, link: int, row: int,
    # out
    link_out: wp.array[int],
    step_out: wp.array2d[int],
):  # fmt: skip
    """Write a link, and the steps of a candidate with a wedge in place of its last plane."""
    link_out[row] = link
    column = candidate_depth(key) - 1
    step_out[row, column] = -2 - wedge
    write_planes(tree, candidate_parent(key), row, column - 1, -1, step_out)


@wp.kernel
def diffraction_kernel(
    ends: LinkEnds,
    surfaces: Surfaces,
    wedges: Wedges,
    pose: wp.array2d[wp.transformd],
    first_link: wp.array[int],
    tree: CandidateTree,
    is_writing: wp.bool,
    end: wp.array[int],
    # out
    count_out: wp.array[int],
    link_out: wp.array[int],
    step_out: wp.array2d[int],
):
    """Count the (link, wedge) pairs that each candidate could serve, or write them; wedges are those of its last plane.

    `first_link` has one entry more than there are sources. Writing needs `end`, the inclusive sum of the counts, and
    does not change `count_out`; counting changes nothing else. Launch: dim=N.
    """
    cell = wp.tid()
    key = tree.key[cell]
    count = wp.int32(0)
    if key != EMPTY_CELL:
        row = wp.int32(0)
        if is_writing:
            row = end[cell] - count_out[cell]
        source = tree.source[cell]
        plane = candidate_plane(key)
        parent = candidate_parent(key)
        first = first_link[source]
        for index in range(wedges.first[plane], wedges.first[plane + 1]):
            wedge = wedges.of_plane[index]
            edge = edge_world(wedges, pose, ends.batch_index[first], wedge)
            for link in range(first, first_link[source + 1]):
                rx = ends.rx[link, ends.rx.shape[1] - 1]
                if is_outside(edge, rx):
                    found = edge_point(edge, tree.image[cell], rx)
                    if reaches(ends, surfaces, pose, tree, parent, link, found):
                        if is_writing:
                            write_to_wedge(tree, key, wedge, link, row + count, link_out, step_out)
                        count = count + 1
    if not is_writing:
        count_out[cell] = count


@wp.kernel
def double_sided_kernel(
    ends: LinkEnds,
    surfaces: Surfaces,
    wedges: Wedges,
    pose: wp.array2d[wp.transformd],
    first_link: wp.array[int],
    tree: CandidateTree,
    reverse: ReverseCandidates,
    depth: int,
    is_writing: wp.bool,
    end: wp.array[int],
    # out
    count_out: wp.array[int],
    link_out: wp.array[int],
    step_out: wp.array2d[int],
):
    """Count the (link, wedge, reverse candidate) triples that each candidate could serve, or write them.

    The wedges are those of a candidate's last plane; a reverse candidate ends at a plane of the same wedge.
    `first_link` has one entry more than there are sources. Writing needs `end`, the inclusive sum of the counts, and
    does not change `count_out`; counting changes nothing else. Launch: dim=N.
    """
    cell = wp.tid()
    key = tree.key[cell]
    count = wp.int32(0)
    if key != EMPTY_CELL:
        row = wp.int32(0)
        if is_writing:
            row = end[cell] - count_out[cell]
        source = tree.source[cell]
        plane = candidate_plane(key)
        parent = candidate_parent(key)
        first = first_link[source]
        for index in range(wedges.first[plane], wedges.first[plane + 1]):
            wedge = wedges.of_plane[index]
            edge = edge_world(wedges, pose, ends.batch_index[first], wedge)
            stop = first_link[source + 1]
            if not can_illuminate(ends, surfaces, pose, tree, parent, first, edge):
                stop = first
            for link in range(first, stop):
                receiver = reverse.source[link]
                for face in range(2):
                    surface = wp.where(face == 0, wedges.surface_0[wedge], wedges.surface_n[wedge])
                    wanted_key = wp.int64(receiver) * wp.int64(tree.plane_count) + wp.int64(surfaces.plane[surface])
                    item = wp.lower_bound(reverse.key, wanted_key)
                    while receiver >= 0 and item < reverse.key.shape[0] and reverse.key[item] == wanted_key:
                        other = reverse.cell[item]
                        other_depth = candidate_depth(reverse.tree.key[other])
                        found = wp.vec4d()
                        fits = wp.bool(candidate_depth(key) + other_depth - 1 <= depth)
                        if fits:
                            found = edge_point(edge, tree.image[cell], reverse.tree.image[other])
                            fits = reaches(ends, surfaces, pose, tree, parent, link, found)
                        if fits:
                            last = candidate_parent(reverse.tree.key[other])
                            back = reverse.link[link]
                            if reaches(reverse.ends, surfaces, pose, reverse.tree, last, back, found):
                                if is_writing:
                                    write_to_wedge(tree, key, wedge, link, row + count, link_out, step_out)
                                    column = candidate_depth(key)
                                    write_planes(reverse.tree, last, row + count, column, 1, step_out)
                                count = count + 1
                        item = item + 1
    if not is_writing:
        count_out[cell] = count
