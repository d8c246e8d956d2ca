"""Connect rough patches, which rays of one end of the links found, with the other ends."""

import numpy as np
import warp as wp

from mmw.channel.path_solver.search import Search, SortedLinks, Sources
from mmw.channel.path_solver.traced_paths import make_hit_buffers
from mmw.kernels.channel.scattering import connect_kernel
from mmw.kernels.channel.segments import HitBuffers


def far_links(sources: Sources, source: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return every patch with every link of its source: row of the patch and link, shape [B] each.

    Args:
        sources: The sources.
        source: Source of each patch, an index into them, shape [R].
    """
    count = np.diff(sources.first_link)[source]
    row = np.repeat(np.arange(len(source)), count)
    link = sources.first_link[:-1][source[row]] + np.arange(len(row)) - np.repeat(np.cumsum(count) - count, count)
    return row, link


def connect_patches(
    search: Search,
    links: SortedLinks,
    link: np.ndarray,
    surface: np.ndarray,
    point: np.ndarray,
    normal: np.ndarray,
    max_slabs: np.ndarray,
) -> tuple[np.ndarray, HitBuffers]:
    """Return how many slabs are between patches and the far ends of their links, -1 where these do not see them.

    Args:
        search: Surfaces and depth.
        links: The links.
        link: Link of each row, shape [B].
        surface: Surface of each patch, shape [B].
        point: The patches [m], shape [B, 3].
        normal: Unit normals on the side that scatters, shape [B, 3].
        max_slabs: The most slabs in between, shape [B].

    Returns:
        Shape [B]; and the slabs, from the patch on, shape [B, D].
    """
    scene = search.scene
    passed = wp.empty(len(link), dtype=wp.int32, device=scene.device)
    slabs = make_hit_buffers((len(link), search.config.max_depth), scene.device)
    given = ((link, wp.int32), (surface, wp.int32), (point, wp.vec3d), (normal, wp.vec3d), (max_slabs, wp.int32))
    wp.launch(
        connect_kernel,
        dim=len(link),
        inputs=[
            search.table.scene_struct(scene),
            links.ends,
            search.table.device,
            search.pose,
            wp.vec3d(*scene.origin),
            *(wp.array(values, dtype=kind, device=scene.device) for values, kind in given),
        ],
        outputs=[passed, slabs],
        device=scene.device,
        block_dim=64,
    )
    return passed.numpy(), slabs
