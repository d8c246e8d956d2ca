"""Geometry of diffuse paths: one rough patch a path, with mirrors before or behind it, and slabs anywhere.

Rays of the transmitter reflect from surface to surface; every rough surface that they hit scatters straight to the
receivers. Rays of the receivers do the same backward, for paths with mirrors behind the patch.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.channel.path_solver.candidates import Sources
from mmw.channel.path_solver.hit_buffers import make_hit_buffers
from mmw.channel.path_solver.surface_table import SurfaceTable
from mmw.config import ChannelConfig
from mmw.kernels.channel.scattering import connect_kernel, scatter_kernel
from mmw.kernels.channel.surfaces import LinkEnds
from mmw.physics.em.interaction import DIFFUSE, SPECULAR, TRANSMISSION
from mmw.scene.device_scene import DeviceScene

HITS_AT_ONCE = 2**24
"""Most (source, ray, interaction) rows at once, about 60 bytes each."""


@dataclass(frozen=True)
class ScatteringPatches:
    """Paths over rough patches, from the end whose rays hit them: B of them, D interactions at most."""

    link: np.ndarray
    """Link, in the order of the sources, shape [B], int32."""
    order: np.ndarray
    """Interactions, shape [B], int32."""
    kind: np.ndarray
    """Kind of each interaction, 0 behind the last, shape [B, D], int32."""
    surface: np.ndarray
    """Surface of each interaction, -1 behind the last, shape [B, D], int32."""
    vertex: np.ndarray
    """Shape [B, D, 3], NaN behind the last."""
    normal: np.ndarray
    """Turned to where the rays came from, shape [B, D, 3], NaN behind the last."""
    ray: np.ndarray
    """Number of the ray, shape [B], int32."""

    def turned(self) -> "ScatteringPatches":
        """Return the same paths from the other end; the normal of a patch looks to both ends, as a mirror's does."""
        column = self.order[:, None] - 1 - np.arange(self.kind.shape[1])
        is_there, column = column >= 0, np.maximum(column, 0)
        rows = np.arange(len(self.link))[:, None]
        kind = np.where(is_there, self.kind[rows, column], 0)
        normal = self.normal[rows, column] * np.where(kind == TRANSMISSION, -1.0, 1.0)[..., None]
        gap = is_there[..., None]
        return ScatteringPatches(
            self.link,
            self.order,
            kind,
            np.where(is_there, self.surface[rows, column], -1),
            np.where(gap, self.vertex[rows, column], np.nan),
            np.where(gap, normal, np.nan),
            self.ray,
        )


def find_patches(
    scene: DeviceScene,
    ends: LinkEnds,
    pose: wp.array,
    sources: Sources,
    table: SurfaceTable,
    config: ChannelConfig,
    *,
    needs_mirror: bool,
) -> list[ScatteringPatches]:
    """Return the diffuse paths that the rays of one end of the links find, a part that fits into memory at a time.

    Args:
        scene: The scene with the batch loaded.
        ends: Ends of the links, sorted by source; `tx` are the sources.
        pose: Instance-to-world poses on the device, shape [S, V].
        sources: Where the rays start.
        table: Surfaces of the scene.
        config: Rays, depth, and what there is on the way.
        needs_mirror: Keep only paths with a mirror between source and patch.
    """
    is_rough = _rough_surfaces(scene, table)
    if not is_rough.any() or config.max_depth < (2 if needs_mirror else 1):
        return []
    depth = config.max_depth if config.specular or config.refraction else 1
    patterns = 2 ** (depth - 1) if config.refraction and table.is_open.any() else 1
    step = max(1, HITS_AT_ONCE // (config.diffuse_rays * depth))
    found = []
    for begin in range(0, len(sources), step):
        part = sources.part(begin, min(begin + step, len(sources)))
        for passes in range(patterns):
            hits = _follow(scene, pose, part, table, config, depth, passes)
            chosen = _chosen(hits, is_rough, passes, needs_mirror)
            found.append(_connect(scene, ends, pose, part, table, config, hits, chosen))
    return found


def _rough_surfaces(scene: DeviceScene, table: SurfaceTable) -> np.ndarray:
    """Return which surfaces scatter in some weather, shape [G], bool."""
    by_weather = [[m.radio.scattering > 0.0 for m in some] for some in scene.arrays.materials.values()]
    if not by_weather or not by_weather[0]:
        return np.zeros(len(table), dtype=bool)
    return np.any(by_weather, axis=0)[table.material_id]


Hits = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Kind, surface [A, R, D], point and normal [A, R, D, 3] of what rays hit; surface -1 behind the last."""


def _follow(
    scene: DeviceScene,
    pose: wp.array,
    sources: Sources,
    table: SurfaceTable,
    config: ChannelConfig,
    depth: int,
    passes: int,
) -> Hits:
    device, shape = scene.device, (len(sources), config.diffuse_rays, depth)
    kind, surface = (wp.zeros(shape, dtype=wp.int32, device=device) for _ in range(2))
    point, normal = (wp.zeros(shape, dtype=wp.vec3d, device=device) for _ in range(2))
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
            int(config.specular),
            passes,
        ],
        outputs=[kind, surface, point, normal],
        device=device,
        block_dim=64,
    )
    return kind.numpy(), surface.numpy(), point.numpy(), normal.numpy()


def _chosen(hits: Hits, is_rough: np.ndarray, passes: int, needs_mirror: bool) -> tuple[np.ndarray, ...]:
    """Return source, ray and interaction of the hits that scatter.

    A hit before the last slab of `passes` is hit with fewer slabs too, and counts there.
    """
    kind, surface = hits[:2]
    scatters = (surface >= 0) & is_rough[np.maximum(surface, 0)]
    scatters[:, :, : passes.bit_length()] = False
    if needs_mirror:
        mirrors = np.cumsum(kind == SPECULAR, axis=2)
        scatters[:, :, 0] = False
        scatters[:, :, 1:] &= mirrors[:, :, :-1] > 0
    return np.nonzero(scatters)


def _connect(
    scene: DeviceScene,
    ends: LinkEnds,
    pose: wp.array,
    sources: Sources,
    table: SurfaceTable,
    config: ChannelConfig,
    hits: Hits,
    chosen: tuple[np.ndarray, ...],
) -> ScatteringPatches:
    """Return the paths from the chosen hits to the far ends that see them."""
    device, width = scene.device, config.max_depth
    source, ray, step = chosen
    links = np.diff(sources.first_link)[source]
    row = np.repeat(np.arange(len(source)), links)
    link = sources.first_link[:-1][source[row]] + np.arange(len(row)) - np.repeat(np.cumsum(links) - links, links)
    at = (source[row], ray[row], step[row])
    room = (width - 1 - step[row]) if config.refraction else np.zeros(len(row))
    count = wp.empty(len(row), dtype=wp.int32, device=device)
    met = make_hit_buffers((len(row), width), device)
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
            *(
                wp.array(h[at], dtype=t, device=device)
                for h, t in zip(hits[1:], (wp.int32, wp.vec3d, wp.vec3d), strict=True)
            ),
            wp.array(room, dtype=wp.int32, device=device),
        ],
        outputs=[count, met],
        device=device,
        block_dim=64,
    )
    counts = count.numpy()
    kept = np.flatnonzero(counts >= 0)
    own, last = (source[row[kept]], ray[row[kept]]), step[row[kept]]
    column = np.arange(width)
    before = np.minimum(column, hits[0].shape[2] - 1)
    behind = np.maximum(column - last[:, None] - 1, 0)
    is_before, is_patch = column < last[:, None], column == last[:, None]
    order = last + 1 + counts[kept]
    is_there = column < order[:, None]

    def along(of_rays: np.ndarray, of_legs: np.ndarray, nothing: float) -> np.ndarray:
        wide = (...,) + (None,) * (of_rays.ndim - 3)
        first = of_rays[own][:, before]
        behind_it = of_legs[kept][np.arange(len(kept))[:, None], behind]
        return np.where(is_there[wide], np.where((is_before | is_patch)[wide], first, behind_it), nothing)

    kinds = np.where(is_patch, DIFFUSE, along(hits[0], met.kind.numpy(), 0))
    return ScatteringPatches(
        link=link[kept].astype(np.int32),
        order=order.astype(np.int32),
        kind=kinds.astype(np.int32),
        surface=along(hits[1], met.surface.numpy(), -1).astype(np.int32),
        vertex=along(hits[2], met.vertex.numpy(), np.nan),
        normal=along(hits[3], met.normal.numpy(), np.nan),
        ray=ray[row[kept]].astype(np.int32),
    )
