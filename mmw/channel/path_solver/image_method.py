"""Geometry of all paths of a batch: candidates, image method, visibility, and no path twice."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.channel.links import Links
from mmw.channel.path_solver.candidate_filter import Backward, Candidates, diffracted_candidates, reflected_candidates
from mmw.channel.path_solver.candidates import Sources
from mmw.channel.path_solver.hit_buffers import make_hit_buffers
from mmw.channel.path_solver.scatter_paths import ScatteringPatches, find_patches
from mmw.channel.path_solver.surface_table import SurfaceTable
from mmw.config import ChannelConfig
from mmw.core.transfer import to_host
from mmw.core.transforms import invert, make_pose, normalize, transform_points
from mmw.kernels.channel.edges import cull_wedge_kernel
from mmw.kernels.channel.image_method import Trials, refine_kernel
from mmw.kernels.channel.segments import LIFT
from mmw.kernels.channel.surfaces import LinkEnds
from mmw.physics.em.interaction import DIFFRACTION
from mmw.physics.em.vectors import norm
from mmw.scene.device_scene import DeviceScene

TRIALS_AT_ONCE = 2**20
"""Most candidates that are refined at once, about 400 bytes each at depth 3."""

SAME_POINT_M = 1e-3
"""Two interactions of one link closer than this, or than a segment's lift, are one: coincident surfaces, seen twice."""


@dataclass(frozen=True)
class TracedPaths:
    """Geometry of the paths of a batch, sorted by (link, order, kinds, surfaces)."""

    link: np.ndarray
    """Shape [P], int32."""
    order: np.ndarray
    """Interactions of each path, shape [P], int32."""
    kind: np.ndarray
    """Kind of each interaction, 0 behind the last, shape [P, D], int32; D is at least 1."""
    surface: np.ndarray
    """Global surface id of each interaction, wedge id for a diffraction, -1 behind the last, shape [P, D], int32."""
    vertex: np.ndarray
    """Shape [P, D, 3], NaN behind the last."""
    normal: np.ndarray
    """Unit normal, turned to where the wave comes from, 0 for a diffraction, NaN behind the last, shape [P, D, 3]."""

    ray: np.ndarray
    """Ray that hit the rough patch of a diffuse path: r for the transmitter's, -2 - r for the receiver's, -1 for the
    other paths, shape [P], int32."""

    def __len__(self) -> int:
        return len(self.link)

    def take(self, rows: np.ndarray) -> "TracedPaths":
        """Return some of the paths."""
        return TracedPaths(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


def trace_paths(
    scene: DeviceScene, links: Links, config: ChannelConfig, table: SurfaceTable, is_pair: np.ndarray | None = None
) -> TracedPaths:
    """Return the geometry of all paths: candidates, image method, visibility, no duplicates; and diffuse paths.

    Args:
        scene: The scene with the batch of the links loaded.
        links: The links.
        config: Rays, candidate mode, depth, and which interactions are wanted.
        table: Surfaces of the scene, with their wedges if diffraction is wanted.
        is_pair: Links that stand for both directions, whose two ends share the rays, shape [L]; None for none.

    Raises:
        InputError: If there are too many candidates to try.
    """
    search = _Search(scene, links, config, table)
    is_pair = np.zeros(len(links), dtype=bool) if is_pair is None else is_pair
    found = [_none(max(1, config.max_depth))]
    if len(links):
        for link, step, is_plane in _candidates(search, is_pair):
            for begin in range(0, len(link), TRIALS_AT_ONCE):
                part = slice(begin, begin + TRIALS_AT_ONCE)
                found.append(_refine(search, link[part], step[part], is_plane))
        if config.diffuse and len(table):
            found += _rough(search)
    paths = TracedPaths(*(np.concatenate(column) for column in zip(*(_columns(f) for f in found), strict=True)))
    paths = TracedPaths(search.order[paths.link].astype(np.int32), *_columns(paths)[1:])
    return paths.take(_distinct(paths, links, table.area, scene.origin))


class _Search:
    """Input of every step of a search: the links in the order of their transmitters, and the poses of the batch."""

    def __init__(self, scene: DeviceScene, links: Links, config: ChannelConfig, table: SurfaceTable):
        self.scene, self.links, self.config, self.table = scene, links, config, table
        self.pose = instance_poses(scene)
        self.poses = wp.array(self.pose, dtype=wp.transformd, device=scene.device)
        self.order, self.sources, self.ends = self.sorted(links.slot, links.tx.position, links.rx.position)
        self.rank = np.empty(len(links), dtype=np.int32)  # place of each link in that order
        self.rank[self.order] = np.arange(len(links))

    def sorted(self, slot: np.ndarray, tx: np.ndarray, rx: np.ndarray) -> tuple[np.ndarray, Sources, LinkEnds]:
        """Return an order of links that brings those of one transmitter together, the transmitters, and the ends."""
        keys = np.concatenate([slot[:, None], tx], axis=1)
        _, first_use, source = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        source = source.reshape(-1).astype(np.int32)
        order = np.argsort(source, kind="stable")
        first_link = np.searchsorted(source[order], np.arange(len(first_use) + 1)).astype(np.int32)
        sources = Sources(slot[first_use].astype(np.int32), tx[first_use], first_link)
        ends = _link_ends(slot[order], source[order], tx[order], rx[order], self.pose, self.scene.device)
        return order, sources, ends

    def backward(self) -> Backward:
        """Return the links read backward."""
        back, sources, ends = self.sorted(self.links.slot, self.links.rx.position, self.links.tx.position)
        place = np.empty(len(back), dtype=np.int32)
        place[self.rank[back]] = np.arange(len(back))
        return Backward(ends, sources, place)


def _columns(found: TracedPaths) -> list[np.ndarray]:
    return [getattr(found, name) for name in found.__dataclass_fields__]


def _none(depth: int) -> TracedPaths:
    ints = np.zeros((0, depth), dtype=np.int32)
    points = np.zeros((0, depth, 3))
    return TracedPaths(ints[:, 0], ints[:, 0], ints, ints, points, points, ints[:, 0])


def instance_poses(scene: DeviceScene) -> np.ndarray:
    """Return instance-to-world poses with unit quaternions, shape [S, V, 7]; NaN for absent instances."""
    rows = [scene.arrays.frame_row(frame) for frame in scene.batch_frames]
    pose = scene.arrays.poses[rows][:, scene.instance_actor]
    return make_pose(pose[..., :3], normalize(pose[..., 3:]))


def _link_ends(
    slot: np.ndarray, source: np.ndarray, tx: np.ndarray, rx: np.ndarray, pose: np.ndarray, device: str
) -> LinkEnds:
    """Return the ends of links for kernels, in the frames of all instances and in the world."""
    inverse = invert(pose)[slot]
    ends = LinkEnds()
    ends.slot = wp.array(slot, dtype=wp.int32, device=device)
    ends.source = wp.array(source, dtype=wp.int32, device=device)
    for name, world in (("tx", tx[:, None]), ("rx", rx[:, None])):
        local = np.concatenate([transform_points(inverse, world), world], axis=1)
        setattr(ends, name, wp.array(local, dtype=wp.vec3d, device=device))
    return ends


def _candidates(search: _Search, is_pair: np.ndarray) -> Iterator[Candidates]:
    """Yield every candidate for the exact test."""
    config, table, count = search.config, search.table, len(search.links)
    depth = max(1, config.max_depth)
    if config.los:
        yield np.arange(count, dtype=np.int32), np.full((count, depth), -1, dtype=np.int32), False
    if config.max_depth == 0 or not len(table):
        return
    bends = config.diffraction and len(table.wedges) > 0
    backward = search.backward() if bends and config.specular and depth > 1 else None
    if config.specular and config.candidates == "launch" and is_pair.any():
        yield from _shared_reflections(search, is_pair)
    elif config.specular:
        yield from reflected_candidates(
            search.scene, search.ends, search.poses, search.sources, table, config, backward
        )
    if bends:
        yield from _wedge_candidates(search)
    if backward is not None:
        number = np.argsort(backward.place)
        behind = diffracted_candidates(search.scene, backward.ends, search.poses, backward.sources, table, config)
        for link, step, is_plane in behind:
            yield number[link], _turned(step), is_plane


def _shared_reflections(search: _Search, is_pair: np.ndarray) -> Iterator[Candidates]:
    """Yield the candidates of reflections of links of which some stand for both directions.

    Both ends of such a link launch half of the rays, and the hits of either serve the link.
    """
    links, config = search.links, search.config
    half = config.model_copy(update={"rays": max(config.rays // 2, 2)})
    for rows, both, own in ((np.flatnonzero(~is_pair), 1, config), (np.flatnonzero(is_pair), 2, half)):
        if not len(rows):
            continue
        tx, rx = links.tx.position[rows], links.rx.position[rows]
        tx, rx = (np.concatenate([tx, rx]), np.concatenate([rx, tx])) if both == 2 else (tx, rx)
        sorted_rows, sources, ends = search.sorted(np.tile(links.slot[rows], both), tx, rx)
        found = reflected_candidates(search.scene, ends, search.poses, sources, search.table, own)
        for link, step, is_plane in found:
            row = sorted_rows[link]
            turned = np.where((row >= len(rows))[:, None], _turned(step), step)
            yield search.rank[rows[row % len(rows)]], turned, is_plane


def _turned(step: np.ndarray) -> np.ndarray:
    """Return steps from the other end, shape [C, D]."""
    column = (step != -1).sum(axis=1)[:, None] - 1 - np.arange(step.shape[1])
    turned = np.where(column >= 0, np.take_along_axis(step, np.maximum(column, 0), axis=1), -1)
    return turned.astype(np.int32)


def _rough(search: _Search) -> list[TracedPaths]:
    """Return the diffuse paths: what the transmitters' rays find, and, with mirrors, the receivers'."""
    scene, poses, table, config = search.scene, search.poses, search.table, search.config
    ahead = find_patches(scene, search.ends, poses, search.sources, table, config, needs_mirror=False)
    found = [_patched(patches, patches.link, patches.ray) for patches in ahead]
    if config.specular and config.max_depth > 1:
        backward = search.backward()
        number = np.argsort(backward.place)
        behind = find_patches(scene, backward.ends, poses, backward.sources, table, config, needs_mirror=True)
        found += [_patched(patches.turned(), number[patches.link], -2 - patches.ray) for patches in behind]
    return found


def _patched(p: ScatteringPatches, link: np.ndarray, ray: np.ndarray) -> TracedPaths:
    return TracedPaths(link.astype(np.int32), p.order, p.kind, p.surface, p.vertex, p.normal, ray.astype(np.int32))


def _wedge_candidates(search: _Search) -> Iterator[Candidates]:
    """Yield the candidates of one diffraction and nothing else: every wedge for every link."""
    links, wedges, device = search.links, search.table.wedges, search.scene.device
    at_once = max(1, 2**26 // len(wedges))
    for begin in range(0, len(links), at_once):
        rows = search.order[begin : begin + at_once]
        is_candidate = wp.empty((len(rows), len(wedges)), dtype=wp.uint8, device=device)
        wp.launch(
            cull_wedge_kernel,
            dim=is_candidate.shape,
            inputs=[
                wp.array(links.slot[rows], dtype=wp.int32, device=device),
                wp.array(links.tx.position[rows], dtype=wp.vec3d, device=device),
                wp.array(links.rx.position[rows], dtype=wp.vec3d, device=device),
                wedges.device,
                search.poses,
            ],
            outputs=[is_candidate],
            device=device,
        )
        link, wedge = np.divmod(np.flatnonzero(is_candidate.numpy().view(np.bool_)), len(wedges))
        step = np.full((len(link), max(1, search.config.max_depth)), -1, dtype=np.int32)
        step[:, 0] = -2 - wedge
        yield (link + begin).astype(np.int32), step, False


def _refine(search: _Search, link: np.ndarray, step: np.ndarray, is_plane: bool) -> TracedPaths:
    """Return the candidates that are paths; `link` still counts in the order of the sources."""
    scene, table, config = search.scene, search.table, search.config
    device, shape = scene.device, step.shape
    trials = Trials()
    trials.link = wp.array(link, dtype=wp.int32, device=device)
    trials.step = wp.array(step, dtype=wp.int32, device=device)
    trials.is_plane = is_plane
    trials.image, trials.normal, trials.point = (wp.empty(shape, dtype=wp.vec3d, device=device) for _ in range(3))
    trials.offset = wp.empty(shape, dtype=wp.float64, device=device)
    order = wp.empty(len(link), dtype=wp.int32, device=device)
    met = make_hit_buffers(shape, device)
    wp.launch(
        refine_kernel,
        dim=len(link),
        inputs=[
            scene.struct,
            search.ends,
            table.device,
            table.wedges.device,
            search.poses,
            wp.vec3d(*scene.origin),
            trials,
            config.max_depth if config.refraction else 0,
        ],
        outputs=[order, met],
        device=device,
        block_dim=64,
    )
    orders, kind, surface, vertex, normal = to_host([order, met.kind, met.surface, met.vertex, met.normal])
    kept = np.flatnonzero(orders >= 0)
    is_there = np.arange(shape[1]) < orders[kept, None]
    return TracedPaths(
        link=link[kept],
        order=orders[kept],
        kind=np.where(is_there, kind[kept], 0),
        surface=np.where(is_there, surface[kept], -1),
        vertex=np.where(is_there[..., None], vertex[kept], np.nan),
        normal=np.where(is_there[..., None], normal[kept], np.nan),
        ray=np.full(len(kept), -1, dtype=np.int32),
    )


def _distinct(found: TracedPaths, links: Links, area: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """Return the rows to keep, sorted by (link, order, kinds, surfaces).

    Of paths of one link with the same interactions in the same places (see `SAME_POINT_M`), the one on the smallest
    surfaces stays (a marking lies on its road), and the lowest surface ids among equals.
    """
    length = path_lengths(links.tx.position[found.link], links.rx.position[found.link], found)
    reach = np.nanmax(np.abs(found.vertex - origin), axis=(1, 2), initial=0.0)
    apart = np.maximum(SAME_POINT_M, LIFT.value * (5.0 + reach))
    is_bent = found.kind == DIFFRACTION
    size = np.where(is_bent | (found.surface < 0), 0.0, np.append(area, 0.0)[np.where(is_bent, -1, found.surface)])
    size = size.sum(axis=1)
    columns = range(found.kind.shape[1] - 1, -1, -1)  # the last key sorts first
    keys = [found.ray, *(values[:, k] for values in (found.surface, found.kind) for k in columns)]
    rank = np.lexsort((*keys, found.order, found.link))
    place = np.empty(len(found), dtype=np.int64)
    place[rank] = np.arange(len(found))
    exact = np.flatnonzero(found.ray == -1)
    near_rank = exact[np.lexsort((length[exact], found.order[exact], found.link[exact]))]
    dropped = np.zeros(len(found), dtype=bool)
    for step in range(1, len(near_rank)):
        one, other = near_rank[:-step], near_rank[step:]
        near = (found.link[one] == found.link[other]) & (found.order[one] == found.order[other])
        near &= (length[other] - length[one] <= 2.0 * apart[one] * found.order[one]) & (found.order[one] > 0)
        if not near.any():
            break
        one, other = one[near], other[near]
        same = (found.kind[one] == found.kind[other]).all(axis=1)
        same &= (np.nan_to_num(norm(found.vertex[one] - found.vertex[other])) <= apart[one, None]).all(axis=1)
        one, other = one[same], other[same]
        is_first = np.where(size[one] == size[other], place[one] < place[other], size[one] < size[other])
        dropped[np.where(is_first, other, one)] = True
    return rank[~dropped[rank]]


def path_lengths(tx: np.ndarray, rx: np.ndarray, found: TracedPaths) -> np.ndarray:
    """Return the lengths of paths between ends of shape [P, 3], in meters, shape [P]."""
    length, before = np.zeros(len(found)), tx
    for k in range(found.kind.shape[1]):
        is_there = (k < found.order)[:, None]
        point = np.where(is_there, found.vertex[:, k], before)
        length += norm(point - before)
        before = point
    return length + norm(rx - before)
