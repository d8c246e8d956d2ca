"""Follow the rays of one end of the links to rough surfaces, and choose which of their hits scatter."""

from collections.abc import Iterator

import numpy as np
import warp as wp

from mmw.channel.path_solver.foliage import Foliage
from mmw.channel.path_solver.search import Search, SortedLinks, Sources
from mmw.kernels.channel.scattering import scatter_kernel
from mmw.kernels.core import structs
from mmw.physics.em.interaction import SPECULAR
from mmw.physics.em.vectors import dot

HITS_AT_ONCE = 2**24
"""Maximum number of (source, ray, interaction) rows at once, about 60 bytes each."""

Patches = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Surface [B], point [m] and unit normal [B, 3] of patches."""

RayHits = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Kind, surface [A, R, D], point and normal [A, R, D, 3] of what rays hit; surface -1 behind the last."""


def trace_rays(search: Search, sources: Sources, rays: int, depth: int, passes: int, struct: structs.Scene) -> RayHits:
    """Return what the rays of sources hit, with mirrors or slabs between.

    Args:
        search: Surfaces, and whether they reflect.
        sources: The sources.
        rays: Rays of each.
        depth: Hits of a ray.
        passes: Bit k is set if a ray goes through its k-th surface, instead of reflecting there.
        struct: The scene, with or without foliage.
    """
    scene, config = search.scene, search.config
    device, shape = scene.device, (len(sources), rays, depth)
    kind = wp.zeros(shape, dtype=wp.int32, device=device)
    surface = wp.full(shape, structs.MISS_ID, dtype=wp.int32, device=device)
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
            rays,
            int(config.specular_reflection),
            passes,
        ],
        outputs=[kind, surface, point, normal],
        device=device,
        block_dim=64,
    )
    return kind.numpy(), surface.numpy(), point.numpy(), normal.numpy()


def select_hits(hits: RayHits, is_rough: np.ndarray, passes: int, needs_mirror: bool) -> np.ndarray:
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


def meets_leaves(hits: RayHits, foliage: Foliage) -> np.ndarray:
    """Return which hits are the first of their ray on foliage, and on its outer side, shape [A, R, D], bool."""
    surface, normal = hits[1], hits[3]
    is_leafy = (surface >= 0) & foliage.is_foliage[np.maximum(surface, 0)]
    is_first = np.cumsum(is_leafy, axis=2) == 1
    is_outer = dot(normal, foliage.outward[np.maximum(surface, 0)]) >= 0.0
    return is_leafy & is_first & is_outer


def source_parts(sources: Sources, hits_of_source: int) -> Iterator[Sources]:
    """Yield parts of the sources whose hits fit into memory."""
    step = max(1, HITS_AT_ONCE // hits_of_source)
    for begin in range(0, len(sources), step):
        yield sources.part(begin, min(begin + step, len(sources)))


def first_patches(
    search: Search, links: SortedLinks, rays: int
) -> Iterator[tuple[Sources, np.ndarray, np.ndarray, Patches]]:
    """Yield parts of the sources, and the rough surfaces that their rays hit first: source, ray and patches.

    Args:
        search: Surfaces.
        links: The links; their sources launch the rays. Rays pass foliage.
        rays: Rays of each source.
    """
    for part in source_parts(links.sources, rays):
        hits = trace_rays(search, part, rays, 1, 0, search.table.scene_struct(search.scene))
        scatters = select_hits(hits, search.table.is_rough, passes=0, needs_mirror=False)
        source, ray, _ = np.nonzero(scatters)
        surface, point, normal = (values[source, ray, 0] for values in hits[1:])
        yield part, source, ray, (surface, point, normal)
