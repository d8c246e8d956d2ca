"""Test path candidates of reflections for many links of one transmitter: whole blocks of neighboring receivers first.

A candidate serves few of the links of a radio map. Links whose receivers are near each other stand next to each other,
in blocks of two sizes that have a box each; a block that no reflection inside the box of a candidate's last plane could
reach is skipped. The links that are left get the same exact test as in `mmw.kernels.channel.reflection_candidates`.
"""

import warp as wp

from mmw.kernels.channel.ray_launch import EMPTY_CELL
from mmw.kernels.channel.reflection_candidates import (
    CandidateTree,
    candidate_depth,
    candidate_plane,
    points_in_boxes,
    reflects_in_box,
    write_planes,
)
from mmw.kernels.channel.surfaces import LinkEnds, Plane, Surfaces, mean_plane
from mmw.kernels.core.compiler import DOUBLE_PRECISION

wp.set_module_options(DOUBLE_PRECISION)

SMALL_BLOCK = wp.constant(16)
"""Links of a small block."""
LARGE_BLOCK = wp.constant(256)
"""Links of a large block, a multiple of `SMALL_BLOCK`."""
LINKS_OF_THREAD = wp.constant(4096)
"""Links that one thread tests, a multiple of `LARGE_BLOCK`."""
BLOCK_SLACK = wp.constant(wp.float64(4e-5))
"""Slack of the test of a block [m, and relative]: more than `WIDE_MARGIN` and `BOX_MARGIN` of the exact tests."""


@wp.struct
class LinkBlocks:
    """Boxes about the receivers of blocks of links that stand next to each other, world frame [m]."""

    small_lower: wp.array[wp.vec3d]
    """Low corner of each small block, shape [ceil(L / SMALL_BLOCK)]."""
    small_upper: wp.array[wp.vec3d]
    """High corner."""
    large_lower: wp.array[wp.vec3d]
    """Low corner of each large block, shape [ceil(L / LARGE_BLOCK)]."""
    large_upper: wp.array[wp.vec3d]
    """High corner."""


@wp.struct
class Mirror:
    """Last mirror of a candidate in the world frame."""

    image: wp.vec3d
    """Image of the transmitter behind the mirror [m]."""
    height: wp.float64
    """Distance of that image from the mirror [m]."""
    normal: wp.vec3d
    """Unit normal, toward the receivers."""
    offset: wp.float64
    """normal . p on the mirror [m]."""
    lower: wp.vec3d
    """Low corner of the mirror's box [m]."""
    upper: wp.vec3d
    """High corner [m]."""


@wp.func
def make_mirror(
    plane: Plane, source: wp.vec3d, lower: wp.vec3d, upper: wp.vec3d, pose: wp.array2d[wp.transformd], batch_index: int,
    carrier: int,
) -> Mirror:  # fmt: skip
    """Return the mirror of a world plane, seen from a source before it; its box is in the frame of its carrier."""
    mirror = Mirror()
    height = wp.dot(plane.normal, source) - plane.offset
    side = wp.where(height < wp.float64(0.0), wp.float64(-1.0), wp.float64(1.0))
    mirror.image = source - wp.float64(2.0) * height * plane.normal
    mirror.height = side * height
    mirror.normal = side * plane.normal
    mirror.offset = side * plane.offset
    mirror.lower = lower
    mirror.upper = upper
    if carrier < pose.shape[1]:
        own = pose[batch_index, carrier]
        middle = wp.transform_point(own, wp.float64(0.5) * (lower + upper))
        half = wp.float64(0.5) * (upper - lower)
        x = wp.transform_vector(own, wp.vec3d(half[0], wp.float64(0.0), wp.float64(0.0)))
        y = wp.transform_vector(own, wp.vec3d(wp.float64(0.0), half[1], wp.float64(0.0)))
        z = wp.transform_vector(own, wp.vec3d(wp.float64(0.0), wp.float64(0.0), half[2]))
        reach = wp.abs(x) + wp.abs(y) + wp.abs(z)
        mirror.lower = middle - reach
        mirror.upper = middle + reach
    return mirror


@wp.func
def could_reach(mirror: Mirror, lower: wp.vec3d, upper: wp.vec3d) -> bool:
    """Return whether some point of a box could be reached by a reflection inside the box of a mirror.

    Interval arithmetic: the point of reflection is image + s (p - image) with s = h / (h + height of p).
    """
    zero = wp.float64(0.0)
    half = wp.float64(0.5) * (upper - lower)
    height = wp.dot(mirror.normal, lower + half) - mirror.offset
    reach = wp.dot(wp.abs(mirror.normal), half)
    is_possible = not height + reach < zero  # NaN, the pose of an absent instance, is left to the exact test
    if is_possible:
        least = mirror.height / (mirror.height + height + reach)
        most = mirror.height / (mirror.height + wp.max(height - reach, zero))
        for axis in range(3):
            before = lower[axis] - mirror.image[axis]
            behind = upper[axis] - mirror.image[axis]
            low = mirror.image[axis] + wp.min(least * before, most * before)
            high = mirror.image[axis] + wp.max(least * behind, most * behind)
            slack = BLOCK_SLACK * (wp.float64(1.0) + wp.max(wp.abs(low), wp.abs(high)))
            if low > mirror.upper[axis] + slack or high < mirror.lower[axis] - slack:
                is_possible = wp.bool(False)
    return is_possible


@wp.func
def next_link(blocks: LinkBlocks, mirror: Mirror, link: int, stop: int) -> int:
    """Return the first link from `link` on that is in no block that is skipped, at most `stop`."""
    at = link
    is_found = wp.bool(False)
    while at < stop and not is_found:
        is_found = wp.bool(True)
        if at % SMALL_BLOCK == 0:
            large = at // LARGE_BLOCK
            small = at // SMALL_BLOCK
            if at % LARGE_BLOCK == 0 and not could_reach(mirror, blocks.large_lower[large], blocks.large_upper[large]):
                at = at + LARGE_BLOCK
                is_found = wp.bool(False)
            elif not could_reach(mirror, blocks.small_lower[small], blocks.small_upper[small]):
                at = at + SMALL_BLOCK
                is_found = wp.bool(False)
    return wp.min(at, stop)


@wp.kernel
def block_reflections_kernel(
    ends: LinkEnds,
    surfaces: Surfaces,
    pose: wp.array2d[wp.transformd],
    first_link: wp.array[int],
    blocks: LinkBlocks,
    surface_ids: wp.array[int],
    is_hit: wp.array2d[wp.uint8],
    is_writing: wp.bool,
    end: wp.array3d[int],
    # out
    count_out: wp.array3d[int],
    link_out: wp.array[int],
    step_out: wp.array2d[int],
):
    """Count the links that each surface could serve by one reflection, or write them.

    `is_hit` has a row for each source, a column a plane; without rows every plane counts as hit. `first_link` has one
    entry more than there are sources. Writing needs `end`, the inclusive sum of the counts, and does not change
    `count_out`; counting changes nothing else. Launch: dim=(A, S, parts of LINKS_OF_THREAD links); S surface ids.
    """
    source, index, part = wp.tid()
    surface = surface_ids[index]
    begin = first_link[source] + part * LINKS_OF_THREAD
    stop = wp.min(first_link[source + 1], begin + LINKS_OF_THREAD)
    count = wp.int32(0)
    is_seen = begin < stop
    if is_seen and is_hit.shape[0] > 0:
        is_seen = is_hit[source, surfaces.plane[surface]] != wp.uint8(0)
    if is_seen:
        row = surfaces.row[surface]
        carrier = surfaces.carrier[surface]
        world = ends.tx.shape[1] - 1
        low = surfaces.lower[row]
        high = surfaces.upper[row]
        batch_index = ends.batch_index[begin]
        plane = mean_plane(surfaces, pose, batch_index, surface)
        mirror = make_mirror(plane, ends.tx[begin, world], low, high, pose, batch_index, carrier)
        before = wp.int32(0)
        if is_writing:
            before = end[source, index, part] - count_out[source, index, part]
        link = next_link(blocks, mirror, begin, stop)
        while link < stop:
            tx = ends.tx[link, carrier]
            rx = ends.rx[link, carrier]
            if reflects_in_box(surfaces.normal[row], surfaces.offset[row], low, high, tx, rx):
                if is_writing:
                    link_out[before + count] = link
                    step_out[before + count, 0] = surface
                count = count + 1
            link = next_link(blocks, mirror, link + 1, stop)
    if not is_writing:
        count_out[source, index, part] = count


@wp.kernel
def block_candidates_kernel(
    ends: LinkEnds,
    surfaces: Surfaces,
    pose: wp.array2d[wp.transformd],
    first_link: wp.array[int],
    blocks: LinkBlocks,
    tree: CandidateTree,
    cells: wp.array[int],
    is_writing: wp.bool,
    end: wp.array2d[int],
    # out
    count_out: wp.array2d[int],
    link_out: wp.array[int],
    step_out: wp.array2d[int],
):
    """Count the links of its source that each candidate of two planes and more could serve, or write them.

    Writing needs `end`, the inclusive sum of the counts, and does not change `count_out`; counting changes nothing
    else. Launch: dim=(M, parts of LINKS_OF_THREAD links); `cells` are the M cells of `tree` that hold a candidate.
    """
    index, part = wp.tid()
    cell = cells[index]
    source = tree.source[cell]
    begin = first_link[source] + part * LINKS_OF_THREAD
    stop = wp.min(first_link[source + 1], begin + LINKS_OF_THREAD)
    count = wp.int32(0)
    if begin < stop and tree.key[cell] != EMPTY_CELL:
        own = candidate_plane(tree.key[cell])
        last = candidate_depth(tree.key[cell]) - 1
        batch_index = ends.batch_index[begin]
        plane = Plane()
        plane.normal = tree.normal[cell]
        plane.offset = tree.offset[cell]
        carrier = surfaces.carrier[surfaces.lead[own]]
        low = surfaces.plane_lower[own]
        high = surfaces.plane_upper[own]
        mirror = make_mirror(plane, tree.image[cell], low, high, pose, batch_index, carrier)
        before = wp.int32(0)
        if is_writing:
            before = end[index, part] - count_out[index, part]
        link = next_link(blocks, mirror, begin, stop)
        while link < stop:
            rx = ends.rx[link, ends.rx.shape[1] - 1]
            if points_in_boxes(ends, surfaces, pose, tree, tree.first + cell, link, rx):
                if is_writing:
                    link_out[before + count] = link
                    write_planes(tree, tree.first + cell, before + count, last, -1, step_out)
                count = count + 1
            link = next_link(blocks, mirror, link + 1, stop)
    if not is_writing:
        count_out[index, part] = count
