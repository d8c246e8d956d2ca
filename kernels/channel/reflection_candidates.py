"""Test path candidates of reflections: images of the transmitter, and (link, candidate) pairs for the exact test."""

import warp as wp

from mmw.kernels.channel.candidate_list import CandidateList, append_candidate
from mmw.kernels.channel.ray_launch import EMPTY_CELL, PLANE_BITS
from mmw.kernels.channel.surfaces import (
    LinkEnds,
    Plane,
    Surfaces,
    in_plane_box,
    is_mirror,
    mean_plane,
    mirror_point,
    mirrored,
)
from mmw.kernels.core.compiler import DOUBLE_PRECISION
from mmw.kernels.core.geometry import reflection_point

wp.set_module_options(DOUBLE_PRECISION)

WIDE_MARGIN = wp.constant(wp.float64(1e-5))
"""Slack of the first test of a reflection [m and 1]: it only has to let every surface through that `refine_kernel`
finds to be exact, however its point is rounded."""


@wp.struct
class CandidateTree:
    """Tree of the path candidates of a launch; codes below `first` are (source, plane) pairs, the others cells."""

    key: wp.array[wp.uint64]
    """(level, plane, parent) of each cell, 0 where it is free, shape [N]."""
    first: int
    """Code of cell 0: the number of (source, plane) pairs."""
    plane_count: int
    """K."""
    first_link: wp.array[int]
    """First link of each source, and the number of links, shape [A + 1]."""
    source: wp.array[int]
    """Source of each candidate, shape [N]."""
    image: wp.array[wp.vec3d]
    """Image of the transmitter before the candidate's last plane, world frame [m], shape [N]."""
    normal: wp.array[wp.vec3d]
    """Mean plane of the last plane in the world: unit normal, shape [N]."""
    offset: wp.array[wp.float64]
    """Mean plane of the last plane in the world: normal . p [m], shape [N]."""


@wp.func
def candidate_plane(key: wp.uint64) -> int:
    """Return the last plane of a candidate."""
    return wp.int32((key >> wp.uint64(32)) & ((wp.uint64(1) << PLANE_BITS) - wp.uint64(1)))


@wp.func
def candidate_parent(key: wp.uint64) -> int:
    """Return the code of the candidate before."""
    return wp.int32(key & wp.uint64(0x7FFFFFFF))


@wp.func
def candidate_depth(key: wp.uint64) -> int:
    """Return the number of planes of a candidate."""
    return wp.int32(key >> (wp.uint64(32) + PLANE_BITS))


@wp.func
def is_between(low: wp.float64, high: wp.float64, value: wp.float64) -> bool:
    """Return whether a coordinate lies between two others, or near them; generous, see `WIDE_MARGIN`."""
    slack = WIDE_MARGIN * (wp.float64(1.0) + wp.abs(value))
    return value >= low - slack and value <= high + slack


@wp.func
def reflects_in_box(
    normal: wp.vec3d, offset: wp.float64, low: wp.vec3d, high: wp.vec3d, tx: wp.vec3d, rx: wp.vec3d
) -> bool:
    """Return whether both ends are on one side of a plane, which reflects one to the other inside a box, or near it.

    The point is that of `reflection_point`, with one division and axis by axis: most surfaces fail at the first.
    """
    tx_height = wp.dot(normal, tx) - offset
    rx_height = wp.dot(normal, rx) - offset
    if not tx_height * rx_height > wp.float64(0.0):  # nor for NaN, the pose of an absent instance
        return False
    share = tx_height / (tx_height + rx_height)
    down = wp.float64(2.0) * share * rx_height
    if not is_between(low[0], high[0], tx[0] + share * (rx[0] - tx[0]) - down * normal[0]):
        return False
    if not is_between(low[1], high[1], tx[1] + share * (rx[1] - tx[1]) - down * normal[1]):
        return False
    return is_between(low[2], high[2], tx[2] + share * (rx[2] - tx[2]) - down * normal[2])


@wp.func
def link_target(target: wp.array[int], link: int) -> int:
    """Return the link that a candidate of some link is for, see `cull_candidates_kernel`."""
    if target.shape[0] == 0:
        return link
    return wp.max(target[link], -1 - target[link])


@wp.kernel
def cull_reflections_kernel(
    ends: LinkEnds,
    surfaces: Surfaces,
    first_link: int,
    link_count: int,
    first_source: int,
    is_hit: wp.array2d[wp.uint8],
    is_mirror: wp.array[wp.uint8],
    target: wp.array[int],
    # out
    listed_out: CandidateList,
    counts_out: wp.array[int],
):
    """List the surfaces that links could use: their point of reflection falls into the surface's box.

    A thread tests eight surfaces and eight links after `first_link`. `is_hit` has a row for each source from
    `first_source`, a column a plane; without rows every plane counts as hit. `is_mirror` tells which surfaces reflect,
    without entries all; `target` as in `cull_candidates_kernel`. Launch: dim=(ceil(link_count / 8), ceil(G / 8)).
    """
    block, group = wp.tid()
    links = wp.min(8, link_count - 8 * block)
    members = wp.min(8, surfaces.row.shape[0] - 8 * group)
    pairs = wp.uint64(0)  # bit 8 s + b: surface s and link b of the thread
    member = wp.int32(0)
    while member < members:
        surface = 8 * group + member
        row = surfaces.row[surface]
        normal = surfaces.normal[row]
        offset = surfaces.offset[row]
        carrier = surfaces.carrier[surface]
        bit = wp.int32(0)
        while bit < links:
            link = first_link + 8 * block + bit
            is_seen = is_hit.shape[0] == 0
            if not is_seen:
                is_seen = is_hit[ends.source[link] - first_source, surfaces.plane[surface]] != wp.uint8(0)
            if is_seen:
                low = surfaces.lower[row]
                high = surfaces.upper[row]
                if reflects_in_box(normal, offset, low, high, ends.tx[link, carrier], ends.rx[link, carrier]):
                    pairs = pairs | (wp.uint64(1) << wp.uint64(8 * member + bit))
            bit = bit + 1
        member = member + 1
    if pairs == wp.uint64(0):  # of most threads: what follows is no part of their loop
        return
    for index in range(64):
        if (pairs >> wp.uint64(index)) & wp.uint64(1) == wp.uint64(1):
            surface = 8 * group + index // 8
            is_reflecting = is_mirror.shape[0] == 0
            if not is_reflecting:
                is_reflecting = is_mirror[surface] != wp.uint8(0)
            if is_reflecting:
                link = first_link + 8 * block + index % 8
                place = append_candidate(listed_out, link_target(target, link), False, counts_out)
                if place >= 0:
                    listed_out.step[place, 0] = surface


@wp.kernel
def image_kernel(
    surfaces: Surfaces,
    pose: wp.array2d[wp.transformd],
    batch_index: wp.array[int],
    tx: wp.array[wp.vec3d],
    level: int,
    tree: CandidateTree,
    # out
    source_out: wp.array[int],
    image_out: wp.array[wp.vec3d],
    normal_out: wp.array[wp.vec3d],
    offset_out: wp.array[wp.float64],
):
    """Compute plane and image of the candidates of one level; those of the level before must be there.

    `batch_index` and `tx` [m, world frame] have a row a source. The outputs are the arrays of `tree`. Launch: dim=N.
    """
    cell = wp.tid()
    key = tree.key[cell]
    if key == EMPTY_CELL or candidate_depth(key) != level:
        return
    parent = candidate_parent(key)
    source = wp.int32(0)
    image = wp.vec3d()
    before = Plane()
    if parent < tree.first:
        source = parent // tree.plane_count
        image = tx[source]
        before = mean_plane(surfaces, pose, batch_index[source], surfaces.lead[parent % tree.plane_count])
    else:
        source = tree.source[parent - tree.first]
        image = tree.image[parent - tree.first]
        before.normal = tree.normal[parent - tree.first]
        before.offset = tree.offset[parent - tree.first]
    own = mean_plane(surfaces, pose, batch_index[source], surfaces.lead[candidate_plane(key)])
    source_out[cell] = source
    image_out[cell] = mirrored(image, before)
    normal_out[cell] = own.normal
    offset_out[cell] = own.offset


@wp.func
def points_in_boxes(
    ends: LinkEnds,
    surfaces: Surfaces,
    pose: wp.array2d[wp.transformd],
    tree: CandidateTree,
    last: int,
    link: int,
    end: wp.vec3d,
) -> bool:
    """Return whether the candidate with code `last`, read from its last plane to the first, reflects inside their boxes
    what goes from the transmitter of a link to the point `end`."""
    batch_index = ends.batch_index[link]
    target = end
    code = last
    is_valid = wp.bool(True)
    while is_valid and code >= tree.first:
        at = code - tree.first
        key = tree.key[at]
        normal = tree.normal[at]
        image = tree.image[at]
        is_valid = is_mirror(normal, tree.offset[at], image, target)
        if is_valid:
            target = reflection_point(image, target, normal, tree.offset[at])
            is_valid = in_plane_box(surfaces, pose, batch_index, candidate_plane(key), target)
        code = candidate_parent(key)
    if is_valid:
        first = code % tree.plane_count
        plane = mean_plane(surfaces, pose, batch_index, surfaces.lead[first])
        tx = ends.tx[link, ends.tx.shape[1] - 1]
        is_valid = is_mirror(plane.normal, plane.offset, tx, target)
        if is_valid:
            is_valid = in_plane_box(surfaces, pose, batch_index, first, mirror_point(plane, tx, target))
    return is_valid


@wp.func
def write_planes(
    tree: CandidateTree,
    code: int,
    row: int,
    index: int,
    step: int,
    step_out: wp.array2d[int],
):
    """Write the planes of a candidate from its last one on, from column `index` in the direction `step`."""
    at = code
    column = index
    while at >= tree.first:
        key = tree.key[at - tree.first]
        step_out[row, column] = candidate_plane(key)
        at = candidate_parent(key)
        column = column + step
    step_out[row, column] = at % tree.plane_count


@wp.func
def is_mirror_tree(tree: CandidateTree, last: int, is_mirror: wp.array[wp.uint8]) -> bool:
    """Return whether all planes of the candidate with code `last` reflect; without entries all do."""
    if is_mirror.shape[0] == 0:
        return True
    code = last
    is_all = wp.bool(True)
    while is_all and code >= tree.first:
        key = tree.key[code - tree.first]
        is_all = is_mirror[candidate_plane(key)] != wp.uint8(0)
        code = candidate_parent(key)
    return is_all and is_mirror[code % tree.plane_count] != wp.uint8(0)


@wp.kernel
def cull_candidates_kernel(
    ends: LinkEnds,
    surfaces: Surfaces,
    pose: wp.array2d[wp.transformd],
    tree: CandidateTree,
    is_mirror: wp.array[wp.uint8],
    target: wp.array[int],
    # out
    listed_out: CandidateList,
    counts_out: wp.array[int],
):
    """List the links of its source that a candidate could serve.

    `is_mirror` tells which planes reflect, without entries
    all. `target` is the link that each is listed as, or -1 - that link if it starts at its receiver, so that the planes
    are in the order from the other end; without entries its own number. Launch: dim=N.
    """
    cell = wp.tid()
    if tree.key[cell] == EMPTY_CELL:
        return
    last = tree.first + cell
    if not is_mirror_tree(tree, last, is_mirror):
        return
    source = tree.source[cell]
    link = tree.first_link[source]
    while link < tree.first_link[source + 1]:
        rx = ends.rx[link, ends.rx.shape[1] - 1]
        if points_in_boxes(ends, surfaces, pose, tree, last, link, rx):
            place = append_candidate(listed_out, link_target(target, link), True, counts_out)
            if place >= 0:
                is_turned = wp.bool(False)
                if target.shape[0] > 0:
                    is_turned = target[link] < 0
                if is_turned:
                    write_planes(tree, last, place, 0, 1, listed_out.step)
                else:
                    write_planes(tree, last, place, candidate_depth(tree.key[cell]) - 1, -1, listed_out.step)
        link = link + 1
