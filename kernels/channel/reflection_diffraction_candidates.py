"""Reflections on both sides of a wedge: candidates of the transmitter and of the receiver, joined at its edge."""

import warp as wp

from mmw.kernels.channel.edges import Edge, Wedges, edge_point, edge_world
from mmw.kernels.channel.ray_launch import EMPTY_CELL
from mmw.kernels.channel.reflection_candidates import (
    Chains,
    chain_level,
    chain_parent,
    chain_plane,
    points_open,
    write_chain,
)
from mmw.kernels.channel.surfaces import (
    LinkEnds,
    Plane,
    Surfaces,
    is_mirror,
    largest,
    mean_plane,
    mirror_point,
    to_carrier,
)

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})


@wp.struct
class Tails:
    """Candidates of the receivers, sorted by (receiver, last plane), and the receiver of each link."""

    ends: LinkEnds
    """Ends of the links read backward, in the order of the receivers."""
    chains: Chains
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
def could_light(
    ends: LinkEnds,
    surfaces: Surfaces,
    pose: wp.array2d[wp.transformd],
    chains: Chains,
    code: int,
    link: int,
    edge: Edge,
) -> bool:
    """Return whether the last plane of a candidate could mirror the transmitter of a link to some point of an edge.

    Generous: the points for both ends of the edge span a box, which has to overlap that of the plane.
    """
    slot = ends.slot[link]
    own = wp.int32(0)
    plane = Plane()
    image = ends.tx[link, ends.tx.shape[1] - 1]
    if code >= chains.first:
        at = code - chains.first
        own = chain_plane(chains.key[at])
        plane.normal = chains.normal[at]
        plane.offset = chains.offset[at]
        image = chains.image[at]
    else:
        own = code % chains.plane_count
        plane = mean_plane(surfaces, pose, slot, surfaces.lead[own])
    far = edge.begin + edge.length * edge.along
    is_begin = is_mirror(plane.normal, plane.offset, image, edge.begin)
    is_far = is_mirror(plane.normal, plane.offset, image, far)
    could = is_begin or is_far
    if is_begin and is_far:
        carrier = surfaces.carrier[surfaces.lead[own]]
        one = to_carrier(mirror_point(plane, image, edge.begin), pose, slot, carrier)
        other = to_carrier(mirror_point(plane, image, far), pose, slot, carrier)
        slack = wp.float64(1e-6) * (wp.float64(1.0) + wp.max(largest(one), largest(other)))
        low = wp.min(one, other) - surfaces.plane_upper[own]
        high = surfaces.plane_lower[own] - wp.max(one, other)
        could = wp.max(low) <= slack and wp.max(high) <= slack
    return could


@wp.func
def could_join(
    ends: LinkEnds,
    surfaces: Surfaces,
    pose: wp.array2d[wp.transformd],
    chains: Chains,
    tails: Tails,
    cell: int,
    edge: Edge,
    tail: int,
    link: int,
) -> bool:
    """Return whether an edge could join one candidate, without its last plane, to the other by diffraction."""
    found = edge_point(edge, chains.image[cell], tails.chains.image[tail])
    is_open = found[3] > wp.float64(0.0)
    if is_open:
        point = wp.vec3d(found[0], found[1], found[2])
        is_open = points_open(ends, surfaces, pose, chains, chain_parent(chains.key[cell]), link, point)
        if is_open:
            last = chain_parent(tails.chains.key[tail])
            is_open = points_open(tails.ends, surfaces, pose, tails.chains, last, tails.link[link], point)
    return is_open


@wp.kernel
def join_kernel(
    ends: LinkEnds,
    surfaces: Surfaces,
    wedges: Wedges,
    pose: wp.array2d[wp.transformd],
    first_link: wp.array[int],
    chains: Chains,
    tails: Tails,
    depth: int,
    is_writing: wp.bool,
    end: wp.array[int],
    # out
    count_out: wp.array[int],
    link_out: wp.array[int],
    step_out: wp.array2d[int],
):
    """Count the (link, wedge, tail) triples that each candidate could serve, or write them.

    The wedges are those of a candidate's last plane; a tail ends at a plane of the same wedge. `first_link` has one
    entry more than there are sources. Writing needs `end`, the inclusive sum of the counts, and leaves `count_out` as
    it is; counting leaves the other outputs as they are. Launch: dim=N.
    """
    cell = wp.tid()
    key = chains.key[cell]
    count = wp.int32(0)
    if key != EMPTY_CELL:
        row = wp.int32(0)
        if is_writing:
            row = end[cell] - count_out[cell]
        source = chains.source[cell]
        plane = chain_plane(key)
        lit_by = chain_parent(key)
        for place in range(wedges.first[plane], wedges.first[plane + 1]):
            wedge = wedges.of_plane[place]
            first = first_link[source]
            edge = edge_world(wedges, pose, ends.slot[first], wedge)
            stop = first_link[source + 1]
            if not could_light(ends, surfaces, pose, chains, lit_by, first, edge):
                stop = first
            for link in range(first, stop):
                receiver = tails.source[link]
                for face in range(2):
                    surface = wp.where(face == 0, wedges.surface_0[wedge], wedges.surface_n[wedge])
                    wanted = wp.int64(receiver) * wp.int64(chains.plane_count) + wp.int64(surfaces.plane[surface])
                    item = wp.lower_bound(tails.key, wanted)
                    while receiver >= 0 and item < tails.key.shape[0] and tails.key[item] == wanted:
                        tail = tails.cell[item]
                        tail_level = chain_level(tails.chains.key[tail])
                        fits = chain_level(key) + tail_level - 1 <= depth
                        if fits and could_join(ends, surfaces, pose, chains, tails, cell, edge, tail, link):
                            if is_writing:
                                link_out[row + count] = link
                                column = chain_level(key) - 1
                                step_out[row + count, column] = -2 - wedge
                                write_chain(chains, lit_by, row + count, column - 1, -1, step_out)
                                last = chain_parent(tails.chains.key[tail])
                                write_chain(tails.chains, last, row + count, column + 1, 1, step_out)
                            count = count + 1
                        item = item + 1
    if not is_writing:
        count_out[cell] = count
