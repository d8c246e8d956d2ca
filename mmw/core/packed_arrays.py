"""Put several small arrays into one block of memory: an allocation or a copy costs the same for one as for all."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from mmw.core.transfer import scalar_type, to_host

ALIGNMENT = 64
"""Start of each array in its block is a multiple of this [bytes]: no array shares a cache line with another."""

Layout = tuple[tuple[int, ...], Any]
"""Shape and Warp type of an array."""


class PackedArrays:
    """Device arrays in one block, with undefined values.

    Attributes:
        arrays: The arrays, which keep the block alive.
    """

    def __init__(self, device: str, layouts: Sequence[Layout]):
        """Allocate them.

        Args:
            device: Warp device.
            layouts: Shape and type of each.
        """
        self._layouts = layouts
        self._offsets, size = _offsets(layouts)
        self._block = wp.empty(size, dtype=wp.uint8, device=device)
        self.arrays = _views(self._block, layouts, self._offsets)

    def to_host(self) -> list[np.ndarray]:
        """Return all arrays on the host, by one copy; see `mmw.core.transfer.to_host`."""
        (block,) = to_host([self._block])
        return _host_views(block, self._layouts, self._offsets)


def upload_arrays(device: str, *parts: tuple[np.ndarray, Any]) -> list[wp.array]:
    """Return arrays on a device, by one copy.

    Args:
        device: Warp device.
        parts: Values and Warp type of each; a vector is the last axis of the values.
    """
    layouts = [(values.shape[: values.ndim - len(scalar_type(kind)[1])], kind) for values, kind in parts]
    offsets, size = _offsets(layouts)
    block = np.empty(size, dtype=np.uint8)
    for view, (values, _) in zip(_host_views(block, layouts, offsets), parts, strict=True):
        view[...] = values
    packed = wp.array(block, dtype=wp.uint8, device=device, copy=device != "cpu")
    return _views(packed, layouts, offsets)


def _offsets(layouts: Sequence[Layout]) -> tuple[list[int], int]:
    """Return where each array starts in the block, and the size of the block [bytes]."""
    offsets, end = [], 0
    for shape, kind in layouts:
        offsets.append(end)
        size = wp.types.type_size_in_bytes(kind)
        for extent in shape:
            size *= extent
        end += -(-size // ALIGNMENT) * ALIGNMENT
    return offsets, max(end, ALIGNMENT)


def _views(block: wp.array, layouts: Sequence[Layout], offsets: Sequence[int]) -> list[wp.array]:
    views = []
    for (shape, kind), offset in zip(layouts, offsets, strict=True):
        view = wp.array(ptr=block.ptr + offset, shape=shape, dtype=kind, device=block.device)
        view._ref = block  # the memory lives as long as one of its arrays
        views.append(view)
    return views


def _host_views(block: np.ndarray, layouts: Sequence[Layout], offsets: Sequence[int]) -> list[np.ndarray]:
    views = []
    for (shape, kind), offset in zip(layouts, offsets, strict=True):
        scalar, element = scalar_type(kind)
        views.append(np.ndarray((*shape, *element), scalar, block, offset))
    return views
