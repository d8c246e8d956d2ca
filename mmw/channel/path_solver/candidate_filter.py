"""Filter path candidates by a generous test for the links that could use each."""

from collections.abc import Iterator

import numpy as np
import warp as wp

from mmw.channel.path_solver.candidate_list import Listed
from mmw.channel.path_solver.candidate_output import PAIRS_AT_ONCE, Candidates, count_then_write, selected_pairs
from mmw.channel.path_solver.candidates import launches, no_values
from mmw.channel.path_solver.link_blocks import MANY_LINKS, block_candidates, block_reflections, make_link_blocks
from mmw.channel.path_solver.search import Search, SortedLinks, Sources
from mmw.channel.path_solver.workspace import MAX_KEPT_LINKS
from mmw.core.recorded_work import prefers_records
from mmw.kernels.channel.diffraction_candidates import ReverseCandidates, diffraction_kernel, double_sided_kernel
from mmw.kernels.channel.finite_surfaces import cull_finite_kernel
from mmw.kernels.channel.ray_launch import PLANE_BITS
from mmw.kernels.channel.reflection_candidates import (
    CandidateTree,
    cull_candidates_kernel,
    cull_reflections_kernel,
    image_kernel,
)


def reflected_candidates(
    search: Search,
    links: SortedLinks,
    listed: Listed,
    backward: tuple[SortedLinks, np.ndarray] | None = None,
    target: wp.array | None = None,
) -> Iterator[Candidates]:
    """List candidates of reflections, and yield those that the host has to see: of finite surfaces, of links in blocks,
    and with diffraction those that have a wedge among or behind them.

    Args:
        search: Surfaces, candidate mode, rays, depth.
        links: The links.
        listed: Where the candidates are listed.
        backward: `Search.backward()`, for diffraction.
        target: Links that the listed candidates are for, see `cull_candidates_kernel`; these links without it.

    Raises:
        InputError: If there are too many candidates to try them all, or to hold them.
    """
    device = search.scene.device
    of_surface, of_plane = search.table.mirrors_on_device
    target = no_values(device, 1, wp.int32) if target is None else target
    out = [listed.rows, listed.counts]
    for part, begin, is_hit, tree in launches(search, links.sources, listed.counts):
        blocks = make_link_blocks(links, part)
        if search.table.outlines is not None:
            yield from _finite_reflections(search, links, part, begin, is_hit)
        elif blocks is None:
            first, count = int(part.first_link[0]), int(part.first_link[-1] - part.first_link[0])
            shape = -(-count // 8), -(-len(search.table) // 8)
            inputs = [links.ends, search.table.device, first, count, begin, is_hit, of_surface, target]
            search.launch(cull_reflections_kernel, shape, [*inputs, *out])
        else:
            yield from block_reflections(search, links, part, is_hit, blocks)
        if tree is not None:
            _build_tree(search, part, tree)
            if blocks is None:
                inputs = [links.ends, search.table.device, search.pose, tree, of_plane, target]
                search.launch(cull_candidates_kernel, tree.key.shape, [*inputs, *out])
            else:
                yield from block_candidates(search, links, part, tree, blocks)
            if backward is not None:
                yield from _with_wedges(search, diffraction_kernel, links, part, tree)
                if search.config.max_depth > 2:
                    yield from _double_sided(search, links, part, tree, *backward)


def lists_reflections(search: Search) -> bool:
    """Return whether `reflected_candidates` lists any."""
    config = search.config
    if not config.specular_reflection or config.max_depth == 0 or not len(search.table):
        return False
    if config.max_depth == 1 and search.table.outlines is not None:
        return False
    return len(search.links) < MANY_LINKS or bool((np.diff(search.sources.first_link) < MANY_LINKS).any())


def is_recordable(search: Search) -> bool:
    """Return whether all candidates are listed on the device, by launches that are the same for searches of a kind and
    worth to be recorded."""
    table = search.table
    if len(search.links) > MAX_KEPT_LINKS or not prefers_records(search.scene.device):
        return False
    has_wedges = search.config.diffraction and len(table.wedges) > 0
    return table.outlines is None and table.foliage is None and not has_wedges


def diffracted_candidates(search: Search, links: SortedLinks) -> Iterator[Candidates]:
    """Yield candidates of reflections with a diffraction behind them only; see `reflected_candidates`."""
    for part, _, _, tree in launches(search, links.sources):
        if tree is not None:
            _build_tree(search, part, tree)
            yield from _with_wedges(search, diffraction_kernel, links, part, tree)


def _finite_reflections(
    search: Search, links: SortedLinks, sources: Sources, first_source: int, is_hit: wp.array
) -> Iterator[Candidates]:
    """Yield the candidates of one reflection at planes of finite extent."""
    planes = search.table.plane_count
    end, at_once = int(sources.first_link[-1]), max(1, PAIRS_AT_ONCE // max(planes, 1))
    for begin in range(int(sources.first_link[0]), end, at_once):
        shape = min(at_once, end - begin), planes
        inputs = [links.ends, search.table.device, search.outlines, begin, first_source, is_hit]
        link, plane = selected_pairs(search, cull_finite_kernel, inputs, shape)
        step = np.full((len(link), max(1, search.config.max_depth)), -1, dtype=np.int32)
        step[:, 0] = plane
        yield (begin + link).astype(np.int32), step, True


def _build_tree(search: Search, sources: Sources, tree: CandidateTree) -> None:
    """Compute planes and images of the transmitters of the candidates."""
    batch_index, _, tx, _ = sources.device
    inputs, out = (
        [search.table.device, search.pose, batch_index, tx],
        [tree.source, tree.image, tree.normal, tree.offset],
    )
    for level in range(2, search.config.max_depth + 1):
        search.launch(image_kernel, tree.key.shape, [*inputs, level, tree, *out])


def _double_sided(
    search: Search, links: SortedLinks, sources: Sources, tree: CandidateTree, backward: SortedLinks, row: np.ndarray
) -> Iterator[Candidates]:
    """Yield the candidates with reflections on both sides of a wedge."""
    device, depth = search.scene.device, search.config.max_depth
    place = np.argsort(row).astype(np.int32)  # of each link among the reversed ones
    reverse = ReverseCandidates()
    reverse.ends = backward.ends
    reverse.link = wp.array(place, dtype=wp.int32, device=device)
    receiver = np.searchsorted(backward.sources.first_link, place, side="right") - 1
    used = receiver[sources.first_link[0] : sources.first_link[-1]]  # sorted by frame, as the transmitters are
    low, high = int(used.min()), int(used.max()) + 1
    for part, begin, _, reverse_tree in launches(search, backward.sources.part(low, high)):
        if reverse_tree is None:
            continue
        reverse.tree = reverse_tree
        _build_tree(search, part, reverse_tree)
        key, cell = _by_last_plane(reverse.tree, depth)
        reverse.key = wp.array(key, dtype=wp.int64, device=device)
        reverse.cell = wp.array(cell, dtype=wp.int32, device=device)
        source = receiver - low - begin
        source = np.where((source >= 0) & (source < len(part)), source, -1)
        reverse.source = wp.array(source, dtype=wp.int32, device=device)
        yield from _with_wedges(search, double_sided_kernel, links, sources, tree, reverse, depth)


def _with_wedges(
    search: Search, kernel: wp.Kernel, links: SortedLinks, sources: Sources, tree: CandidateTree, *more: object
) -> Iterator[Candidates]:
    """Yield the output of a kernel that puts wedges among the planes of candidates."""
    table = search.table
    inputs = [links.ends, table.device, table.wedges.device, search.pose, tree.first_link, tree, *more]
    yield from count_then_write(search, kernel, inputs, tree.key.shape, True)


def _by_last_plane(tree: CandidateTree, depth: int) -> tuple[np.ndarray, np.ndarray]:
    """Return source * K + last plane, and cell, of the candidates that leave room for a wedge and one more; sorted."""
    keys, source = tree.key.numpy(), tree.source.numpy()
    level = keys >> np.uint64(32 + PLANE_BITS.value)
    cell = np.flatnonzero((level > 0) & (level < depth))
    plane = (keys[cell] >> np.uint64(32)) & np.uint64(2**PLANE_BITS.value - 1)
    key = source[cell].astype(np.int64) * tree.plane_count + plane.astype(np.int64)
    order = np.lexsort((keys[cell], key))
    return key[order], cell[order]
