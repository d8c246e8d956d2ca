"""Filter of the path candidates that rays found: a generous test for the links that could use each."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.channel.path_solver.candidates import Sources, launches
from mmw.channel.path_solver.surface_table import SurfaceTable
from mmw.config import ChannelConfig
from mmw.core.transfer import to_host
from mmw.kernels.channel.diffraction_candidates import bend_kernel
from mmw.kernels.channel.ray_launch import PLANE_BITS
from mmw.kernels.channel.reflection_candidates import (
    LINK_BITS,
    LINKS_AT_ONCE,
    Chains,
    cull_chain_kernel,
    cull_kernel,
    fill_chain_kernel,
    fill_kernel,
    image_kernel,
)
from mmw.kernels.channel.reflection_diffraction_candidates import Tails, join_kernel
from mmw.kernels.channel.surfaces import LinkEnds
from mmw.scene.device_scene import DeviceScene

Candidates = tuple[np.ndarray, np.ndarray, bool]
"""Links, shape [C]; interactions from transmitter to receiver, shape [C, D], int32: a surface or a plane, -2 - wedge,
or -1 behind the end; and whether it is planes."""


@dataclass(frozen=True)
class Backward:
    """The links read backward, for candidates that start at the receivers."""

    ends: LinkEnds
    """Ends, sorted by receiver; `tx` are the receivers."""
    sources: Sources
    """The receivers."""
    place: np.ndarray
    """Place of each link, in the order of the transmitters, among the links read backward, shape [L], int32."""


def reflected_candidates(
    scene: DeviceScene,
    ends: LinkEnds,
    pose: wp.array,
    sources: Sources,
    table: SurfaceTable,
    config: ChannelConfig,
    backward: Backward | None = None,
) -> Iterator[Candidates]:
    """Yield candidates of reflections, and with diffraction those that have a wedge among or behind them.

    Args:
        scene: The scene with the batch loaded.
        ends: Ends of the links, sorted by source.
        pose: Instance-to-world poses on the device, shape [S, V].
        sources: The transmitters.
        table: Surfaces of the scene.
        config: Candidate mode, rays, depth, interactions.
        backward: The links read backward, for diffraction.

    Raises:
        InputError: If there are too many candidates to try them all, or to keep them.
    """
    depth = config.max_depth
    for part, begin, is_seen, keys in launches(scene, sources, table, config):
        yield _single(ends, part, begin, table, is_seen, depth)
        if keys is not None:
            chains = _tree(pose, part, table, keys, depth)
            yield from _reflected(ends, pose, part, table, chains, depth)
            if backward is not None:
                yield from _bent(ends, pose, part, table, chains, depth)
                if depth > 2:
                    yield from _between(scene, ends, pose, part, table, chains, config, backward)


def diffracted_candidates(
    scene: DeviceScene, ends: LinkEnds, pose: wp.array, sources: Sources, table: SurfaceTable, config: ChannelConfig
) -> Iterator[Candidates]:
    """Yield candidates of reflections with a diffraction behind them only; see `reflected_candidates`."""
    for part, _, _, keys in launches(scene, sources, table, config):
        if keys is not None:
            chains = _tree(pose, part, table, keys, config.max_depth)
            yield from _bent(ends, pose, part, table, chains, config.max_depth)


def _single(
    ends: LinkEnds, sources: Sources, first_source: int, table: SurfaceTable, is_seen: wp.array, depth: int
) -> Candidates:
    """Return the candidates of one reflection."""
    begin, stop, device = int(sources.first_link[0]), int(sources.first_link[-1]), is_seen.device
    dim = (-(-(stop - begin) // LINKS_AT_ONCE), len(table))
    links, count = (wp.empty(dim, dtype=wp.int32, device=device) for _ in range(2))
    wp.launch(
        cull_kernel,
        dim=dim,
        inputs=[ends, table.device, begin, stop - begin, first_source, is_seen],
        outputs=[links, count],
        device=device,
    )
    end, total = _summed(count.flatten())
    link = wp.empty(max(total, 1), dtype=wp.int32, device=device)
    step = wp.full((max(total, 1), depth), -1, dtype=wp.int32, device=device)
    wp.launch(fill_kernel, dim=dim, inputs=[begin, links, end.reshape(dim)], outputs=[link, step], device=device)
    found_link, found_step = to_host([link, step])
    return found_link[:total], found_step[:total], False


def _tree(pose: wp.array, sources: Sources, table: SurfaceTable, keys: wp.array, depth: int) -> Chains:
    """Return the candidates with planes and images of the transmitters."""
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
        found_link, found_step = to_host([link, step])
        yield found_link, found_step, True


def _bent(
    ends: LinkEnds, pose: wp.array, sources: Sources, table: SurfaceTable, chains: Chains, depth: int
) -> Iterator[Candidates]:
    """Yield the candidates of reflections and then a diffraction at an edge of the surface that the rays hit next."""
    device, cells = chains.key.device, chains.key.shape[0]
    first_link = wp.array(sources.first_link, dtype=wp.int32, device=device)
    inputs = [ends, table.device, table.wedges.device, pose, first_link, chains]
    yield from _counted_then_written(bend_kernel, inputs, cells, depth, device)


def _counted_then_written(kernel: wp.Kernel, inputs: list, cells: int, depth: int, device: str) -> Iterator[Candidates]:
    """Yield the output of a kernel that counts first and then writes; its last inputs are the mode and the sums of the
    counts."""
    count = wp.zeros(cells, dtype=wp.int32, device=device)
    link, step = wp.empty(1, dtype=wp.int32, device=device), wp.empty((1, depth), dtype=wp.int32, device=device)
    wp.launch(kernel, dim=cells, inputs=[*inputs, False, count], outputs=[count, link, step], device=device)
    end, total = _summed(count)
    if total == 0:
        return
    link = wp.empty(total, dtype=wp.int32, device=device)
    step = wp.full((total, depth), -1, dtype=wp.int32, device=device)
    wp.launch(kernel, dim=cells, inputs=[*inputs, True, end], outputs=[count, link, step], device=device)
    found_link, found_step = to_host([link, step])
    yield found_link, found_step, True


def _between(
    scene: DeviceScene,
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
    receiver = np.searchsorted(backward.sources.first_link, backward.place, side="right") - 1
    used = receiver[sources.first_link[0] : sources.first_link[-1]]  # sorted by slot, as the transmitters are
    low, high = int(used.min()), int(used.max()) + 1
    for part, begin, _, keys in launches(scene, backward.sources.part(low, high), table, config):
        tails.chains = _tree(pose, part, table, keys, depth)
        key, cell = _by_last_plane(tails.chains, depth)
        tails.key = wp.array(key, dtype=wp.int64, device=device)
        tails.cell = wp.array(cell, dtype=wp.int32, device=device)
        source = receiver - low - begin
        source = np.where((source >= 0) & (source < len(part)), source, -1)
        tails.source = wp.array(source, dtype=wp.int32, device=device)
        first_link = wp.array(sources.first_link, dtype=wp.int32, device=device)
        inputs = [ends, table.device, table.wedges.device, pose, first_link, chains, tails, depth]
        yield from _counted_then_written(join_kernel, inputs, cells, depth, device)


def _by_last_plane(chains: Chains, depth: int) -> tuple[np.ndarray, np.ndarray]:
    """Return source * K + last plane, and cell, of the candidates that leave room for a wedge and one more; sorted."""
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
