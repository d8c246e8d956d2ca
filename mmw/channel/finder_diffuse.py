"""Geometry of diffuse paths: a ray that a rough surface scatters, after mirrors or none, straight to the receiver."""

import numpy as np
import warp as wp

from mmw.channel.candidates import Sources
from mmw.channel.paths import DIFFUSE, SPECULAR
from mmw.channel.surface_table import SurfaceTable
from mmw.config import ChannelConfig
from mmw.kernels.channel_scatter import connect_kernel, scatter_kernel
from mmw.kernels.channel_surfaces import LinkEnds
from mmw.scene import Scene

HITS_AT_ONCE = 2**24
"""Most (source, ray, interaction) rows at once, about 56 bytes each."""

Found = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def find_diffuse(
    scene: Scene, ends: LinkEnds, pose: wp.array, sources: Sources, table: SurfaceTable, config: ChannelConfig
) -> list[Found]:
    """Return the diffuse paths of a batch.

    Each of `channel.diffuse_rays` rays goes from mirror to mirror; every rough surface that it meets on the way
    scatters to every receiver that sees the patch.

    Args:
        scene: The scene with the batch loaded.
        ends: Ends of the links, sorted by source.
        pose: Instance-to-world poses on the device, shape [S, V].
        sources: The transmitters.
        table: Surfaces of the scene.
        config: Rays, depth, and whether there are mirrors on the way.

    Returns:
        Parts of (link, order, kind [., D], surface [., D], vertex [., D, 3], normal [., D, 3], ray); links still count
        in the order of the sources.
    """
    depth = config.max_depth if config.specular else 1
    is_rough = _rough_surfaces(scene, table)
    if not is_rough.any() or config.max_depth == 0:
        return []
    found = []
    step = max(1, HITS_AT_ONCE // (config.diffuse_rays * depth))
    for begin in range(0, len(sources), step):
        part = sources.part(begin, min(begin + step, len(sources)))
        found.append(_scatter(scene, ends, pose, part, table, is_rough, config, depth))
    return found


def _rough_surfaces(scene: Scene, table: SurfaceTable) -> np.ndarray:
    """Return which surfaces scatter in some weather, shape [G], bool."""
    by_weather = [[m.radio.scattering > 0.0 for m in some] for some in scene.arrays.materials.values()]
    if not by_weather or not by_weather[0]:
        return np.zeros(len(table), dtype=bool)
    return np.any(by_weather, axis=0)[table.material_id]


def _scatter(
    scene: Scene,
    ends: LinkEnds,
    pose: wp.array,
    sources: Sources,
    table: SurfaceTable,
    is_rough: np.ndarray,
    config: ChannelConfig,
    depth: int,
) -> Found:
    device, shape = scene.device, (len(sources), config.diffuse_rays, depth)
    surface = wp.empty(shape, dtype=wp.int32, device=device)
    point, normal = (wp.empty(shape, dtype=wp.vec3d, device=device) for _ in range(2))
    wp.launch(
        scatter_kernel,
        dim=shape[:2],
        inputs=[
            scene.struct,
            table.device,
            pose,
            wp.vec3d(*scene.origin),
            wp.array(sources.slot, dtype=wp.int32, device=device),
            wp.array(sources.position, dtype=wp.vec3d, device=device),
            config.diffuse_rays,
        ],
        outputs=[surface, point, normal],
        device=device,
        block_dim=64,
    )
    surfaces, points, normals = surface.numpy(), point.numpy(), normal.numpy()
    source, ray, step = np.nonzero((surfaces >= 0) & is_rough[np.maximum(surfaces, 0)])
    links = np.diff(sources.first_link)[source]
    row = np.repeat(np.arange(len(source)), links)
    number = np.arange(len(row)) - np.repeat(np.cumsum(links) - links, links)
    link = (sources.first_link[:-1][source[row]] + number).astype(np.int32)
    at = (source[row], ray[row], step[row])
    is_seen = wp.empty(len(row), dtype=wp.uint8, device=device)
    wp.launch(
        connect_kernel,
        dim=len(row),
        inputs=[
            scene.struct,
            ends,
            table.device,
            pose,
            wp.vec3d(*scene.origin),
            wp.array(link, dtype=wp.int32, device=device),
            wp.array(surfaces[at], dtype=wp.int32, device=device),
            wp.array(points[at], dtype=wp.vec3d, device=device),
            wp.array(normals[at], dtype=wp.vec3d, device=device),
            wp.empty((1, 1), dtype=wp.int32, device=device),
            wp.empty((1, 1), dtype=wp.vec3d, device=device),
        ],
        outputs=[is_seen],
        device=device,
        block_dim=64,
    )
    kept = np.flatnonzero(is_seen.numpy())
    order = step[row[kept]] + 1
    own = (source[row[kept]], ray[row[kept]])
    column = np.arange(max(1, config.max_depth))
    used = np.minimum(column, depth - 1)
    is_there = column < order[:, None]
    kind = np.where(column == order[:, None] - 1, DIFFUSE, SPECULAR)
    return (
        link[kept],
        order.astype(np.int32),
        np.where(is_there, kind, 0).astype(np.int32),
        np.where(is_there, surfaces[own][:, used], -1).astype(np.int32),
        np.where(is_there[..., None], points[own][:, used], np.nan),
        np.where(is_there[..., None], normals[own][:, used], np.nan),
        ray[row[kept]].astype(np.int32),
    )
