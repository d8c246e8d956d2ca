"""Trace diffuse paths: one rough patch a path, with mirrors before or behind it, and slabs anywhere.

Rays of the transmitter reflect from surface to surface; every rough surface that they hit scatters straight to the
receivers. Rays of the receivers do the same backward, for paths with mirrors behind the patch. Foliage that waves pass
scatters where a ray, with its mirrors, meets it first from outside.
"""

import numpy as np
import warp as wp

from mmw.channel.path_solver.foliage import Foliage
from mmw.channel.path_solver.search import Search, SortedLinks, Sources
from mmw.channel.path_solver.traced_paths import TracedPaths, make_hit_buffers
from mmw.kernels.channel.scattering import connect_kernel, scatter_kernel
from mmw.kernels.core import structs
from mmw.physics.em.interaction import DIFFUSE, SPECULAR
from mmw.physics.em.vectors import dot

HITS_AT_ONCE = 2**24
"""Maximum number of (source, ray, interaction) rows at once, about 60 bytes each."""


def find_patches(search: Search, links: SortedLinks, *, needs_mirror: bool) -> list[TracedPaths]:
    """Return the diffuse paths that the rays of one end of the links find, a part that fits into memory at a time.

    Args:
        search: Surfaces, rays, depth and interactions.
        links: The links; their sources launch the rays.
        needs_mirror: Select only paths with a mirror between source and patch.
    """
    table, config = search.table, search.config
    if not table.is_rough.any() or config.max_depth < (2 if needs_mirror else 1):
        return []
    depth = config.max_depth if config.specular_reflection or config.refraction else 1
    patterns = 2 ** (depth - 1) if config.refraction and table.is_slab.any() else 1
    step = max(1, HITS_AT_ONCE // (config.diffuse_samples * depth))
    found = []
    for begin in range(0, len(links.sources), step):
        part = links.sources.part(begin, min(begin + step, len(links.sources)))
        for passes in range(patterns):
            hits = _trace_rays(search, part, depth, passes, table.scene_struct(search.scene))
            chosen = _select_hits(hits, table.is_rough, passes, needs_mirror)
            found.append(_connect_receivers(search, links, part, hits, np.nonzero(chosen)))
            if table.foliage is not None and table.foliage.is_foliage.any():  # the rays above passed it
                hits = _trace_rays(search, part, depth, passes, search.scene.struct)
                chosen = _select_hits(hits, table.is_rough, passes, needs_mirror) & _meets_leaves(hits, table.foliage)
                found.append(_connect_receivers(search, links, part, hits, np.nonzero(chosen)))
    return found


RayHits = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Kind, surface [A, R, D], point and normal [A, R, D, 3] of what rays hit; surface -1 behind the last."""


def _trace_rays(search: Search, sources: Sources, depth: int, passes: int, struct: structs.Scene) -> RayHits:
    scene, config = search.scene, search.config
    device, shape = scene.device, (len(sources), config.diffuse_samples, depth)
    kind, surface = (wp.zeros(shape, dtype=wp.int32, device=device) for _ in range(2))
    point, normal = (wp.zeros(shape, dtype=wp.vec3d, device=device) for _ in range(2))
    wp.launch(
        scatter_kernel,
        dim=shape[:2],
        inputs=[
            struct,
            search.table.device,
            search.pose,
            wp.vec3d(*scene.origin),
            wp.array(sources.batch_index, dtype=wp.int32, device=device),
            wp.array(sources.position, dtype=wp.vec3d, device=device),
            config.diffuse_samples,
            int(config.specular_reflection),
            passes,
        ],
        outputs=[kind, surface, point, normal],
        device=device,
        block_dim=64,
    )
    return kind.numpy(), surface.numpy(), point.numpy(), normal.numpy()


def _select_hits(hits: RayHits, is_rough: np.ndarray, passes: int, needs_mirror: bool) -> np.ndarray:
    """Return which hits scatter, by source, ray and interaction, shape [A, R, D], bool.

    A hit before the last slab of `passes` is hit with fewer slabs too, and counts there.
    """
    kind, surface = hits[:2]
    scatters = (surface >= 0) & is_rough[np.maximum(surface, 0)]
    scatters[:, :, : passes.bit_length()] = False
    if needs_mirror:
        mirrors = np.cumsum(kind == SPECULAR, axis=2)
        scatters[:, :, 0] = False
        scatters[:, :, 1:] &= mirrors[:, :, :-1] > 0
    return scatters


def _meets_leaves(hits: RayHits, foliage: Foliage) -> np.ndarray:
    """Return which hits are the first of their ray on foliage, and on its outer side, shape [A, R, D], bool."""
    surface, normal = hits[1], hits[3]
    is_leafy = (surface >= 0) & foliage.is_foliage[np.maximum(surface, 0)]
    is_first = np.cumsum(is_leafy, axis=2) == 1
    is_outer = dot(normal, foliage.outward[np.maximum(surface, 0)]) >= 0.0
    return is_leafy & is_first & is_outer


def _connect_receivers(
    search: Search, links: SortedLinks, sources: Sources, hits: RayHits, chosen: tuple[np.ndarray, ...]
) -> TracedPaths:
    """Return the paths from the chosen hits to the far ends that see them."""
    scene, config = search.scene, search.config
    device, width = scene.device, config.max_depth
    source, ray, step = chosen
    count = np.diff(sources.first_link)[source]
    row = np.repeat(np.arange(len(source)), count)
    link = sources.first_link[:-1][source[row]] + np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    at = (source[row], ray[row], step[row])
    max_slabs = (width - 1 - step[row]) if config.refraction else np.zeros(len(row))
    passed = wp.empty(len(row), dtype=wp.int32, device=device)
    slabs = make_hit_buffers((len(row), width), device)
    wp.launch(
        connect_kernel,
        dim=len(row),
        inputs=[
            search.table.scene_struct(scene),
            links.ends,
            search.table.device,
            search.pose,
            wp.vec3d(*scene.origin),
            wp.array(link, dtype=wp.int32, device=device),
            *(
                wp.array(h[at], dtype=t, device=device)
                for h, t in zip(hits[1:], (wp.int32, wp.vec3d, wp.vec3d), strict=True)
            ),
            wp.array(max_slabs, dtype=wp.int32, device=device),
        ],
        outputs=[passed, slabs],
        device=device,
        block_dim=64,
    )
    counts = passed.numpy()
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
    return TracedPaths(
        link=link[kept].astype(np.int32),
        order=order.astype(np.int32),
        kind=kinds.astype(np.int32),
        surface=along(hits[1], slabs.surface.numpy(), -1).astype(np.int32),
        vertex=along(hits[2], slabs.vertex.numpy(), np.nan),
        normal=along(hits[3], slabs.normal.numpy(), np.nan),
        ray=ray[row[kept]].astype(np.int32),
    )
