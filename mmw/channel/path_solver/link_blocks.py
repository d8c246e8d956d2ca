"""Filter path candidates of reflections for transmitters with many links, such as those of a radio map."""

from collections.abc import Iterator

import numpy as np
import warp as wp

from mmw.channel.path_solver.candidate_output import Candidates, count_then_write
from mmw.channel.path_solver.search import Search, SortedLinks, Sources
from mmw.kernels.channel.link_blocks import (
    LARGE_BLOCK,
    LINKS_OF_THREAD,
    SMALL_BLOCK,
    LinkBlocks,
    block_candidates_kernel,
    block_reflections_kernel,
)
from mmw.kernels.channel.ray_launch import EMPTY_CELL
from mmw.kernels.channel.reflection_candidates import CandidateTree

MANY_LINKS = 512
"""Links of one transmitter from which on they are tested in blocks; below, each is tested by itself."""


def make_link_blocks(links: SortedLinks, sources: Sources) -> "LinkBlocks | None":
    """Return boxes about blocks of the receivers; None if no source has so many links that blocks pay.

    Args:
        links: All links; blocks are the tighter the nearer neighbors in their order are.
        sources: The sources that are looked at.
    """
    if int(np.diff(sources.first_link).max()) < MANY_LINKS:
        return None
    world = links.ends.rx.numpy()[:, -1]
    blocks, device = LinkBlocks(), links.ends.rx.device
    for name, size in (("small", SMALL_BLOCK), ("large", LARGE_BLOCK)):
        first = np.arange(0, len(world), size)
        for side, reduce in (("lower", np.minimum), ("upper", np.maximum)):
            corner = reduce.reduceat(world, first)
            setattr(blocks, f"{name}_{side}", wp.array(corner, dtype=wp.vec3d, device=device))
    return blocks


def block_reflections(
    search: Search, links: SortedLinks, sources: Sources, is_hit: wp.array, blocks: LinkBlocks
) -> Iterator[Candidates]:
    """Yield the candidates of one reflection.

    Args:
        search: Surfaces and poses.
        links: The links.
        sources: The sources that launched the rays.
        is_hit: Planes that the rays hit first, one byte each, shape [A, K], without rows if all could be hit.
        blocks: Boxes about the links.
    """
    device, table = search.scene.device, search.table
    surfaces = np.arange(len(table), dtype=np.int32)
    if is_hit.shape[0]:
        is_seen = np.asarray(is_hit.numpy().any(axis=0))
        surfaces = surfaces[is_seen[table.device.plane.numpy()]]
    if not len(surfaces):
        return
    inputs = [links.ends, table.device, search.pose, _device_ints(sources.first_link, device), blocks]
    inputs += [_device_ints(surfaces, device), is_hit]
    dim = (len(sources), len(surfaces), _parts(sources))
    yield from count_then_write(search, block_reflections_kernel, inputs, dim, False)


def block_candidates(
    search: Search, links: SortedLinks, sources: Sources, tree: CandidateTree, blocks: LinkBlocks
) -> Iterator[Candidates]:
    """Yield the candidates of two reflections and more.

    Args:
        search: Surfaces and poses.
        links: The links.
        sources: The sources of the tree.
        tree: The candidates.
        blocks: Boxes about the links.
    """
    cells = np.flatnonzero(tree.key.numpy() != EMPTY_CELL.value).astype(np.int32)
    if not len(cells):
        return
    device = search.scene.device
    inputs = [links.ends, search.table.device, search.pose, _device_ints(sources.first_link, device), blocks, tree]
    inputs.append(_device_ints(cells, device))
    yield from count_then_write(search, block_candidates_kernel, inputs, (len(cells), _parts(sources)), True)


def _parts(sources: Sources) -> int:
    """Return the parts of links that threads share."""
    return -(-int(np.diff(sources.first_link).max()) // LINKS_OF_THREAD)


def _device_ints(values: np.ndarray, device: str) -> wp.array:
    return wp.array(values, dtype=wp.int32, device=device)
