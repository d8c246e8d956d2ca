"""Find path candidates, sequences of planes that could carry a path of a link, by launched rays or exhaustively."""

from collections.abc import Hashable, Iterator
from functools import cache
from typing import Any

import numpy as np
import warp as wp

from mmw.channel.path_solver.search import Search, Sources
from mmw.channel.path_solver.town_hits import MAX_SOURCES, MIN_RAYS, KeptHits
from mmw.config import ChannelConfig
from mmw.core.errors import InputError
from mmw.kernels.channel.candidate_list import COUNTS, FULL
from mmw.kernels.channel.ray_launch import PATCH, PLANE_BITS, RayPatches, TownHits, launch_kernel
from mmw.kernels.channel.reflection_candidates import CandidateTree

PAIRS_AT_ONCE = 2**27
"""Maximum number of (link, surface) or (transmitter, plane) pairs at once: about one byte each on the device."""

RAYS_AT_ONCE = 2**30
"""Maximum number of rays in one kernel launch."""

CELLS_AT_ONCE = {"cuda": 2**26, "cpu": 2**23}
"""Cells of the table of candidates that justify a launch of several transmitters; 84 bytes each."""

MAX_CELLS = 2**30
"""Cells of the largest table."""

FIRST_CELLS = 2**15
"""Cells for each transmitter and each level below the first, until a launch needs more."""


class TableFull(Exception):
    """The table of candidates is too small for this launch."""


def launches(
    search: Search, sources: Sources, counts: wp.array | None = None
) -> Iterator[tuple[Sources, int, wp.array, "CandidateTree | None"]]:
    """Yield what the rays of all sources hit, or everything that they could, in parts that fit into memory.

    Args:
        search: Surfaces, candidate mode, rays, depth, refraction.
        sources: Where the rays start.
        counts: Counts of `candidate_list`, which tell then, and not before, whether the table of candidates was too
            small, see `grow_cells`; without them the host waits here for the rays, and grows it.

    Yields:
        Some of the sources; the number of the first of them; the planes that are hit first, one byte each, shape [A,
        K], without rows if all could be hit; and the candidates of two planes and more, None if none are wanted, of
        which only keys and first links are there.

    Raises:
        InputError: If there are too many candidates to try them all, or to hold them.
    """
    pending = _chunks(sources.first_link, len(search.table), search.config)
    while pending:
        begin, end = pending.pop(0)
        part = sources.part(begin, end)
        try:
            yield part, begin, *_first_planes_and_tree(search, part, counts)
        except TableFull:
            middle = (begin + end) // 2
            pending = [(begin, middle), (middle, end), *pending]


def _chunks(first_link: np.ndarray, surface_count: int, config: ChannelConfig) -> list[tuple[int, int]]:
    """Return ranges of transmitters that keep memory and launch sizes bounded; always at least one transmitter."""
    chunks, begin = [], 0
    while begin < len(first_link) - 1:
        end = begin + 1
        while (
            end < len(first_link) - 1
            and (first_link[end + 1] - first_link[begin]) * surface_count <= PAIRS_AT_ONCE
            and (end + 1 - begin) * surface_count <= PAIRS_AT_ONCE
            and (end + 1 - begin) * config.samples_per_tx <= RAYS_AT_ONCE
        ):
            end += 1
        chunks.append((begin, end))
        begin = end
    return chunks


def _first_planes_and_tree(
    search: Search, sources: Sources, counts: wp.array | None
) -> "tuple[wp.array, CandidateTree | None]":
    """Return the first planes, one byte each, shape [A, K] or [0, 0] for all, and longer candidates, if wanted."""
    scene, config = search.scene, search.config
    if config.candidates == "exhaustive":
        is_hit = no_values(scene.device, 2, wp.uint8)
        if config.max_depth == 1:
            return is_hit, None
        keys = search.once("keys", lambda: _all_keys(search, len(sources)))
        return is_hit, _tree(search, sources, keys.shape[0], keys) if keys.shape[0] else None
    if config.max_depth == 1:
        return launch_rays(search, sources, config.samples_per_tx, counts=counts)[0], None
    patterns = range(search.pattern_count(config.max_depth))
    max_cells = CELLS_AT_ONCE["cuda" if "cuda" in scene.device else "cpu"]
    while True:
        cells = 1 << (_cells(search) * len(sources) - 1).bit_length()
        if cells > max_cells and len(sources) > 1:
            raise TableFull
        if cells > MAX_CELLS:
            raise InputError(
                f"channel.samples_per_tx = {config.samples_per_tx}, max_depth = {config.max_depth}: the candidates of "
                f"one transmitter do not fit into {MAX_CELLS} cells; launch fewer rays or lower the depth"
            )
        tree = _tree(search, sources, cells)
        is_hit, own = launch_rays(search, sources, config.samples_per_tx, config.max_depth, tree.key, patterns, counts)
        if counts is not None or not own.numpy()[FULL]:
            return is_hit, tree
        grow_cells(search)


def _tree(search: Search, sources: Sources, cells: int, keys: wp.array | None = None) -> CandidateTree:
    """Return a tree of candidates, with undefined values but its first links, and the keys where they are given."""
    names = ["source", "offset", "image", "normal"]
    layouts = [((cells,), kind) for kind in (wp.int32, wp.float64, wp.vec3d, wp.vec3d)]
    if keys is None:
        names, layouts = ["key", *names], [((cells,), wp.uint64), *layouts]
    tree = search.borrow(*layouts, is_scratch=True).struct(CandidateTree, *names)
    if keys is not None:
        tree.key = keys
    tree.first, tree.plane_count = len(sources) * search.table.plane_count, search.table.plane_count
    tree.first_link = sources.device[3]
    return tree


def _all_keys(search: Search, sources: int) -> wp.array:
    """Return `all_path_candidates` on the device."""
    values = all_path_candidates(sources, search.table.plane_count, search.config.max_depth)
    return wp.array(values, dtype=wp.uint64, device=search.scene.device)


def prepare_town_hits(search: Search) -> Hashable:
    """Launch the rays of transmitters that rest against the town, if their hits are not kept yet.

    Returns:
        What tells the arguments of the next `launch_rays` apart.
    """
    kept = _kept_hits(search, search.config.samples_per_tx, search.config.max_depth)
    if kept is None:
        return ()

    def fill(origins: np.ndarray, hits: TownHits) -> None:
        device = search.scene.device
        begin = wp.zeros(len(origins), dtype=wp.int32, device=device), wp.array(origins, dtype=wp.vec3, device=device)
        out = [no_values(device, 2, wp.uint8), no_values(device, 1, wp.uint64), no_values(device, 1, wp.int32)]
        _launch(search, len(origins), begin, (search.config.samples_per_tx, kept.depth, 0), hits, out)

    return kept.key(kept.prepare(search.sources.origin, fill))


def _kept_hits(search: Search, rays: int, depth: int) -> KeptHits | None:
    """Return the kept hits of the town, None where none are kept."""
    config, kept = search.config, search.table.town_hits
    if config.candidates == "exhaustive" or rays < MIN_RAYS or depth < 1 or len(search.sources) > MAX_SOURCES:
        return None
    if search.pattern_count(config.max_depth) > 1:
        return None
    if (rays, depth) not in kept:
        kept[rays, depth] = KeptHits(search.scene.device, ray_patches(rays, search.scene.device)[1], depth)
    return kept[rays, depth]


def _cells(search: Search) -> int:
    """Return the cells of the table of candidates for each transmitter."""
    config, table = search.config, search.table
    max_candidates = 2 * config.samples_per_tx * (config.max_depth - 1)  # half full at worst
    max_candidates *= search.pattern_count(config.max_depth)
    first = min(FIRST_CELLS << 3 * (config.max_depth - 2), max_candidates)
    return table.sizes.get(cells_name(search), first)


def cells_name(search: Search) -> str:
    """Return the name of the number of cells in `SurfaceTable.sizes`."""
    return f"cells at depth {search.config.max_depth}"


def grow_cells(search: Search) -> None:
    """Make the next launches have more cells: a candidate found none."""
    search.table.sizes[cells_name(search)] = 4 * _cells(search)


@cache
def no_values(device: str, dimensions: int, kind: Any) -> wp.array:
    """Return an array without entries, which stands for all in kernels."""
    return wp.empty((0,) * dimensions, dtype=kind, device=device)


def launch_rays(
    search: Search,
    sources: Sources,
    rays: int,
    depth: int = 1,
    keys: wp.array | None = None,
    patterns: range = range(1),
    counts: wp.array | None = None,
) -> tuple[wp.array, wp.array]:
    """Follow the rays of each transmitter.

    Args:
        search: The scene with its batch loaded, and its surfaces.
        sources: The transmitters.
        rays: Rays of each transmitter, > 1.
        depth: Surfaces that a ray follows.
        keys: Gets the candidates of two planes and more; a power of two of them.
        patterns: Which of its surfaces a ray goes through instead of off them, one launch a bit pattern.
        counts: Counts of `candidate_list` to be used; new ones without them.

    Returns:
        Planes that are hit first, one byte each, shape [A, K]; and the counts, which tell whether some candidate found
        no cell.
    """
    table, device = search.table, search.scene.device
    is_hit = search.scratch((len(sources), table.plane_count), wp.uint8)
    is_hit.zero_()
    if keys is None:
        keys = no_values(device, 1, wp.uint64)
    else:
        keys.zero_()
    if counts is None:
        counts = search.scratch((COUNTS,), wp.int32)
        counts.zero_()
    kept = _kept_hits(search, rays, depth)
    rows = () if kept is None else kept.rows([place.tobytes() for place in sources.origin])
    hits = _no_hits() if kept is None or not rows else kept.hits(rows)
    for passes in patterns:
        _launch(search, len(sources), sources.device[:2], (rays, depth, passes), hits, [is_hit, keys, counts])
    return is_hit, counts


def _launch(
    search: Search,
    sources: int,
    begin: tuple[wp.array, ...],
    ways: tuple[int, int, int],
    hits: TownHits,
    out: list[wp.array],
) -> None:
    """Launch rays from batch indices and origins `begin`; `ways` are their number, depth and pattern."""
    table, (rays, depth, passes) = search.table, ways
    patches, threads = ray_patches(rays, search.scene.device)
    inputs = [table.scene_struct(search.scene), *begin, table.device.plane, table.device.is_slab]
    arguments = [*inputs, patches, depth, passes, hits, *out]
    search.launch(launch_kernel, (sources, threads), arguments, block_dim=64)


@cache
def _no_hits() -> TownHits:
    return TownHits()


@cache
def ray_patches(ray_count: int, device: str) -> tuple[RayPatches, int]:
    """Return the patches of a lattice of rays, and the threads of all of them.

    Azimuths of rays i and i + F differ by 2 pi / (sqrt(5) F) and their heights by 2 F / N, which are alike at F^2 = pi
    N / sqrt(5): belts have the first Fibonacci number F from there on. Ray k of a belt is at nearly k G / F turns,
    where G is the Fibonacci number before F; as G G = +-1 modulo F, k G modulo F is the order of azimuths or its
    reverse.
    """
    step, belt = 1, 2
    while belt * belt < np.pi * ray_count / np.sqrt(5.0):
        step, belt = belt, step + belt
    patches, belts = RayPatches(), -(-ray_count // belt)
    patches.ray_count, patches.patches_below = ray_count, -(-belts // PATCH)
    order = np.arange(belt, dtype=np.int64) * step % belt
    patches.order = wp.array(order, dtype=wp.int32, device=device)
    return patches, patches.patches_below * -(-belt // PATCH) * PATCH * PATCH


def all_path_candidates(sources: int, planes: int, depth: int) -> np.ndarray:
    """Return the keys of all candidates of 2 to `depth` planes without the same one twice in a row, shape [N], uint64.

    Raises:
        InputError: If there are more than `PAIRS_AT_ONCE`.
    """
    count = sources * planes * sum((planes - 1) ** k for k in range(1, depth))
    if count > PAIRS_AT_ONCE:
        raise InputError(
            f"channel.candidates = 'exhaustive' with max_depth = {depth}: {planes} planes make {count} candidates, the "
            f"most is {PAIRS_AT_ONCE}; use candidates: launch, or a lower depth"
        )
    parent = np.arange(sources * planes)
    last, filled, keys = parent % planes, sources * planes, []
    for level in range(2, depth + 1):
        code, plane = np.repeat(parent, planes), np.tile(np.arange(planes), len(parent))
        keep = np.repeat(last, planes) != plane
        code, last = code[keep].astype(np.uint64), plane[keep]
        top = np.uint64(level) << np.uint64(32 + PLANE_BITS.value)
        keys.append(top | (last.astype(np.uint64) << np.uint64(32)) | code)
        parent = filled + np.arange(len(last))
        filled += len(last)
    return np.concatenate(keys)
