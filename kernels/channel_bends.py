"""Chains of reflections with a wedge behind them: which (link, chain, wedge) triples are worth an exact look?"""

import warp as wp

from mmw.kernels.channel_chains import Chains, chain_level, chain_parent, chain_plane, points_open
from mmw.kernels.channel_launch import EMPTY_CELL
from mmw.kernels.channel_surfaces import LinkEnds, Surfaces
from mmw.kernels.channel_wedges import Wedges, edge_point, edge_world, is_outside

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})


@wp.func
def could_bend(
    ends: LinkEnds,
    surfaces: Surfaces,
    wedges: Wedges,
    pose: wp.array2d[wp.transformd],
    chains: Chains,
    cell: int,
    wedge: int,
    link: int,
) -> bool:
    """Return whether a wedge bends what a chain without its last plane reflects towards the receiver of a link."""
    world = ends.tx.shape[1] - 1
    rx = ends.rx[link, world]
    edge = edge_world(wedges, pose, ends.slot[link], wedge)
    is_open = is_outside(edge, rx)
    if is_open:
        found = edge_point(edge, chains.image[cell], rx)
        is_open = found[3] > wp.float64(0.0)
        if is_open:
            point = wp.vec3d(found[0], found[1], found[2])
            is_open = points_open(ends, surfaces, pose, chains, chain_parent(chains.key[cell]), link, point)
    return is_open


@wp.kernel
def count_bent_kernel(
    ends: LinkEnds,
    surfaces: Surfaces,
    wedges: Wedges,
    pose: wp.array2d[wp.transformd],
    first_link: wp.array[int],
    chains: Chains,
    # out
    count_out: wp.array[int],
):
    """Count the (link, wedge) pairs that each chain could serve; the wedges are those of its last plane.

    `first_link` has one entry more than there are sources. Launch: dim=N.
    """
    cell = wp.tid()
    count = wp.int32(0)
    if chains.key[cell] != EMPTY_CELL:
        source = chains.source[cell]
        plane = chain_plane(chains.key[cell])
        for place in range(wedges.first[plane], wedges.first[plane + 1]):
            for link in range(first_link[source], first_link[source + 1]):
                if could_bend(ends, surfaces, wedges, pose, chains, cell, wedges.of_plane[place], link):
                    count = count + 1
    count_out[cell] = count


@wp.kernel
def fill_bent_kernel(
    ends: LinkEnds,
    surfaces: Surfaces,
    wedges: Wedges,
    pose: wp.array2d[wp.transformd],
    first_link: wp.array[int],
    chains: Chains,
    count: wp.array[int],
    end: wp.array[int],
    # out
    link_out: wp.array[int],
    step_out: wp.array2d[int],
):
    """Write the pairs that `count_bent_kernel` counted; `end` is the inclusive sum of its counts.

    Launch: dim=N.
    """
    cell = wp.tid()
    if count[cell] == 0:
        return
    row = end[cell] - count[cell]
    source = chains.source[cell]
    plane = chain_plane(chains.key[cell])
    for place in range(wedges.first[plane], wedges.first[plane + 1]):
        for link in range(first_link[source], first_link[source + 1]):
            wedge = wedges.of_plane[place]
            if could_bend(ends, surfaces, wedges, pose, chains, cell, wedge, link):
                link_out[row] = link
                code = chains.first + cell
                position = chain_level(chains.key[cell]) - 1
                step_out[row, position] = -2 - wedge
                code = chain_parent(chains.key[cell])
                position = position - 1
                while code >= chains.first:
                    key = chains.key[code - chains.first]
                    step_out[row, position] = chain_plane(key)
                    code = chain_parent(key)
                    position = position - 1
                step_out[row, 0] = code % chains.plane_count
                row = row + 1
