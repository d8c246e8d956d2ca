"""Refine candidates to paths: those that kernels list on the device, without the host in between, and those of it."""

from collections.abc import Callable, Hashable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.channel.path_solver.candidate_output import Candidates
from mmw.channel.path_solver.candidates import cells_name, grow_cells, prepare_town_hits
from mmw.channel.path_solver.search import Search, vector
from mmw.channel.path_solver.traced_paths import TracedPaths
from mmw.core.device import thread_spread
from mmw.core.packed_arrays import Layout, PackedArrays, padded_count
from mmw.core.recorded_work import Same
from mmw.kernels.channel.candidate_list import COUNTS, FOUND, FULL, LISTED, CandidateList
from mmw.kernels.channel.image_method import PathCandidates, points_kernel
from mmw.kernels.channel.path_segments import FoundPaths, found_kernel, sight_kernel
from mmw.kernels.channel.segments import HitBuffers

CANDIDATES_AT_ONCE = 2**20
"""Maximum number of candidates that are refined at once, about 300 bytes each at depth 3."""

FIRST_ROOM = {"candidates": (128, 2**18), "paths": (16, 2**16)}
"""Candidates and paths of a link that there is room for, and of all links at most, until a search has more."""


BATCH_ARRAYS = ("instances", "group_root", "instance_pose", "instance_present")
"""Arrays of the scene's struct that each batch writes: recorded launches read those that were there."""


@dataclass(frozen=True)
class Listed:
    """Candidates that kernels list."""

    rows: CandidateList
    counts: wp.array
    """Number of candidates, of paths, and whether a table was too small, shape [3]."""


def find_listed(
    search: Search,
    sights: int,
    is_wanted: bool,
    fill: Callable[[Listed], list[Candidates]],
    is_recordable: bool = False,
) -> tuple[TracedPaths, list[Candidates]]:
    """Return the paths among listed candidates, whose links count in the order of the transmitters, in any order.

    All is done again with more room if there was too little, so that no candidate is lost.

    Args:
        search: The scene, links and configuration.
        sights: Number of links whose lines of sight are wanted: all or none.
        is_wanted: Whether there may be any candidates but these.
        fill: Lists candidates, and returns those that are on the host; these are not refined.
        is_recordable: Whether `fill` returns none, and does the same with every search of the same configuration and
            numbers of links of each transmitter, by `Search.launch` alone: it is recorded.
    """
    table, depth, links = search.table, max(1, search.config.max_depth), len(search.links)
    town = prepare_town_hits(search) if is_wanted else ()
    while True:
        room = padded_count(_room(search, "candidates")) if is_wanted else 0
        most = min(sights + room, sights + _room(search, "paths"))

        def launch(room: int = room, most: int = most) -> tuple[PackedArrays, list[Candidates]]:
            search.upload_links()
            block = search.borrow(*_list_layouts(room, depth), is_scratch=True)
            out = _found_block(search, most)
            out.arrays[0].zero_()
            listed = Listed(block.struct(CandidateList, "link", "step", "is_plane"), out.arrays[0])
            others, at_once = fill(listed), min(sights + room, CANDIDATES_AT_ONCE)
            for begin in range(0, sights + room, CANDIDATES_AT_ONCE):
                _refine(search, listed.rows, -1, sights, begin, min(at_once, sights + room - begin), out)
            if is_recordable:
                out.queue_download()
            return out, others

        key = (*_record_key(search), room, most, town) if is_recordable else None
        out, others = search.run(key, launch)
        counts, *columns = out.download(is_queued=is_recordable)
        is_wanted |= bool(counts[LISTED])
        needed = {"candidates": int(counts[LISTED]), "paths": int(counts[FOUND])}
        if counts[FULL]:
            grow_cells(search)
        elif needed["candidates"] <= room and needed["paths"] <= out.arrays[1].shape[0]:
            return _traced(columns, slice(None, needed["paths"])), others
        for name, count in needed.items():  # half as much again, for the next batches
            if count > _room(search, name):
                table.sizes[_name(search, name)] = -(-3 * count // (2 * max(links, 1)))


def _record_key(search: Search) -> tuple[Hashable, ...]:
    """Return what decides the launches of a search, beside the numbers of links and poses and the room."""
    struct = search.scene.struct
    memory = (getattr(struct, name).ptr for name in BATCH_ARRAYS)
    cells = search.table.sizes.get(cells_name(search))
    return Same(struct), *memory, Same(search.config), search.sources.first_link.tobytes(), cells


def joined(candidates: Iterable[Candidates]) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Yield candidates of the host in few tables of bounded size, with whether each has planes: every table costs
    launches and transfers, however small it is."""
    parts = list(candidates)
    if not parts:
        return
    is_plane = np.concatenate([np.full(len(link), is_plane) for link, _, is_plane in parts])
    links, steps = (np.concatenate([part[k] for part in parts]) for k in range(2))
    for begin in range(0, len(links), CANDIDATES_AT_ONCE):
        part = slice(begin, begin + CANDIDATES_AT_ONCE)
        yield links[part], steps[part], is_plane[part]


def refine_given(
    search: Search,
    link: np.ndarray,
    step: np.ndarray,
    is_plane: np.ndarray | bool,
    touched: tuple[wp.array, wp.array] | None = None,
) -> tuple[TracedPaths, np.ndarray]:
    """Return which candidates of the host are paths, in their order, and their rows.

    `link` counts in the order of the transmitters, here and in the result.

    Args:
        search: The scene, links and configuration.
        link: Links, shape [C].
        step: Interactions, see `Candidates`, shape [C, D].
        is_plane: Whether those of a candidate are planes, shape [C], or of all.
        touched: Points [m] and unit normals, shape [C, 1] each: every candidate is a reflection there, at a curved
            surface.
    """
    count = len(link)
    given = search.borrow(*_list_layouts(padded_count(count), step.shape[1]))
    for view, values in zip(given.host, (link, step, is_plane), strict=True):
        view[:count] = values
    given.upload()
    out = _found_block(search, count)
    out.arrays[0].zero_()
    _refine(search, given.struct(CandidateList, "link", "step", "is_plane"), count, 0, 0, count, out, touched)
    counts, *columns = out.download()
    kept = columns[0][: int(counts[FOUND])]
    order = np.argsort(kept)
    return _traced(columns, order), kept[order]


def _name(search: Search, name: str) -> str:
    return f"{name} of a link at depth {search.config.max_depth}"


def _room(search: Search, name: str) -> int:
    each, most = FIRST_ROOM[name]
    links, learned = len(search.links), search.table.sizes.get(_name(search, name))
    return min(each * links, most) if learned is None else learned * links


def _list_layouts(rows: int, depth: int) -> tuple[Layout, ...]:
    return ((rows,), wp.int32), ((rows, depth), wp.int32), ((rows,), wp.uint8)


def _found_block(search: Search, paths: int) -> PackedArrays:
    """Return counts, and room for paths as in `FoundPaths` and `HitBuffers`."""
    rows = padded_count(paths)
    each, steps = ((rows,), wp.int32), ((rows, max(1, search.config.max_depth)), wp.int32)
    vectors = (steps[0], wp.vec3d)
    return search.borrow(((COUNTS,), wp.int32), each, each, each, steps, steps, vectors, vectors)


def _refine(
    search: Search,
    listed: CandidateList,
    given: int,
    sights: int,
    begin: int,
    count: int,
    out: PackedArrays,
    touched: tuple[wp.array, wp.array] | None = None,
) -> None:
    """Add the paths among some candidates to `out`."""
    if not count:
        return
    scene, table, config, device = search.scene, search.table, search.config, search.scene.device
    rows, depth = padded_count(count), max(1, config.max_depth)
    each, shape = ((rows,), wp.int32), (rows, depth)
    ints, vectors, numbers = (shape, wp.int32), (shape, wp.vec3d), (shape, wp.float64)
    steps = ints, vectors, vectors, numbers, vectors, each, each, each, ((rows, depth + 1), wp.uint8)
    scratch = search.borrow(*steps, ints, ints, vectors, vectors, is_scratch=True)
    names = [name for name in PathCandidates.vars if name != "is_curved"]
    if touched is None:
        candidates = scratch.struct(PathCandidates, *names, *5 * (None,))
    else:  # a struct of its own: that of the block is used again
        candidates = PathCandidates()
        for name, array in zip(names, scratch.arrays, strict=False):
            setattr(candidates, name, array)
        candidates.point, candidates.normal = touched
        candidates.is_curved = True
    sight = scratch.arrays[len(names)]
    hits = scratch.struct(HitBuffers, *len(steps) * (None,), "kind", "surface", "vertex", "normal")
    ends, flat, wedges = search.forward.ends, table.device, table.wedges.device
    which = listed, given, sights, begin, out.arrays[0]
    arguments = [ends, flat, wedges, search.pose, search.outlines, *which, candidates]
    spread = thread_spread(device, count)
    search.launch(points_kernel, (count, spread), arguments, block_dim=64)

    passes = config.max_depth if config.refraction else 0
    world = [table.scene_struct(scene), ends, flat, wedges, search.pose, vector(*scene.origin.tolist())]
    threads = depth + 1 if spread > 1 else 1  # one for each segment where there is room
    search.launch(sight_kernel, (count, threads, spread), [*world, threads, passes, candidates, sight], block_dim=64)

    arguments = [*world, begin, passes, candidates, sight, hits, out.arrays[0]]
    found = (
        out.struct(FoundPaths, None, "candidate", "link", "order", *4 * (None,)),
        out.struct(HitBuffers, *4 * (None,), "kind", "surface", "vertex", "normal"),
    )
    search.launch(found_kernel, (count, spread), [*arguments, *found], block_dim=64)


def _traced(columns: list[np.ndarray], rows: np.ndarray | slice) -> TracedPaths:
    """Return some of the paths of a block; slices still are its memory."""
    _, link, order, kind, surface, vertex, normal = (values[rows] for values in columns)
    ray = np.full(len(link), -1, dtype=np.int32)
    return TracedPaths(link, order, kind, surface, vertex, normal, ray, np.zeros(len(link)))
