"""Path candidates of reflections: images of the transmitter, and (link, candidate) pairs for the exact test."""

import warp as wp

from mmw.kernels.channel.ray_launch import EMPTY_CELL, PLANE_BITS
from mmw.kernels.channel.surfaces import (
    LinkEnds,
    Plane,
    Surfaces,
    in_box,
    in_plane_box,
    is_mirror,
    mean_plane,
    mirror_point,
    mirrored,
)
from mmw.kernels.core.geometry import reflection_point

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})

LINKS_AT_ONCE = wp.constant(8)
"""Links that one thread tests against its surface: the plane is read once for them."""
LINK_BITS = wp.constant(31)
"""Links of a source that one pass over the candidates tests: the bits of its result."""


@wp.struct
class Chains:
    """Tree of the path candidates of a launch; codes below `first` are (source, plane) pairs, the others cells."""

    key: wp.array[wp.uint64]
    """(level, plane, parent) of each cell, 0 where it is free, shape [N]."""
    first: int
    """Code of cell 0: the number of (source, plane) pairs."""
    plane_count: int
    """K."""
    source: wp.array[int]
    """Source of each candidate, shape [N]."""
    image: wp.array[wp.vec3d]
    """Image of the transmitter before the candidate's last plane, world frame [m], shape [N]."""
    normal: wp.array[wp.vec3d]
    """Mean plane of the last plane in the world: unit normal, shape [N]."""
    offset: wp.array[wp.float64]
    """Mean plane of the last plane in the world: normal . p [m], shape [N]."""


@wp.func
def chain_plane(key: wp.uint64) -> int:
    """Return the last plane of a candidate."""
    return wp.int32((key >> wp.uint64(32)) & ((wp.uint64(1) << PLANE_BITS) - wp.uint64(1)))


@wp.func
def chain_parent(key: wp.uint64) -> int:
    """Return the code of the candidate before."""
    return wp.int32(key & wp.uint64(0x7FFFFFFF))


@wp.func
def chain_level(key: wp.uint64) -> int:
    """Return the number of planes of a candidate."""
    return wp.int32(key >> (wp.uint64(32) + PLANE_BITS))


@wp.kernel
def cull_kernel(
    ends: LinkEnds,
    surfaces: Surfaces,
    first_link: int,
    link_count: int,
    first_source: int,
    is_seen: wp.array2d[wp.uint8],
    # out
    links_out: wp.array2d[int],
    count_out: wp.array2d[int],
):
    """Find which links could use which surface: their point of reflection falls into the surface's box.

    A thread takes one surface and `LINKS_AT_ONCE` links; bit b of `links_out` is link block * LINKS_AT_ONCE + b after
    `first_link`. `is_seen` has a row for each source from `first_source`, a column a plane. Launch:
    dim=(ceil(link_count / LINKS_AT_ONCE), G).
    """
    block, surface = wp.tid()
    row = surfaces.row[surface]
    normal = surfaces.normal[row]
    offset = surfaces.offset[row]
    carrier = surfaces.carrier[surface]
    plane = surfaces.plane[surface]
    bits = wp.int32(0)
    count = wp.int32(0)
    for bit in range(LINKS_AT_ONCE):
        number = block * LINKS_AT_ONCE + bit
        if number < link_count:
            link = first_link + number
            if is_seen[ends.source[link] - first_source, plane] != wp.uint8(0):
                tx = ends.tx[link, carrier]
                rx = ends.rx[link, carrier]
                if is_mirror(normal, offset, tx, rx):
                    point = reflection_point(tx, rx, normal, offset)
                    if in_box(surfaces.lower[row], surfaces.upper[row], point):
                        bits = bits | (1 << bit)
                        count = count + 1
    links_out[block, surface] = bits
    count_out[block, surface] = count


@wp.kernel
def fill_kernel(
    first_link: int,
    links: wp.array2d[int],
    end: wp.array2d[int],
    # out
    link_out: wp.array[int],
    step_out: wp.array2d[int],
):
    """Write the (link, surface) pairs that `cull_kernel` kept; `end` is the inclusive sum of its counts.

    Launch: dim as `cull_kernel`.
    """
    block, surface = wp.tid()
    bits = links[block, surface]
    place = end[block, surface]
    bit = LINKS_AT_ONCE - 1
    while bits != 0 and bit >= 0:
        if (bits >> bit) & 1 == 1:
            place = place - 1
            link_out[place] = first_link + block * LINKS_AT_ONCE + bit
            step_out[place, 0] = surface
        bit = bit - 1


@wp.kernel
def image_kernel(
    surfaces: Surfaces,
    pose: wp.array2d[wp.transformd],
    slot: wp.array[int],
    tx: wp.array[wp.vec3d],
    level: int,
    chains: Chains,
    # out
    source_out: wp.array[int],
    image_out: wp.array[wp.vec3d],
    normal_out: wp.array[wp.vec3d],
    offset_out: wp.array[wp.float64],
):
    """Compute plane and image of the candidates of one level; those of the level before must be there.

    `slot` and `tx` [m, world frame] have a row a source. The outputs are the arrays of `chains`. Launch: dim=N.
    """
    cell = wp.tid()
    key = chains.key[cell]
    if key == EMPTY_CELL or chain_level(key) != level:
        return
    parent = chain_parent(key)
    source = wp.int32(0)
    image = wp.vec3d()
    before = Plane()
    if parent < chains.first:
        source = parent // chains.plane_count
        image = tx[source]
        before = mean_plane(surfaces, pose, slot[source], surfaces.lead[parent % chains.plane_count])
    else:
        source = chains.source[parent - chains.first]
        image = chains.image[parent - chains.first]
        before.normal = chains.normal[parent - chains.first]
        before.offset = chains.offset[parent - chains.first]
    own = mean_plane(surfaces, pose, slot[source], surfaces.lead[chain_plane(key)])
    source_out[cell] = source
    image_out[cell] = mirrored(image, before)
    normal_out[cell] = own.normal
    offset_out[cell] = own.offset


@wp.func
def points_open(
    ends: LinkEnds,
    surfaces: Surfaces,
    pose: wp.array2d[wp.transformd],
    chains: Chains,
    last: int,
    link: int,
    end: wp.vec3d,
) -> bool:
    """Return whether the candidate with code `last`, read from its last plane to the first, reflects inside their boxes
    what goes from the transmitter of a link to the point `end`."""
    slot = ends.slot[link]
    target = end
    code = last
    is_open = wp.bool(True)
    while is_open and code >= chains.first:
        at = code - chains.first
        key = chains.key[at]
        normal = chains.normal[at]
        image = chains.image[at]
        is_open = is_mirror(normal, chains.offset[at], image, target)
        if is_open:
            target = reflection_point(image, target, normal, chains.offset[at])
            is_open = in_plane_box(surfaces, pose, slot, chain_plane(key), target)
        code = chain_parent(key)
    if is_open:
        first = code % chains.plane_count
        plane = mean_plane(surfaces, pose, slot, surfaces.lead[first])
        tx = ends.tx[link, ends.tx.shape[1] - 1]
        is_open = is_mirror(plane.normal, plane.offset, tx, target)
        if is_open:
            is_open = in_plane_box(surfaces, pose, slot, first, mirror_point(plane, tx, target))
    return is_open


@wp.func
def write_chain(
    chains: Chains,
    code: int,
    row: int,
    place: int,
    step: int,
    step_out: wp.array2d[int],
):
    """Write the planes of a candidate from its last one on, from column `place` in the direction `step`."""
    at = code
    column = place
    while at >= chains.first:
        key = chains.key[at - chains.first]
        step_out[row, column] = chain_plane(key)
        at = chain_parent(key)
        column = column + step
    step_out[row, column] = at % chains.plane_count


@wp.kernel
def cull_chain_kernel(
    ends: LinkEnds,
    surfaces: Surfaces,
    pose: wp.array2d[wp.transformd],
    first_link: wp.array[int],
    block: int,
    chains: Chains,
    # out
    links_out: wp.array[int],
    count_out: wp.array[int],
):
    """Find which links of its source a candidate could serve; bit b of `links_out` is its link `block` * LINK_BITS + b.

    `first_link` has one entry more than there are sources. Launch: dim=N.
    """
    cell = wp.tid()
    bits = wp.int32(0)
    count = wp.int32(0)
    if chains.key[cell] != EMPTY_CELL:
        source = chains.source[cell]
        begin = first_link[source] + block * LINK_BITS
        stop = wp.min(first_link[source + 1], begin + LINK_BITS)
        link = begin
        while link < stop:
            rx = ends.rx[link, ends.rx.shape[1] - 1]
            if points_open(ends, surfaces, pose, chains, chains.first + cell, link, rx):
                bits = bits | (1 << (link - begin))
                count = count + 1
            link = link + 1
    links_out[cell] = bits
    count_out[cell] = count


@wp.kernel
def fill_chain_kernel(
    first_link: wp.array[int],
    block: int,
    chains: Chains,
    links: wp.array[int],
    end: wp.array[int],
    # out
    link_out: wp.array[int],
    plane_out: wp.array2d[int],
):
    """Write the (link, candidate) pairs that `cull_chain_kernel` kept; `end` is the inclusive sum of its counts.

    A candidate is written from transmitter to receiver, -1 behind its end. Launch: dim=N.
    """
    cell = wp.tid()
    bits = links[cell]
    if bits == 0:
        return
    begin = first_link[chains.source[cell]] + block * LINK_BITS
    place = end[cell]
    bit = LINK_BITS - 1
    while bit >= 0:
        if (bits >> bit) & 1 == 1:
            place = place - 1
            link_out[place] = begin + bit
            last = chain_level(chains.key[cell]) - 1
            write_chain(chains, chains.first + cell, place, last, -1, plane_out)
        bit = bit - 1
