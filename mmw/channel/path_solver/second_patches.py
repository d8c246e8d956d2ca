"""Trace paths with two rough patches: each patch that a ray hits sends one ray on, and what that hits scatters too.

There are no mirrors and slabs on such paths, and foliage does not scatter on them.
"""

import numpy as np
import warp as wp

from mmw.channel.path_solver.patch_links import connect_patches, far_links
from mmw.channel.path_solver.patch_rays import Patches
from mmw.channel.path_solver.search import Search, SortedLinks, Sources
from mmw.channel.path_solver.traced_paths import TracedPaths
from mmw.kernels.channel.scattering import second_patch_kernel
from mmw.physics.em.interaction import DIFFUSE
from mmw.physics.em.vectors import dot, norm


def second_patches(
    search: Search,
    links: SortedLinks,
    sources: Sources,
    source: np.ndarray,
    ray: np.ndarray,
    first: Patches,
    rays: int,
) -> TracedPaths:
    """Return the paths over two patches.

    The solid angle of a path is that of the ray of its source, 4 pi / N, times that of the ray between the patches, 2
    pi, times the share of these rays among those of both ends.

    Args:
        search: Surfaces.
        links: The links; rays come from their sources.
        sources: A part of the sources.
        source: Source of each first patch, shape [B].
        ray: Ray that hit it, shape [B].
        first: First patches.
        rays: Rays of each source.
    """
    surface, point, normal = _next_patches(search, sources.batch_index[source], ray, first)
    hit = np.flatnonzero((surface >= 0) & search.table.is_rough[np.maximum(surface, 0)])
    row, link = far_links(sources, source[hit])
    row = hit[row]
    second = surface[row], point[row], normal[row]
    counts, _ = connect_patches(search, links, link, *second, np.zeros(len(row)))
    kept = np.flatnonzero(counts == 0)
    row, link = row[kept], link[kept]
    pair = [(one[row], two[kept]) for one, two in zip(first, second, strict=True)]
    far = links.ends.rx.numpy()[:, -1]
    share = _balanced(sources.position[source[row]], far[link], *pair[1:])
    width = search.config.max_depth

    def columns(values: tuple[np.ndarray, np.ndarray], nothing: float) -> np.ndarray:
        out = np.full((len(row), width, *values[0].shape[1:]), nothing, dtype=values[0].dtype)
        out[:, 0], out[:, 1] = values
        return out

    kinds = np.full(len(row), DIFFUSE, dtype=np.int32)
    return TracedPaths(
        link=link.astype(np.int32),
        order=np.full(len(row), 2, dtype=np.int32),
        kind=columns((kinds, kinds), 0),
        surface=columns(pair[0], -1).astype(np.int32),
        vertex=columns(pair[1], np.nan),
        normal=columns(pair[2], np.nan),
        ray=ray[row].astype(np.int32),
        solid_angle=4.0 * np.pi / rays * 2.0 * np.pi * share,
    )


def _next_patches(search: Search, batch_index: np.ndarray, ray: np.ndarray, first: Patches) -> Patches:
    """Return what the ray of each patch hits; surface -1 for nothing."""
    scene, device = search.scene, search.scene.device
    surface = wp.empty(len(ray), dtype=wp.int32, device=device)
    point, normal = (wp.empty(len(ray), dtype=wp.vec3d, device=device) for _ in range(2))
    given = ((batch_index, wp.int32), (ray, wp.int32), (first[1], wp.vec3d), (first[2], wp.vec3d))
    wp.launch(
        second_patch_kernel,
        dim=len(ray),
        inputs=[
            search.table.scene_struct(scene),
            search.table.device,
            search.pose,
            wp.vec3d(*scene.origin),
            *(wp.array(values, dtype=kind, device=device) for values, kind in given),
        ],
        outputs=[surface, point, normal],
        device=device,
        block_dim=64,
    )
    return surface.numpy(), point.numpy(), normal.numpy()


def _balanced(
    near: np.ndarray,
    far: np.ndarray,
    points: tuple[np.ndarray, np.ndarray],
    normals: tuple[np.ndarray, np.ndarray],
) -> np.ndarray:
    """Return the share of the near end's rays among those of both ends that find the same two patches, shape [P].

    As for one patch (`scatter_paths`), with the densities of pairs of points: that of the near end's rays on the first
    patch times that of the rays between the patches on the second, cos / (2 pi r^2), of which r is the same for both.
    """
    between = points[1] - points[0]
    own, other = (
        np.abs(dot(normals[k], end - points[k])) / norm(end - points[k]) ** 3 * np.abs(dot(normals[1 - k], between))
        for k, end in enumerate((near, far))
    )
    return own / (own + other)
