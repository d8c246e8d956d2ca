"""Trace the geometry of all paths of a batch: candidates, image method, visibility, deduplication."""

from collections.abc import Iterator

import numpy as np
import warp as wp

from mmw.channel.path_solver.candidate_filter import (
    diffracted_candidates,
    is_recordable,
    lists_reflections,
    reflected_candidates,
)
from mmw.channel.path_solver.candidate_list import Listed, find_listed, joined, refine_given
from mmw.channel.path_solver.candidate_output import PAIRS_AT_ONCE, Candidates, selected_pairs
from mmw.channel.path_solver.curved_candidates import (
    curved_candidates,
    curved_points,
    curved_shares,
    separate_points,
)
from mmw.channel.path_solver.curved_surfaces import CurvedTable
from mmw.channel.path_solver.near_edges import near_edge_candidates
from mmw.channel.path_solver.path_order import paths_to_keep
from mmw.channel.path_solver.scatter_paths import diffuse_paths
from mmw.channel.path_solver.search import Search
from mmw.channel.path_solver.surface_table import SurfaceTable
from mmw.channel.path_solver.traced_paths import TracedPaths, reverse_columns
from mmw.kernels.channel.edges import cull_wedges_kernel
from mmw.physics.em.finite_surfaces import WEAKEST_SHARE
from mmw.physics.em.interaction import SPECULAR
from mmw.physics.em.vectors import norm


def trace_paths(search: Search, is_pair: np.ndarray | None = None) -> TracedPaths:
    """Return the geometry of all paths, sorted by (link, order, kinds, surfaces), without duplicates.

    Args:
        search: The scene, links and configuration.
        is_pair: Links that stand for both directions, whose two ends share the rays, shape [L]; None for none.

    Raises:
        InputError: If there are too many candidates to try.
    """
    links, config, table = search.links, search.config, search.table
    found: list[TracedPaths] = []
    if len(links):
        sights = len(links) if config.los else 0
        listed, others = find_listed(
            search,
            sights,
            lists_reflections(search),
            lambda listed: list(_candidates(search, is_pair, listed)),
            is_pair is None and is_recordable(search),
        )
        found.append(_of_mirrors(table, listed))
        for part in joined(_at_mirrors(table, others)):
            found.append(_of_mirrors(table, refine_given(search, *part)[0]))
        if table.curved is not None and config.specular_reflection and config.max_depth > 0:
            found += list(_curved_paths(search, table.curved))
        if config.diffuse_reflection and len(table):
            found += diffuse_paths(search)
    paths = _no_paths(max(1, config.max_depth)) if not found else found[0]
    if len(found) > 1:
        paths = TracedPaths(*(np.concatenate(column) for column in zip(*(f.columns for f in found), strict=True)))
    if not len(paths):
        return paths
    return paths_to_keep(paths, search.order, links, table.host_area, search.scene.origin)


def _curved_paths(search: Search, curved: CurvedTable) -> Iterator[TracedPaths]:
    """Yield the paths of one reflection at a curved surface."""
    device = search.scene.device
    for link, step, facet in curved_candidates(search, curved):
        given = [wp.array(values, dtype=wp.int32, device=device) for values in (link, facet)]
        touched, normal, point = curved_points(search, *given, curved)
        paths, kept = refine_given(search, link, step, False, (touched, normal))
        own = search.order[paths.link]
        share, _ = curved_shares(search, own, facet[kept], paths.vertex[:, 0], curved, is_facet=True)
        strength = np.linalg.norm(share, axis=1) / path_lengths(*_ends(search, paths), paths)
        yield paths.take(separate_points(paths, facet[kept], point.numpy()[kept], strength, curved))


def _no_paths(depth: int) -> TracedPaths:
    ints = np.zeros((0, depth), dtype=np.int32)
    points = np.zeros((0, depth, 3))
    return TracedPaths(ints[:, 0], ints[:, 0], ints, ints, points, points, ints[:, 0], points[:, 0, 0])


def _candidates(search: Search, is_pair: np.ndarray | None, listed: Listed) -> Iterator[Candidates]:
    """List candidates of reflections for the exact test, and yield all others but lines of sight."""
    config, table = search.config, search.table
    depth = max(1, config.max_depth)
    if config.max_depth == 0 or not len(table):
        return
    has_wedges = config.diffraction and len(table.wedges) > 0
    backward = search.backward() if has_wedges and config.specular_reflection and depth > 1 else None
    if config.specular_reflection and config.candidates == "launch" and is_pair is not None:
        yield from _shared_reflections(search, is_pair, listed)
    elif config.specular_reflection:
        single: list[tuple[np.ndarray, np.ndarray]] = []
        for part in reflected_candidates(search, search.forward, listed, backward):
            if backward is not None and table.outlines is not None and part[2]:
                own = part[1][:, 1] == -1
                single.append((part[0][own], part[1][own, 0]))
            yield part
        if single:
            yield from near_edge_candidates(search, *map(np.concatenate, zip(*single, strict=True)))
    if has_wedges:
        yield from _wedge_candidates(search)
    if backward is not None:
        links, row = backward
        for link, step, is_plane in diffracted_candidates(search, links):
            yield row[link], _reverse(step), is_plane


def _at_mirrors(table: SurfaceTable, candidates: list[Candidates]) -> Iterator[Candidates]:
    """Yield the candidates whose reflections are at flat mirrors, see `SurfaceTable.is_mirror`."""
    of_surface, of_plane = table.mirror_steps
    if of_surface is None or of_plane is None:
        yield from candidates
        return
    for link, step, is_plane in candidates:
        keep = (of_plane if is_plane else of_surface)[np.maximum(step, -1)].all(axis=1)
        yield link[keep], step[keep], is_plane


def _of_mirrors(table: SurfaceTable, paths: TracedPaths) -> TracedPaths:
    """Return the paths that reflect at flat surfaces: a plane of these may hold facets of curved ones too."""
    if table.is_mirror is None:
        return paths
    is_specular = paths.kind == SPECULAR
    is_other = is_specular & ~table.is_mirror[np.where(is_specular, paths.surface, 0)]
    return paths.take(np.flatnonzero(~is_other.any(axis=1)))


def _shared_reflections(search: Search, is_pair: np.ndarray, listed: Listed) -> Iterator[Candidates]:
    """Yield the candidates of reflections of links of which some stand for both directions.

    Both ends of such a link launch half of the rays, and the hits of either serve the link.
    """
    links, rays = search.links, search.config.samples_per_tx
    half = search.with_rays(max(rays // 2, 2))
    for rows, both, own in ((np.flatnonzero(~is_pair), 1, search), (np.flatnonzero(is_pair), 2, half)):
        if not len(rows):
            continue
        tx, rx = links.tx.position[rows], links.rx.position[rows]
        tx, rx = (np.concatenate([tx, rx]), np.concatenate([rx, tx])) if both == 2 else (tx, rx)
        sorted_links = search.sort(np.tile(links.batch_index[rows], both), tx, rx)
        is_turned, link_of = np.divmod(sorted_links.order, len(rows))
        link_of = search.rank[rows[link_of]]
        target = search.upload((np.where(is_turned, -1 - link_of, link_of), wp.int32)).arrays[0]
        for link, step, is_plane in reflected_candidates(own, sorted_links, listed, target=target):
            yield link_of[link], np.where(is_turned[link, None], _reverse(step), step), is_plane


def _reverse(step: np.ndarray) -> np.ndarray:
    """Return steps from the other end, shape [C, D]."""
    return reverse_columns(step, (step != -1).sum(axis=1), -1)


def _ends(search: Search, found: TracedPaths) -> tuple[np.ndarray, np.ndarray]:
    """Return both ends of paths whose links count in the order of the sources, shape [P, 3] each."""
    rows = search.order[found.link]
    return search.links.tx.position[rows], search.links.rx.position[rows]


def _wedge_candidates(search: Search) -> Iterator[Candidates]:
    """Yield the candidates of one diffraction and nothing else: every wedge for every link."""
    links, wedges, device = search.links, search.table.wedges, search.scene.device
    at_once = max(1, PAIRS_AT_ONCE // len(wedges))
    for begin in range(0, len(links), at_once):
        rows = search.order[begin : begin + at_once]
        inputs = [
            wp.array(links.batch_index[rows], dtype=wp.int32, device=device),
            *(wp.array(end.position[rows], dtype=wp.vec3d, device=device) for end in (links.tx, links.rx)),
            wedges.device,
            search.pose,
            search.outlines.shortest_m,
            WEAKEST_SHARE,
        ]
        link, wedge = selected_pairs(search, cull_wedges_kernel, inputs, (len(rows), len(wedges)))
        step = np.full((len(link), max(1, search.config.max_depth)), -1, dtype=np.int32)
        step[:, 0] = -2 - wedge
        yield (link + begin).astype(np.int32), step, False


def path_lengths(tx: np.ndarray, rx: np.ndarray, found: TracedPaths) -> np.ndarray:
    """Return the lengths of paths between ends of shape [P, 3], in meters, shape [P]."""
    points = np.empty((len(found), found.kind.shape[1] + 2, 3))
    points[:, 0], points[:, -1] = tx, rx
    is_there = np.arange(found.kind.shape[1]) < found.order[:, None]
    points[:, 1:-1] = np.where(is_there[..., None], found.vertex, rx[:, None])
    total, *parts = norm(points[:, 1:] - points[:, :-1]).T
    for part in parts:
        total = total + part
    return total
