"""Trace diffuse paths with mirrors from the end whose rays are denser on the patch.

Rays of one end, the source, reflect at mirrors and then hit a patch. Where the rays of the other end, the far one, are
denser on that patch, these count alone, and reach the source over the mirrors by its image. Every patch is found from
one of both ends, so no power is counted twice: the maximum heuristic of E. Veach and L. J. Guibas, "Optimally combining
sampling techniques for Monte Carlo rendering", SIGGRAPH 1995, section 3.3.
"""

import numpy as np
import warp as wp

from mmw.channel.path_solver.patch_rays import Patches, first_patches
from mmw.channel.path_solver.search import Search, SortedLinks
from mmw.channel.path_solver.traced_paths import TracedPaths, make_hit_buffers
from mmw.kernels.channel.scattering import mirror_kernel
from mmw.kernels.channel.segments import HitBuffers
from mmw.physics.em.interaction import DIFFUSE, SPECULAR
from mmw.physics.em.vectors import dot, norm

PAIRS_AT_ONCE = 2**22
"""Maximum number of (mirrors, patch) pairs at once, about 200 bytes each."""


def from_nearer_ends(
    search: Search, links: SortedLinks, reversed_links: SortedLinks, place: np.ndarray, paths: list[TracedPaths],
    rays: int,
) -> list[TracedPaths]:  # fmt: skip
    """Return paths of the rays of the sources, without those whose patches the other ends see better, and theirs.

    Only paths of mirrors and then one patch are concerned, and the sequences of mirrors that some of them has.

    Args:
        search: Surfaces.
        links: The links; their sources are one end.
        reversed_links: The same links from the other end.
        place: Row among `links` of each of `reversed_links`, shape [L].
        paths: Paths of the rays of the sources.
        rays: Rays of each end.
    """
    near, far = (values.numpy()[:, -1] for values in (links.ends.tx, links.ends.rx))
    kept, chains = [], []
    for own in paths:
        last, is_concerned = own.order - 1, _is_mirrored(search, own)
        rows = np.flatnonzero(is_concerned)
        image = _images(own.take(rows), near[own.link[rows]])
        patch, normal = own.vertex[rows, last[rows]], own.normal[rows, last[rows]]
        is_beaten = np.zeros(len(own), dtype=bool)
        is_beaten[rows] = _density(normal, far[own.link[rows]] - patch) > _density(normal, image - patch)
        kept.append(own.take(np.flatnonzero(~is_beaten)))
        chains.append(np.column_stack([own.link[rows], _planes(search, own.take(rows)), image]))
    every = np.concatenate(chains)
    width = search.config.max_depth
    _, first = np.unique(every[:, : 1 + width], axis=0, return_index=True)
    every = every[first]
    chain = every[:, 0].astype(np.int64), every[:, 1 : 1 + width].astype(np.int32), every[:, 1 + width :]
    source_of = np.empty(len(place), dtype=np.int64)
    source_of[place] = np.repeat(np.arange(len(reversed_links.sources)), np.diff(reversed_links.sources.first_link))
    begin = 0
    for part, source, ray, patches in first_patches(search, reversed_links, rays):
        at = source_of[chain[0]] - begin
        begin += len(part)
        kept += _mirrored(search, links, chain, at, (source, ray, patches), len(part), far, rays)
    return kept


def _is_mirrored(search: Search, paths: TracedPaths) -> np.ndarray:
    """Return which paths have mirrors, then a patch that is no foliage, and nothing else, shape [P]."""
    column, last = np.arange(paths.kind.shape[1]), paths.order[:, None] - 1
    is_chain = ((paths.kind == np.where(column == last, DIFFUSE, SPECULAR)) | (column > last)).all(axis=1)
    is_chain &= paths.order > 1
    if search.table.foliage is not None:
        is_chain &= ~search.table.foliage.is_foliage[paths.surface[np.arange(len(paths)), last[:, 0]]]
    return is_chain


def _images(paths: TracedPaths, near: np.ndarray) -> np.ndarray:
    """Return the images of near ends behind all mirrors of paths [m], shape [P, 3]."""
    image = near.copy()
    for k in range(paths.kind.shape[1]):
        rows = np.flatnonzero(paths.kind[:, k] == SPECULAR)
        normal = paths.normal[rows, k]
        image[rows] -= 2.0 * dot(image[rows] - paths.vertex[rows, k], normal)[:, None] * normal
    return image


def _planes(search: Search, paths: TracedPaths) -> np.ndarray:
    """Return the plane of each mirror, -1 behind the last, shape [P, D]."""
    is_mirror = paths.kind == SPECULAR
    return np.where(is_mirror, search.table.plane[np.where(is_mirror, paths.surface, 0)], -1)


def _density(normal: np.ndarray, way: np.ndarray) -> np.ndarray:
    """Return the density of rays on patches from ends at `way` [m], up to a factor, shape [P]; 0 from behind."""
    return np.maximum(dot(normal, way), 0.0) / norm(way) ** 3


def _mirrored(
    search: Search, links: SortedLinks, chain: tuple[np.ndarray, np.ndarray, np.ndarray], at: np.ndarray,
    hits: tuple[np.ndarray, np.ndarray, Patches], sources: int, far: np.ndarray, rays: int,
) -> list[TracedPaths]:  # fmt: skip
    """Return paths of patches that the other ends hit, over the mirrors of chains.

    Args:
        search: Surfaces.
        links: The links.
        chain: Link [S], planes [S, D] and image of the source [S, 3] of each chain.
        at: Other end of each chain among those that hit the patches, shape [S].
        hits: Other end, ray and patch of each hit, in the order of the ends.
        sources: Number of these ends.
        far: The other end of each link [m], shape [L, 3].
        rays: Rays of each end.
    """
    source, ray, (surface, point, normal) = hits
    first = np.searchsorted(source, np.arange(sources + 1))
    is_there = (at >= 0) & (at < sources)
    count = np.where(is_there, np.diff(first)[np.where(is_there, at, 0)], 0)
    found = []
    cuts = np.searchsorted(np.cumsum(count), np.arange(PAIRS_AT_ONCE, count.sum(), PAIRS_AT_ONCE))
    for own in np.split(np.arange(len(at)), cuts):
        row = np.repeat(own, count[own])
        begin = np.repeat(np.cumsum(count[own]) - count[own], count[own])
        hit = first[:-1][at[row]] + np.arange(len(row)) - begin
        to_image, to_far = chain[2][row] - point[hit], far[chain[0][row]] - point[hit]
        better = np.flatnonzero(
            (dot(normal[hit], to_image) > 0.0) & (_density(normal[hit], to_far) > _density(normal[hit], to_image))
        )
        row, hit = row[better], hit[better]
        seen, mirrors = _follow(search, links, chain, row, point[hit], normal[hit])
        found.append(_as_paths(chain, row[seen], hit[seen], mirrors, seen, (ray, surface, point, normal), rays))
    return found


def _follow(
    search: Search, links: SortedLinks, chain: tuple[np.ndarray, np.ndarray, np.ndarray], row: np.ndarray,
    point: np.ndarray, normal: np.ndarray,
) -> tuple[np.ndarray, HitBuffers]:  # fmt: skip
    """Return which patches see the sources over the mirrors, and these."""
    scene, device = search.scene, search.scene.device
    is_seen = wp.empty(len(row), dtype=wp.int32, device=device)
    mirrors = make_hit_buffers((len(row), search.config.max_depth), device)
    given = ((chain[0][row], wp.int32), (point, wp.vec3d), (normal, wp.vec3d), (chain[2][row], wp.vec3d))
    wp.launch(
        mirror_kernel,
        dim=len(row),
        inputs=[
            search.table.scene_struct(scene),
            links.ends,
            search.table.device,
            search.pose,
            wp.vec3d(*scene.origin),
            *(wp.array(values, dtype=kind, device=device) for values, kind in given),
            wp.array(chain[1][row], dtype=wp.int32, ndim=2, device=device),
        ],
        outputs=[is_seen, mirrors],
        device=device,
        block_dim=64,
    )
    return np.flatnonzero(is_seen.numpy()), mirrors


def _as_paths(
    chain: tuple[np.ndarray, np.ndarray, np.ndarray], row: np.ndarray, hit: np.ndarray, mirrors: HitBuffers,
    seen: np.ndarray, patches: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray], rays: int,
) -> TracedPaths:  # fmt: skip
    """Return the mirrors of chains and the patches behind them as paths of the other ends' rays."""
    ray, surface, point, normal = patches
    last = (chain[1][row] >= 0).sum(axis=1)
    column = np.arange(chain[1].shape[1])
    is_patch, is_there = column == last[:, None], column <= last[:, None]

    def along(of_mirrors: np.ndarray, of_patch: np.ndarray | int, nothing: float) -> np.ndarray:
        wide = (...,) + (None,) * (of_mirrors.ndim - 2)
        own = of_patch[hit][:, None] if isinstance(of_patch, np.ndarray) else of_patch
        return np.where(is_there[wide], np.where(is_patch[wide], own, of_mirrors[seen]), nothing)

    return TracedPaths(
        link=chain[0][row].astype(np.int32),
        order=(last + 1).astype(np.int32),
        kind=along(mirrors.kind.numpy(), DIFFUSE, 0).astype(np.int32),
        surface=along(mirrors.surface.numpy(), surface, -1).astype(np.int32),
        vertex=along(mirrors.vertex.numpy(), point, np.nan),
        normal=along(mirrors.normal.numpy(), normal, np.nan),
        ray=-2 - ray[hit].astype(np.int32),
        solid_angle=np.full(len(row), 4.0 * np.pi / rays),
    )
