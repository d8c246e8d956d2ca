"""Which chains of planes could carry a path of a link: by launched rays, or by trying every one."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.channel.surface_table import SurfaceTable
from mmw.config import ChannelConfig
from mmw.kernels.channel_bends import count_bent_kernel, fill_bent_kernel
from mmw.kernels.channel_between import Tails, join_kernel
from mmw.kernels.channel_chains import (
    LINK_BITS,
    LINKS_AT_ONCE,
    Chains,
    cull_chain_kernel,
    cull_kernel,
    fill_chain_kernel,
    image_kernel,
)
from mmw.kernels.channel_launch import PLANE_BITS, launch_kernel
from mmw.kernels.channel_surfaces import LinkEnds
from mmw.scene import Scene

PAIRS_AT_ONCE = 2**27
"""Most (link, surface) or (transmitter, surface) pairs at once: one byte each, on the device and on the host."""

RAYS_AT_ONCE = 2**30
"""Most rays in one kernel launch."""

CELLS_AT_ONCE = {"cuda": 2**26, "cpu": 2**23}
"""Cells of the table of chains that are worth a launch of several transmitters; 84 bytes each."""

MOST_CELLS = 2**30
"""Cells of the largest table."""

FIRST_CELLS = 2**15
"""Cells for each transmitter and each level below the first, until a launch needs more."""


@dataclass(frozen=True)
class Sources:
    """The transmitters of a batch, one row a slot and actor, with their links one after the other."""

    slot: np.ndarray
    """Slot of each source, shape [A], int32."""
    position: np.ndarray
    """World frame [m], shape [A, 3]."""
    first_link: np.ndarray
    """First link of each source, and the number of links, shape [A + 1], int32."""

    def __len__(self) -> int:
        return len(self.slot)

    def part(self, begin: int, end: int) -> "Sources":
        """Return some of the sources; links keep their numbers."""
        return Sources(self.slot[begin:end], self.position[begin:end], self.first_link[begin : end + 1])


Candidates = tuple[np.ndarray, np.ndarray, bool]
"""Links, shape [C]; what they meet from transmitter to receiver, shape [C, D], int32: a surface or a plane, -2 - wedge,
or -1 behind the end; and whether it is planes."""


class TableFull(Exception):
    """The table of chains is too small for this launch."""


@dataclass(frozen=True)
class Backward:
    """The links read backwards, for chains that start at the receivers."""

    ends: LinkEnds
    """Ends, sorted by receiver; `tx` are the receivers."""
    sources: Sources
    """The receivers."""
    place: np.ndarray
    """Place of each link, in the order of the transmitters, among the links read backwards, shape [L], int32."""


def reflected_candidates(
    scene: Scene,
    ends: LinkEnds,
    pose: wp.array,
    sources: Sources,
    table: SurfaceTable,
    config: ChannelConfig,
    backward: Backward | None = None,
) -> Iterator[Candidates]:
    """Yield chains of reflections, and with diffraction those that have a wedge among or behind them.

    Args:
        scene: The scene with the batch loaded.
        ends: Ends of the links, sorted by source.
        pose: Instance-to-world poses on the device, shape [S, V].
        sources: The transmitters.
        table: Surfaces of the scene.
        config: Candidate mode, rays, depth, interactions.
        backward: The links read backwards, for diffraction.

    Raises:
        ValueError: If there are too many chains to try them all, or to keep them.
    """
    depth = config.max_depth
    for part, begin, is_seen, keys in _launches(scene, sources, table, config):
        yield _single(ends, part, begin, table, is_seen, depth)
        if keys is not None:
            chains = _tree(pose, part, table, keys, depth)
            yield from _reflected(ends, pose, part, table, chains, depth)
            if backward is not None:
                yield from _bent(ends, pose, part, table, chains, depth)
                if depth > 2:
                    yield from _between(scene, ends, pose, part, table, chains, config, backward)


def bent_candidates(
    scene: Scene, ends: LinkEnds, pose: wp.array, sources: Sources, table: SurfaceTable, config: ChannelConfig
) -> Iterator[Candidates]:
    """Yield chains of reflections with a diffraction behind them only; see `reflected_candidates`."""
    for part, _, _, keys in _launches(scene, sources, table, config):
        if keys is not None:
            chains = _tree(pose, part, table, keys, config.max_depth)
            yield from _bent(ends, pose, part, table, chains, config.max_depth)


def _launches(
    scene: Scene, sources: Sources, table: SurfaceTable, config: ChannelConfig
) -> Iterator[tuple[Sources, int, wp.array, wp.array | None]]:
    """Yield some sources, the first of them, and what their rays met, a part that fits into memory at a time."""
    waiting = _chunks(sources.first_link, len(table), config)
    while waiting:
        begin, end = waiting.pop(0)
        part = sources.part(begin, end)
        try:
            yield part, begin, *_chains(scene, part, table, config)
        except TableFull:
            middle = (begin + end) // 2
            waiting = [(begin, middle), (middle, end), *waiting]


def _chunks(first_link: np.ndarray, surface_count: int, config: ChannelConfig) -> list[tuple[int, int]]:
    """Return ranges of transmitters that keep memory and launch sizes bounded; always at least one transmitter."""
    chunks, begin = [], 0
    while begin < len(first_link) - 1:
        end = begin + 1
        while (
            end < len(first_link) - 1
            and (first_link[end + 1] - first_link[begin]) * surface_count <= PAIRS_AT_ONCE
            and (end + 1 - begin) * surface_count <= PAIRS_AT_ONCE
            and (end + 1 - begin) * config.rays <= RAYS_AT_ONCE
        ):
            end += 1
        chunks.append((begin, end))
        begin = end
    return chunks


def _chains(
    scene: Scene, sources: Sources, table: SurfaceTable, config: ChannelConfig
) -> tuple[wp.array, wp.array | None]:
    """Return the first planes, one byte each, shape [A, K], and the keys of longer chains, shape [N], if wanted."""
    if config.candidates == "exhaustive":
        is_seen = wp.full((len(sources), table.plane_count), 1, dtype=wp.uint8, device=scene.device)
        keys = every_chain(len(sources), table.plane_count, config.max_depth) if config.max_depth > 1 else None
        return is_seen, None if keys is None else wp.array(keys, dtype=wp.uint64, device=scene.device)
    origin = sources.position - scene.origin
    if config.max_depth == 1:
        is_seen, _, _ = launch_rays(scene, sources.slot, origin, config.rays, table)
        return is_seen, None
    patterns = range(2 ** (config.max_depth - 1)) if config.refraction and table.is_open.any() else range(1)
    name = f"cells at depth {config.max_depth}"
    most = CELLS_AT_ONCE["cuda" if "cuda" in scene.device else "cpu"]
    each = table.sizes.get(name, FIRST_CELLS << 3 * (config.max_depth - 2))
    while True:
        cells = 2 ** int(np.ceil(np.log2(each * len(sources))))
        if cells > most and len(sources) > 1:
            raise TableFull
        if cells > MOST_CELLS:
            raise ValueError(
                f"channel.rays = {config.rays}, max_depth = {config.max_depth}: the chains of one transmitter do not "
                f"fit into {MOST_CELLS} cells; launch fewer rays or lower the depth"
            )
        is_seen, keys, is_full = launch_rays(
            scene, sources.slot, origin, config.rays, table, config.max_depth, cells, patterns
        )
        if not is_full:
            table.sizes[name] = each
            return is_seen, keys
        each *= 4


def launch_rays(
    scene: Scene,
    slot: np.ndarray,
    origin: np.ndarray,
    rays: int,
    table: SurfaceTable,
    depth: int = 1,
    cells: int = 1,
    patterns: range = range(1),
) -> tuple[wp.array, wp.array, bool]:
    """Follow the rays of each transmitter.

    Args:
        scene: The scene with its batch loaded.
        slot: Slot of each transmitter, shape [A].
        origin: Transmitters in the scene frame [m], shape [A, 3].
        rays: Rays of each transmitter, > 1.
        table: Surfaces of the scene.
        depth: Surfaces that a ray follows.
        cells: Size of the table of chains, a power of two.
        patterns: Which of its surfaces a ray goes through instead of off them, one launch a bit pattern.

    Returns:
        Which planes are met first, one byte each, shape [A, K]; the keys of chains of two planes and more, shape [N];
        and whether some chain found no cell.
    """
    device, stride = scene.device, neighbor_stride(rays)
    row_count = -(-rays // stride)
    is_seen = wp.zeros((len(slot), table.plane_count), dtype=wp.uint8, device=device)
    keys = wp.zeros(cells, dtype=wp.uint64, device=device)
    is_full = wp.zeros(1, dtype=wp.int32, device=device)
    slots = wp.array(slot, dtype=wp.int32, device=device)
    origins = wp.array(origin.astype(np.float32), dtype=wp.vec3, device=device)
    for passes in patterns:
        wp.launch(
            launch_kernel,
            dim=(len(slot), row_count * stride),
            inputs=[
                scene.struct,
                slots,
                origins,
                table.device.plane,
                table.device.is_open,
                rays,
                stride,
                row_count,
                depth,
                passes,
            ],
            outputs=[is_seen, keys, is_full],
            device=device,
            block_dim=64,
        )
    return is_seen, keys, depth > 1 and bool(is_full.numpy()[0])


def neighbor_stride(ray_count: int) -> int:
    """Return the Fibonacci number F that makes rays i and i + F of the lattice close neighbours.

    Their azimuths differ by 2 pi / (sqrt(5) F) and their heights by 2 F / N, which are alike at F^2 = pi N / sqrt(5).
    """
    before, stride = 1, 2
    while stride * stride < np.pi * ray_count / np.sqrt(5.0):
        before, stride = stride, before + stride
    return before


def every_chain(sources: int, planes: int, depth: int) -> np.ndarray:
    """Return the keys of all chains of 2 to `depth` planes without the same one twice in a row, shape [N], uint64.

    Raises:
        ValueError: If there are more than `PAIRS_AT_ONCE`.
    """
    count = sources * planes * sum((planes - 1) ** k for k in range(1, depth))
    if count > PAIRS_AT_ONCE:
        raise ValueError(
            f"channel.candidates = 'exhaustive' with max_depth = {depth}: {planes} planes make {count} chains, the "
            f"most is {PAIRS_AT_ONCE}; use candidates: launch, or a lower depth"
        )
    parent = np.arange(sources * planes)
    last, filled, keys = parent % planes, sources * planes, []
    for level in range(2, depth + 1):
        code, plane = np.repeat(parent, planes), np.tile(np.arange(planes), len(parent))
        keep = np.repeat(last, planes) != plane
        code, last = code[keep].astype(np.uint64), plane[keep]
        top = np.uint64(level) << np.uint64(32 + PLANE_BITS.value)
        keys.append(top | (last.astype(np.uint64) << np.uint64(32)) | code)
        parent = filled + np.arange(len(last))
        filled += len(last)
    return np.concatenate(keys)


def _single(
    ends: LinkEnds, sources: Sources, first_source: int, table: SurfaceTable, is_seen: wp.array, depth: int
) -> Candidates:
    """Return the candidates of one reflection."""
    begin, end = int(sources.first_link[0]), int(sources.first_link[-1])
    is_candidate = wp.empty((end - begin, len(table)), dtype=wp.uint8, device=is_seen.device)
    wp.launch(
        cull_kernel,
        dim=(-(-(end - begin) // LINKS_AT_ONCE), len(table)),
        inputs=[ends, table.device, begin, first_source, is_seen],
        outputs=[is_candidate],
        device=is_seen.device,
    )
    link, surface = np.divmod(np.flatnonzero(is_candidate.numpy().view(np.bool_)), len(table))
    step = np.full((len(link), depth), -1, dtype=np.int32)
    step[:, 0] = surface
    return (link + begin).astype(np.int32), step, False


def _tree(pose: wp.array, sources: Sources, table: SurfaceTable, keys: wp.array, depth: int) -> Chains:
    """Return the chains with planes and images of the transmitters."""
    device, cells = keys.device, keys.shape[0]
    chains = Chains()
    chains.key, chains.first, chains.plane_count = keys, len(sources) * table.plane_count, table.plane_count
    chains.source = wp.empty(cells, dtype=wp.int32, device=device)
    chains.image, chains.normal = (wp.empty(cells, dtype=wp.vec3d, device=device) for _ in range(2))
    chains.offset = wp.empty(cells, dtype=wp.float64, device=device)
    slot = wp.array(sources.slot, dtype=wp.int32, device=device)
    tx = wp.array(sources.position, dtype=wp.vec3d, device=device)
    for level in range(2, depth + 1):
        wp.launch(
            image_kernel,
            dim=cells,
            inputs=[table.device, pose, slot, tx, level, chains],
            outputs=[chains.source, chains.image, chains.normal, chains.offset],
            device=device,
        )
    return chains


def _reflected(
    ends: LinkEnds, pose: wp.array, sources: Sources, table: SurfaceTable, chains: Chains, depth: int
) -> Iterator[Candidates]:
    """Yield the candidates of two reflections and more."""
    device, cells = chains.key.device, chains.key.shape[0]
    first_link = wp.array(sources.first_link, dtype=wp.int32, device=device)
    links, count = (wp.empty(cells, dtype=wp.int32, device=device) for _ in range(2))
    for block in range(-(-int(np.diff(sources.first_link).max()) // LINK_BITS)):
        wp.launch(
            cull_chain_kernel,
            dim=cells,
            inputs=[ends, table.device, pose, first_link, block, chains],
            outputs=[links, count],
            device=device,
        )
        end, total = _summed(count)
        if total == 0:
            continue
        link = wp.empty(total, dtype=wp.int32, device=device)
        step = wp.full((total, depth), -1, dtype=wp.int32, device=device)
        wp.launch(
            fill_chain_kernel,
            dim=cells,
            inputs=[first_link, block, chains, links, end],
            outputs=[link, step],
            device=device,
        )
        yield link.numpy(), step.numpy(), True


def _bent(
    ends: LinkEnds, pose: wp.array, sources: Sources, table: SurfaceTable, chains: Chains, depth: int
) -> Iterator[Candidates]:
    """Yield the candidates of reflections and then a diffraction at an edge of the surface that the rays met next."""
    device, cells = chains.key.device, chains.key.shape[0]
    first_link = wp.array(sources.first_link, dtype=wp.int32, device=device)
    count = wp.empty(cells, dtype=wp.int32, device=device)
    inputs = [ends, table.device, table.wedges.device, pose, first_link, chains]
    wp.launch(count_bent_kernel, dim=cells, inputs=inputs, outputs=[count], device=device)
    end, total = _summed(count)
    if total == 0:
        return
    link = wp.empty(total, dtype=wp.int32, device=device)
    step = wp.full((total, depth), -1, dtype=wp.int32, device=device)
    wp.launch(fill_bent_kernel, dim=cells, inputs=[*inputs, count, end], outputs=[link, step], device=device)
    yield link.numpy(), step.numpy(), True


def _between(
    scene: Scene,
    ends: LinkEnds,
    pose: wp.array,
    sources: Sources,
    table: SurfaceTable,
    chains: Chains,
    config: ChannelConfig,
    backward: Backward,
) -> Iterator[Candidates]:
    """Yield the candidates with reflections on both sides of a wedge."""
    device, cells, depth = scene.device, chains.key.shape[0], config.max_depth
    tails = Tails()
    tails.ends = backward.ends
    tails.link = wp.array(backward.place, dtype=wp.int32, device=device)
    for part, begin, _, keys in _launches(scene, backward.sources, table, config):
        tails.chains = _tree(pose, part, table, keys, depth)
        key, cell = _by_last_plane(tails.chains, depth)
        tails.key = wp.array(key, dtype=wp.int64, device=device)
        tails.cell = wp.array(cell, dtype=wp.int32, device=device)
        source = np.searchsorted(backward.sources.first_link, backward.place, side="right") - 1 - begin
        source = np.where((source >= 0) & (source < len(part)), source, -1)
        tails.source = wp.array(source, dtype=wp.int32, device=device)
        first_link = wp.array(sources.first_link, dtype=wp.int32, device=device)
        inputs = [ends, table.device, table.wedges.device, pose, first_link, chains, tails, depth]
        count = wp.zeros(cells, dtype=wp.int32, device=device)
        link, step = wp.empty(1, dtype=wp.int32, device=device), wp.empty((1, depth), dtype=wp.int32, device=device)
        wp.launch(join_kernel, dim=cells, inputs=[*inputs, False, count], outputs=[count, link, step], device=device)
        end, total = _summed(count)
        if total == 0:
            continue
        link = wp.empty(total, dtype=wp.int32, device=device)
        step = wp.full((total, depth), -1, dtype=wp.int32, device=device)
        wp.launch(join_kernel, dim=cells, inputs=[*inputs, True, end], outputs=[count, link, step], device=device)
        yield link.numpy(), step.numpy(), True


def _by_last_plane(chains: Chains, depth: int) -> tuple[np.ndarray, np.ndarray]:
    """Return source * K + last plane and cell of the chains that leave room for a wedge and one more, sorted by both."""
    keys, source = chains.key.numpy(), chains.source.numpy()
    level = keys >> np.uint64(32 + PLANE_BITS.value)
    cell = np.flatnonzero((level > 0) & (level < depth))
    plane = (keys[cell] >> np.uint64(32)) & np.uint64(2**PLANE_BITS.value - 1)
    key = source[cell].astype(np.int64) * chains.plane_count + plane.astype(np.int64)
    order = np.lexsort((keys[cell], key))
    return key[order], cell[order]


def _summed(count: wp.array) -> tuple[wp.array, int]:
    """Return the inclusive sums of counts, and the whole."""
    end = wp.empty_like(count)
    wp.utils.array_scan(count, end, inclusive=True)
    return end, int(end[-1:].numpy()[0])
