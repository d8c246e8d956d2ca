"""Read path candidates of links from kernels: some count first and then write, others fill what was counted.

Of all pairs of a link and something else, kernels list those that they select.
"""

from collections.abc import Iterator, Sequence

import numpy as np
import warp as wp

from mmw.channel.path_solver.search import Search
from mmw.core.transfer import to_host

Candidates = tuple[np.ndarray, np.ndarray, bool]
"""Links, shape [C]; interactions from transmitter to receiver, shape [C, D], int32: a surface or a plane, -2 - wedge,
or -1 behind the end; and whether it is planes."""

PAIRS_AT_ONCE = 2**28
"""Pairs that are tested in one launch: lists of those that are selected, a few of a hundred, fit into memory."""

FIRST_PAIRS = 2**18
"""Pairs that a launch has room for, until one selects more."""


def selected_pairs(search: Search, kernel: wp.Kernel, inputs: list, dim: Sequence) -> tuple[np.ndarray, np.ndarray]:
    """Return the pairs that a kernel selects, sorted, shape [N] each.

    Args:
        search: Device, and lengths of lists that were enough so far.
        kernel: Its outputs are those of `mmw.kernels.channel.selected_pairs.select_pair`.
        inputs: Its inputs.
        dim: Launch size.
    """
    device, sizes = search.scene.device, search.table.sizes
    while True:
        room = sizes.get(kernel.key, FIRST_PAIRS)
        count, pair = search.scratch((1,), wp.int32), search.scratch((room, 2), wp.int32)
        count.zero_()
        wp.launch(kernel, dim=dim, inputs=inputs, outputs=[count, pair], device=device)
        size = int(count.numpy()[0])
        if size <= room:
            break
        sizes[kernel.key] = 2 * size
    row, column = pair[:size].numpy().T if size else np.zeros((2, 0), dtype=np.int32)
    order = np.lexsort((column, row))  # threads write in any order
    return row[order], column[order]


def count_then_write(
    search: Search, kernel: wp.Kernel, inputs: list, dim: Sequence[int], is_plane: bool
) -> Iterator[Candidates]:
    """Yield the output of a kernel that counts first and then writes.

    Args:
        search: Device and depth.
        kernel: Its inputs end with whether it writes, and the inclusive sums of the counts; its outputs are the counts,
            shape `dim`, links and steps.
        inputs: Its other inputs.
        dim: Launch size.
        is_plane: Whether the steps are planes.
    """
    device, depth = search.scene.device, max(1, search.config.max_depth)
    count = wp.zeros(dim, dtype=wp.int32, device=device)
    link, step = wp.empty(1, dtype=wp.int32, device=device), wp.empty((1, depth), dtype=wp.int32, device=device)
    wp.launch(kernel, dim=dim, inputs=[*inputs, False, count], outputs=[count, link, step], device=device)
    end, total = prefix_sum(count.flatten())
    yield from write_candidates(search, kernel, [*inputs, True, end.reshape(dim)], [count], dim, total, is_plane)


def write_candidates(
    search: Search, kernel: wp.Kernel, inputs: list, outputs: list, dim: Sequence, total: int, is_plane: bool
) -> Iterator[Candidates]:
    """Yield the `total` candidates that a kernel writes, if there are any."""
    if total:
        device = search.scene.device
        link = wp.empty(total, dtype=wp.int32, device=device)
        step = wp.full((total, max(1, search.config.max_depth)), -1, dtype=wp.int32, device=device)
        wp.launch(kernel, dim=dim, inputs=inputs, outputs=[*outputs, link, step], device=device)
        found_link, found_step = to_host([link, step])
        yield found_link, found_step, is_plane


def prefix_sum(count: wp.array) -> tuple[wp.array, int]:
    """Return the inclusive sums of counts, and the whole."""
    end = wp.empty_like(count)
    wp.utils.array_scan(count, end, inclusive=True)
    return end, int(end[-1:].numpy()[0])
