"""Path candidates of reflections and a diffraction behind them: (link, candidate, wedge) triples for the exact test."""

import warp as wp

from mmw.kernels.channel.edges import Wedges, edge_point, edge_world, is_outside
from mmw.kernels.channel.ray_launch import EMPTY_CELL
from mmw.kernels.channel.reflection_candidates import (
    Chains,
    chain_level,
    chain_parent,
    chain_plane,
    points_open,
    write_chain,
)
from mmw.kernels.channel.surfaces import LinkEnds, Surfaces

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
    """Return whether a wedge could diffract a candidate, without its last plane, toward the receiver of a link."""
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
def bend_kernel(
    ends: LinkEnds,
    surfaces: Surfaces,
    wedges: Wedges,
    pose: wp.array2d[wp.transformd],
    first_link: wp.array[int],
    chains: Chains,
    is_writing: wp.bool,
    end: wp.array[int],
    # out
    count_out: wp.array[int],
    link_out: wp.array[int],
    step_out: wp.array2d[int],
):
    """Count the (link, wedge) pairs that each candidate could serve, or write them; wedges are those of its last plane.

    `first_link` has one entry more than there are sources. Writing needs `end`, the inclusive sum of the counts, and
    leaves `count_out` as it is; counting leaves the other outputs as they are. Launch: dim=N.
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
        for place in range(wedges.first[plane], wedges.first[plane + 1]):
            wedge = wedges.of_plane[place]
            for link in range(first_link[source], first_link[source + 1]):
                if could_bend(ends, surfaces, wedges, pose, chains, cell, wedge, link):
                    if is_writing:
                        link_out[row + count] = link
                        column = chain_level(key) - 1
                        step_out[row + count, column] = -2 - wedge
                        write_chain(chains, chain_parent(key), row + count, column - 1, -1, step_out)
                    count = count + 1
    if not is_writing:
        count_out[cell] = count
