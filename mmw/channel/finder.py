"""Geometry of all paths of a batch: candidates, image method, visibility, and no path twice."""

from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.channel.links import Links
from mmw.channel.surface_table import SurfaceTable
from mmw.channel.vectors import norm
from mmw.config import ChannelConfig
from mmw.kernels.channel_launch import launch_kernel
from mmw.kernels.channel_refine import LIFT, LINKS_AT_ONCE, LinkEnds, cull_kernel, refine_kernel, sight_kernel
from mmw.poses import invert, make_pose, normalize, transform_points
from mmw.scene import Scene

PAIRS_AT_ONCE = 2**27
"""Most (link, surface) or (transmitter, surface) pairs at once: one byte each, on the device and on the host."""

RAYS_AT_ONCE = 2**30
"""Most rays in one kernel launch."""

SAME_POINT_M = 1e-3
"""Two reflections of one link closer than this, or than a leg's lift, are one: coincident surfaces, seen twice."""


@dataclass(frozen=True)
class FoundPaths:
    """Geometry of the paths of a batch, sorted by (link, kind, surface)."""

    link: np.ndarray
    """Shape [P], int32."""
    surface: np.ndarray
    """Global surface id, -1 for the line of sight, shape [P], int32."""
    vertex: np.ndarray
    """Shape [P, 3], NaN for the line of sight."""
    normal: np.ndarray
    """Shape [P, 3], NaN for the line of sight."""


def find_paths(scene: Scene, links: Links, config: ChannelConfig, table: SurfaceTable) -> FoundPaths:
    """Return the geometry of all paths: candidates, image method, visibility, duplicates removed.

    Args:
        scene: The scene with the batch of the links loaded.
        links: The links.
        config: Rays, candidate mode and depth.
        table: Surfaces of the scene.
    """
    device = scene.device
    keys, first_use, source = np.unique(
        np.stack([links.slot, links.tx_actor], axis=1), axis=0, return_index=True, return_inverse=True
    )
    source = source.reshape(-1).astype(np.int32)
    order = np.argsort(source, kind="stable")  # links of one transmitter together
    pose = _instance_poses(scene)
    ends = _link_ends(links, order, source, pose, device)
    is_clear = wp.zeros(len(links), dtype=wp.uint8, device=device)
    if len(links):
        wp.launch(
            sight_kernel,
            dim=len(links),
            inputs=[scene.struct, ends, wp.vec3d(*scene.origin)],
            outputs=[is_clear],
            device=device,
            block_dim=64,
        )
    link = [np.nonzero(is_clear.numpy())[0]]
    surface = [np.full(len(link[0]), -1)]
    vertex, normal = [np.full((len(link[0]), 3), np.nan)], [np.full((len(link[0]), 3), np.nan)]
    if config.max_depth > 0 and len(table) and len(links):
        poses = wp.array(pose if pose.size else np.zeros((1, 1, 7)), dtype=wp.transformd, device=device)
        tx_origin = links.tx.position[first_use] - scene.origin
        first_link = np.searchsorted(source[order], np.arange(len(keys) + 1))
        for begin, end in _chunks(first_link, len(table), config.rays):
            seen = _candidates(scene, keys[begin:end, 0], tx_origin[begin:end], config, len(table))
            pair_link, pair_surface = _cull(ends, table, seen, begin, first_link[begin], first_link[end])
            kept, points, normals = _refine(scene, ends, table, poses, pair_link, pair_surface)
            link.append(pair_link[kept])
            surface.append(pair_surface[kept])
            vertex.append(points)
            normal.append(normals)
    found = FoundPaths(
        link=order[np.concatenate(link)].astype(np.int32),
        surface=np.concatenate(surface).astype(np.int32),
        vertex=np.concatenate(vertex),
        normal=np.concatenate(normal),
    )
    return _take(found, _distinct(found, links, table.area, scene.origin))


def _chunks(first_link: np.ndarray, surface_count: int, rays: int) -> list[tuple[int, int]]:
    """Return ranges of transmitters that keep memory and launch sizes bounded; always at least one transmitter."""
    chunks, begin = [], 0
    while begin < len(first_link) - 1:
        end = begin + 1
        while (
            end < len(first_link) - 1
            and (first_link[end + 1] - first_link[begin]) * surface_count <= PAIRS_AT_ONCE
            and (end + 1 - begin) * surface_count <= PAIRS_AT_ONCE
            and (end + 1 - begin) * rays <= RAYS_AT_ONCE
        ):
            end += 1
        chunks.append((begin, end))
        begin = end
    return chunks


def _instance_poses(scene: Scene) -> np.ndarray:
    """Return instance-to-world poses with unit quaternions, shape [S, V, 7]; NaN for absent instances."""
    rows = [scene.arrays.frame_row(frame) for frame in scene.batch_frames]
    pose = scene.arrays.poses[rows][:, scene.instance_actor]
    return make_pose(pose[..., :3], normalize(pose[..., 3:]))


def _link_ends(links: Links, order: np.ndarray, source: np.ndarray, pose: np.ndarray, device: str) -> LinkEnds:
    """Return the ends of links for kernels, in the given order, in the frames of all instances and in the world."""
    inverse = invert(pose)[links.slot[order]]
    ends = LinkEnds()
    ends.slot = wp.array(links.slot[order], dtype=wp.int32, device=device)
    ends.source = wp.array(source[order], dtype=wp.int32, device=device)
    for name, side in (("tx", links.tx), ("rx", links.rx)):
        world = side.position[order][:, None]
        local = np.concatenate([transform_points(inverse, world), world], axis=1)
        setattr(ends, name, wp.array(local, dtype=wp.vec3d, device=device))
    return ends


def _candidates(scene: Scene, slot: np.ndarray, origin: np.ndarray, config: ChannelConfig, surfaces: int) -> wp.array:
    """Return which surfaces each transmitter may reflect at, one byte each, shape [A, G]."""
    if config.candidates == "exhaustive":
        return wp.full((len(slot), surfaces), 1, dtype=wp.uint8, device=scene.device)
    return launch_candidates(scene, slot, origin, config.rays, surfaces)


def launch_candidates(scene: Scene, slot: np.ndarray, origin: np.ndarray, rays: int, surface_count: int) -> wp.array:
    """Return which surfaces the rays of each transmitter meet, one byte each, shape [A, G].

    Args:
        scene: The scene with its batch loaded.
        slot: Slot of each transmitter, shape [A].
        origin: Transmitters in the scene frame [m], shape [A, 3].
        rays: Rays of each transmitter, > 1.
        surface_count: Surfaces of the scene.
    """
    device, stride = scene.device, neighbor_stride(rays)
    row_count = -(-rays // stride)
    seen = wp.zeros((len(slot), surface_count), dtype=wp.uint8, device=device)
    wp.launch(
        launch_kernel,
        dim=(len(slot), row_count * stride),
        inputs=[
            scene.struct,
            wp.array(slot, dtype=wp.int32, device=device),
            wp.array(origin.astype(np.float32), dtype=wp.vec3, device=device),
            rays,
            stride,
            row_count,
        ],
        outputs=[seen],
        device=device,
        block_dim=64,
    )
    return seen


def neighbor_stride(ray_count: int) -> int:
    """Return the Fibonacci number F that makes rays i and i + F of the lattice close neighbours.

    Their azimuths differ by 2 pi / (sqrt(5) F) and their heights by 2 F / N, which are alike at F^2 = pi N / sqrt(5).
    """
    before, stride = 1, 2
    while stride * stride < np.pi * ray_count / np.sqrt(5.0):
        before, stride = stride, before + stride
    return before


def _cull(
    ends: LinkEnds, table: SurfaceTable, seen: wp.array, first_source: int, begin: int, end: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the (link, surface) pairs worth refining, in order, shape [C] each."""
    is_candidate = wp.empty((int(end - begin), len(table)), dtype=wp.uint8, device=seen.device)
    wp.launch(
        cull_kernel,
        dim=(-(-int(end - begin) // LINKS_AT_ONCE), len(table)),
        inputs=[ends, table.device, int(begin), int(first_source), seen],
        outputs=[is_candidate],
        device=seen.device,
    )
    link, surface = np.divmod(np.flatnonzero(is_candidate.numpy().view(np.bool_)), len(table))
    return link + begin, surface


def _refine(
    scene: Scene, ends: LinkEnds, table: SurfaceTable, pose: wp.array, link: np.ndarray, surface: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return which pairs are paths, shape [C], and point and normal of those, shape [P, 3] each."""
    device, count = scene.device, len(link)
    if count == 0:
        return np.zeros(0, dtype=bool), np.zeros((0, 3)), np.zeros((0, 3))
    is_path = wp.empty(count, dtype=wp.uint8, device=device)
    vertex, normal = (wp.empty(count, dtype=wp.vec3d, device=device) for _ in range(2))
    wp.launch(
        refine_kernel,
        dim=count,
        inputs=[
            scene.struct,
            ends,
            table.device,
            pose,
            wp.vec3d(*scene.origin),
            wp.array(link, dtype=wp.int32, device=device),
            wp.array(surface, dtype=wp.int32, device=device),
        ],
        outputs=[is_path, vertex, normal],
        device=device,
        block_dim=64,
    )
    kept = is_path.numpy().view(np.bool_)
    return kept, vertex.numpy()[kept], normal.numpy()[kept]


def _distinct(found: FoundPaths, links: Links, area: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Return the rows to keep, sorted by (link, kind, surface).

    Of reflections of one link in one place (see `SAME_POINT_M`), the one on the smallest surface stays (a marking lies
    on its road), and the lowest surface id among equals.
    """
    reflected = np.nonzero(found.surface >= 0)[0]
    length = np.zeros(len(found.link))
    at = found.vertex[reflected]
    length[reflected] = norm(at - links.tx.position[found.link[reflected]])
    length[reflected] += norm(at - links.rx.position[found.link[reflected]])
    apart = np.maximum(SAME_POINT_M, LIFT.value * (5.0 + np.abs(found.vertex - origin).max(axis=1)))
    rank = reflected[np.lexsort((length[reflected], found.link[reflected]))]
    dropped = np.zeros(len(found.link), dtype=bool)
    for step in range(1, len(rank)):
        one, other = rank[:-step], rank[step:]
        near = (found.link[one] == found.link[other]) & (length[other] - length[one] <= 2.0 * apart[one])
        if not near.any():
            break
        one, other = one[near], other[near]
        same = norm(found.vertex[one] - found.vertex[other]) <= apart[one]
        one, other = one[same], other[same]
        area_one, area_other = area[found.surface[one]], area[found.surface[other]]
        is_first = np.where(area_one == area_other, found.surface[one] < found.surface[other], area_one < area_other)
        dropped[np.where(is_first, other, one)] = True
    keep = np.nonzero(~dropped)[0]
    return keep[np.lexsort((found.surface[keep], found.link[keep]))]


def _take(found: FoundPaths, rows: np.ndarray) -> FoundPaths:
    return FoundPaths(found.link[rows], found.surface[rows], found.vertex[rows], found.normal[rows])
