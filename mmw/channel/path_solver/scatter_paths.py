"""Trace diffuse paths: rough patches of a path, with mirrors before or behind a single one, and slabs anywhere.

Rays of the transmitter reflect from surface to surface; every rough surface that they hit scatters straight to the
receivers. Rays of the receivers do the same backward, for paths with mirrors behind the patch. Foliage that waves pass
scatters where a ray, with its mirrors, meets it first from outside.

With a fixed number of rays, patches without mirrors are those of the transmitter's rays, as in Sionna RT. Where a
receiver is nearer to a rough surface than the rays of the transmitter are to each other there, few of them carry most
of the power: at 60 m, 1.5 m above rough ground, the sum of 1,000 rays is 3.7 dB low in the median over receivers and 7
dB high at some, though right in the mean. With a stated error, the rays of both ends count: each by its share
(`_balanced`) where there is no mirror, the denser ones with mirrors (`mirrored_patches`). The number of rays of each
link follows from the spread of their contributions (`_paths_by_error`).
"""

import numpy as np

from mmw.channel.path_solver.mirrored_patches import from_nearer_ends
from mmw.channel.path_solver.patch_links import connect_patches, far_links
from mmw.channel.path_solver.patch_rays import (
    RayHits,
    first_patches,
    meets_leaves,
    select_hits,
    source_parts,
    trace_rays,
)
from mmw.channel.path_solver.search import Search, SortedLinks, Sources
from mmw.channel.path_solver.second_patches import second_patches
from mmw.channel.path_solver.thinned_paths import thin_out
from mmw.channel.path_solver.traced_paths import TracedPaths
from mmw.config.channel import FEWEST_DIFFUSE_RAYS
from mmw.physics.em.interaction import DIFFUSE, SPECULAR
from mmw.physics.em.vectors import dot, norm

ROWS_AT_ONCE = 2**21
"""Maximum number of (hit, link) rows at once, about 200 bytes each at depth 3."""

UNEQUAL_STRENGTHS = 2.0
"""Factor of the variance of a sum, 1 + (standard deviation / mean)^2 of the strengths S^2 Gamma^2 of surfaces, for
strengths that spread as much as their mean. Design value; in town03 and town10 it makes the error that is stated."""

KEPT_SHARE = 32.0
"""Paths that a link keeps for a stated error, over the effective number that it needs; thinning adds at most the
inverse to the variance of surfaces that scatter alike, and several times that with narrow lobes. Design value."""

SEARCH_RAYS, MAX_RAYS = 2**14, 2**20
"""Rays of an end for a stated error: the most while no rough surface is seen, which finds those of 0.001 sr, such as 3
m by 3 m at 100 m; and the most. Design values."""


def diffuse_paths(search: Search) -> list[TracedPaths]:
    """Return the diffuse paths of all links, which count links in the order of the transmitters."""
    config, rows = search.config, np.arange(len(search.links))
    if not search.table.is_rough.any() or config.max_depth < 1:
        return []
    if config.diffuse_relative_error is not None:
        return _paths_by_error(search, rows, config.diffuse_relative_error)
    return _first_order(search, rows, config.diffuse_samples) + _second_order(search, rows, config.diffuse_samples)


def _paths_by_error(search: Search, rows: np.ndarray, error: float) -> list[TracedPaths]:
    """Return the diffuse paths of links, each with as many rays as the stated error needs.

    The power of a link is a sum of the contributions w_i of its rays. For rays that are independent of each other, the
    variance of the sum is at most the sum of w_i^2, so its relative standard error is sqrt(sum w_i^2) / sum w_i, or
    1 / sqrt(n) with the effective number of rays n = (sum w_i)^2 / sum w_i^2. It falls as 1 / sqrt(rays). Rays are
    doubled until n is `UNEQUAL_STRENGTHS` / (10^(e / 10) - 1)^2 for the stated error of e dB, 134 for 0.5 dB. Each link
    is looked at by itself, so that its paths do not depend on the others. All paths with one patch decide, as if
    surfaces were Lambertian and equally strong and mirrors lost nothing, so that weathers and carriers share the paths.

    Where a few close patches have most of the power, that takes many rays, most of which say little: such links keep
    the paths that `thin_out` leaves.

    Rays of the Fibonacci lattice are more even than independent ones, so the error of smooth scatterers is several
    times lower than stated. The bias of the lattice is that of its solid angles: 4 pi / N is used for rays that are
    4 pi / (N - 1) apart, which is -0.008 dB for 512 rays.

    Source: L. Kish, Survey Sampling, Wiley 1965, section 11.7 (effective number of samples); Y. S. Chow and H. Robbins,
    "On the asymptotic theory of fixed-width sequential confidence intervals", Annals of Mathematical Statistics 36,
    1965.
    """
    limit, rays, found = error**2 / UNEQUAL_STRENGTHS, FEWEST_DIFFUSE_RAYS, []
    while len(rows):
        parts = _first_order(search, rows, rays)
        count, total, square = (np.zeros(len(search.links)) for _ in range(3))
        row_of = [search.order[paths.link] for paths in parts]
        for row, paths in zip(row_of, parts, strict=True):
            weight = _lambertian_power(search, row, paths)
            for sums, values in ((count, np.ones(len(row))), (total, weight), (square, weight**2)):
                np.add.at(sums, row, values)
        is_done = np.where(count > 0, square <= limit * total**2, rays >= SEARCH_RAYS) | (rays >= MAX_RAYS)
        done = [np.flatnonzero(is_done[row]) for row in row_of]
        if any(len(some) for some in done):
            whole = [paths.take(some) for paths, some in zip(parts, done, strict=True)]
            all_paths = TracedPaths(*(np.concatenate(c) for c in zip(*(w.columns for w in whole), strict=True)))
            row = search.order[all_paths.link]
            found.append(thin_out(all_paths, row, _lambertian_power(search, row, all_paths), int(KEPT_SHARE / limit)))
        found += _second_order(search, rows[is_done[rows]], rays)
        rows, rays = rows[~is_done[rows]], 2 * rays
    return found


def _lambertian_power(search: Search, row: np.ndarray, paths: TracedPaths) -> np.ndarray:
    """Return what paths with one patch contribute if all surfaces scatter alike, by Lambert's law, [1/m^2], shape [P].

    It is dW cos / (pi d^2), with length of the path and angle from the patch to the end that did not launch the ray;
    see `mmw.physics.em.scattering.rough_spreading`.

    Args:
        search: The links.
        row: Link of each path, shape [P].
        paths: The paths.
    """
    every, width = np.arange(len(paths)), paths.kind.shape[1]
    step = np.argmax(paths.kind == DIFFUSE, axis=1)
    is_forward = paths.ray >= 0
    point = np.concatenate([search.links.tx.position[row][:, None], paths.vertex, paths.vertex[:, :1]], axis=1)
    point[every, paths.order + 1] = search.links.rx.position[row]
    way = point[every, np.where(is_forward, step + 2, step)] - point[every, step + 1]
    segment = norm(np.diff(point, axis=1))
    column = np.arange(width + 1)
    is_far = np.where(is_forward[:, None], column > step[:, None], column <= step[:, None])
    distance = np.where(is_far & (column <= paths.order[:, None]), segment, 0.0).sum(axis=1)
    cosine = np.abs(dot(paths.normal[every, step], way)) / norm(way)
    return paths.solid_angle * cosine / (np.pi * distance**2)


def _first_order(search: Search, rows: np.ndarray, rays: int) -> list[TracedPaths]:
    """Return the paths of links with one patch: what the transmitters' rays find, and, with mirrors, the receivers'."""
    config = search.config
    is_balanced, has_mirrors = config.diffuse_error_db is not None, config.specular_reflection and config.max_depth > 1
    links, rank = search.sorted_part(rows, is_reversed=False)
    found = find_patches(search, links, rays, needs_mirror=False)
    if not (is_balanced or has_mirrors):
        return [_of(rank, paths) for paths in found]
    backward, backward_rank = search.sorted_part(rows, is_reversed=True)
    found_back = find_patches(search, backward, rays, needs_mirror=not is_balanced, is_backward=True)
    if is_balanced and has_mirrors:
        place = np.empty(len(search.links), dtype=np.int64)
        place[rank] = np.arange(len(rank))
        place = place[backward_rank]
        found = from_nearer_ends(search, links, backward, place, found, rays)
        found_back = from_nearer_ends(search, backward, links, np.argsort(place), found_back, rays)
    return [_of(rank, paths) for paths in found] + [paths.reverse(backward_rank[paths.link]) for paths in found_back]


def _second_order(search: Search, rows: np.ndarray, rays: int) -> list[TracedPaths]:
    """Return the paths of links with two patches, of the rays of both ends."""
    found = []
    if search.config.diffuse_order < 2 or search.config.max_depth < 2 or not len(rows):
        return found
    for is_reversed in (False, True):
        links, rank = search.sorted_part(rows, is_reversed=is_reversed)
        for part, source, ray, first in first_patches(search, links, rays):
            paths = second_patches(search, links, part, source, ray, first, rays)
            found.append(paths.reverse(rank[paths.link]) if is_reversed else _of(rank, paths))
    return found


def _of(rank: np.ndarray, paths: TracedPaths) -> TracedPaths:
    """Return paths with other numbers of links."""
    return TracedPaths(rank[paths.link].astype(np.int32), *paths.columns[1:])


def find_patches(
    search: Search, links: SortedLinks, rays: int, *, needs_mirror: bool, is_backward: bool = False
) -> list[TracedPaths]:
    """Return the paths with one patch that the rays of one end of the links find, a part that fits into memory at a
    time.

    Args:
        search: Surfaces, depth and interactions.
        links: The links; their sources launch the rays.
        rays: Rays of each source.
        needs_mirror: Select only paths with a mirror between source and patch.
        is_backward: Whether the sources are the receivers. Foliage without a mirror is left to the transmitters' rays:
            where one end meets a crown first, the other may look at it through another one.
    """
    table, config = search.table, search.config
    if config.max_depth < (2 if needs_mirror else 1):
        return []
    depth = config.max_depth if config.specular_reflection or config.refraction else 1
    has_foliage = table.foliage is not None and table.foliage.is_foliage.any()
    far = links.ends.rx.numpy()[:, -1] if config.diffuse_error_db is not None else None
    found = []
    for part in source_parts(links.sources, rays * depth):
        for passes in range(search.pattern_count(depth)):
            hits = trace_rays(search, part, rays, depth, passes, table.scene_struct(search.scene))
            chosen = select_hits(hits, table.is_rough, passes, needs_mirror)
            found += _connect_receivers(search, links, part, hits, chosen, rays, far)
            if has_foliage:  # the rays above passed it
                hits = trace_rays(search, part, rays, depth, passes, search.scene.struct)
                chosen = select_hits(hits, table.is_rough, passes, needs_mirror or is_backward)
                chosen &= meets_leaves(hits, table.foliage)
                found += _connect_receivers(search, links, part, hits, chosen, rays, None)
    return found


def _connect_receivers(
    search: Search,
    links: SortedLinks,
    sources: Sources,
    hits: RayHits,
    chosen: np.ndarray,
    rays: int,
    far: np.ndarray | None,
) -> list[TracedPaths]:
    """Return the paths from the chosen hits to the far ends that see them, a part that fits into memory at a time.

    Args:
        search: Surfaces and depth.
        links: The links.
        sources: Those that launched the rays.
        hits: What the rays hit.
        chosen: Whether each hit scatters, shape [A, R, D].
        rays: Rays of each source.
        far: Far ends [m], shape [L, 3], if their rays count too for patches without mirrors, else None.
    """
    indices = np.nonzero(chosen)
    last = np.cumsum(np.diff(sources.first_link)[indices[0]])
    cuts = np.searchsorted(last, np.arange(ROWS_AT_ONCE, last[-1], ROWS_AT_ONCE)) if len(last) else []
    parts = zip(*(np.split(values, cuts) for values in indices), strict=True)
    return [_connect(search, links, sources, hits, part, rays, far) for part in parts]


def _connect(
    search: Search,
    links: SortedLinks,
    sources: Sources,
    hits: RayHits,
    chosen: tuple[np.ndarray, ...],
    rays: int,
    far: np.ndarray | None,
) -> TracedPaths:
    """Return the paths of some hits, given by source, ray and interaction; the rest as `_connect_receivers`."""
    width = search.config.max_depth
    source, ray, step = chosen
    row, link = far_links(sources, source)
    at = (source[row], ray[row], step[row])
    max_slabs = (width - 1 - step[row]) if search.config.refraction else np.zeros(len(row))
    counts, slabs = connect_patches(search, links, link, hits[1][at], hits[2][at], hits[3][at], max_slabs)
    kept = np.flatnonzero(counts >= 0)
    own, last = (source[row[kept]], ray[row[kept]]), step[row[kept]]
    column = np.arange(width)
    before = np.minimum(column, hits[0].shape[2] - 1)
    behind = np.maximum(column - last[:, None] - 1, 0)
    is_before, is_patch = column < last[:, None], column == last[:, None]
    order = last + 1 + counts[kept]
    is_there = column < order[:, None]

    def along(of_rays: np.ndarray, of_slabs: np.ndarray, nothing: float) -> np.ndarray:
        wide = (...,) + (None,) * (of_rays.ndim - 3)
        first = of_rays[own][:, before]
        behind_it = of_slabs[kept][np.arange(len(kept))[:, None], behind]
        return np.where(is_there[wide], np.where((is_before | is_patch)[wide], first, behind_it), nothing)

    kinds = np.where(is_patch, DIFFUSE, along(hits[0], slabs.kind.numpy(), 0))
    vertex, normal = along(hits[2], slabs.vertex.numpy(), np.nan), along(hits[3], slabs.normal.numpy(), np.nan)
    solid_angle = np.full(len(kept), 4.0 * np.pi / rays)
    if far is not None:
        every = np.arange(len(kept))
        share = _balanced(sources.position[own[0]], far[link[kept]], vertex[every, last], normal[every, last])
        solid_angle *= np.where((kinds == SPECULAR).any(axis=1), 1.0, share)
    return TracedPaths(
        link=link[kept].astype(np.int32),
        order=order.astype(np.int32),
        kind=kinds.astype(np.int32),
        surface=along(hits[1], slabs.surface.numpy(), -1).astype(np.int32),
        vertex=vertex,
        normal=normal,
        ray=ray[row[kept]].astype(np.int32),
        solid_angle=solid_angle,
    )


def _balanced(near: np.ndarray, far: np.ndarray, patch: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return the share of the near end's rays in patches that the rays of both ends find, shape [P].

    Rays of an end at the distance d hit N cos / (4 pi d^2) points of a surface per area, cos from the normal. Weighing
    each ray by its density over the sum of both densities keeps the sum right, and no patch near one of the ends counts
    for more than the rays of that end make it. Arguments have shape [P, 3], in meters but for the unit normal.

    Source: the balance heuristic, E. Veach and L. J. Guibas, "Optimally combining sampling techniques for Monte Carlo
    rendering", SIGGRAPH 1995, equation 8.
    """
    own, other = (np.abs(dot(normal, way)) / norm(way) ** 3 for way in (near - patch, far - patch))
    return own / (own + other)
