"""Put several small arrays into one block of memory: an allocation or a copy costs the same for one as for all."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from functools import cache, cached_property
from typing import Any, TypeVar

import numpy as np
import warp as wp

from mmw.core.transfer import scalar_type, to_host

T = TypeVar("T")

ALIGNMENT = 64
"""Start of each array in its block is a multiple of this [bytes]: no array shares a cache line with another."""

KEPT_BYTES = 1 << 18
"""Largest block that is kept to be borrowed again [bytes]: larger ones cost more to use than to allocate. Design
value."""

KEPT_SCRATCH_BYTES = 1 << 27
"""The same for blocks without a host side, of which one of each kind is kept if it is larger; design value."""

KEPT_KINDS = 256
"""Most combinations of device and layouts of which blocks are kept; design value."""

Layout = tuple[tuple[int, ...], Any]
"""Shape and Warp type of an array; a vector is the last axis of the values on the host."""

HostViews = Callable[[np.ndarray], list[np.ndarray]]
"""Returns the arrays in a block of bytes on the host."""

_free: dict[tuple[str, tuple[Layout, ...], bool], deque["PackedArrays"]] = {}
"""Blocks that nobody uses."""


class PackedArrays:
    """Arrays in one block on a device and one on the host, with undefined values at first.

    On the CPU both are the same memory. On a GPU `upload` and `download` copy between the two; scratch is on the device
    only.

    Attributes:
        arrays: The arrays on the device.
        host: The arrays on the host, to be written before `upload`.
        is_kept: Whether the block is small enough to be kept for later.
    """

    def __init__(self, device: str, layouts: tuple[Layout, ...], is_scratch: bool = False, *, is_pinned: bool = False):
        """Allocate them; see `borrow_arrays` for arrays that are needed again and again.

        Args:
            device: Warp device.
            layouts: Shape and type of each array.
            is_scratch: Whether the host never sees them.
            is_pinned: Whether the host's memory is page-locked at any size, so that a record can copy it.
        """
        self._key = device, layouts, is_scratch
        self._offsets, size = _offsets(layouts)
        self._block = self._twin = _memory(size, device)
        self._is_large = size > KEPT_BYTES
        self.is_kept = not self._is_large or (is_scratch and size <= KEPT_SCRATCH_BYTES)
        self._is_pinned = self.is_kept or is_pinned
        self.arrays = _views(self._block, layouts, self._offsets)
        self.host: list[np.ndarray] = []
        if not is_scratch:
            if wp.get_device(device).is_cuda:  # page-locked memory is quick to copy and slow to allocate
                self._twin = _memory(size, "cpu", pinned=self._is_pinned)
            self.host = _host_views(self._twin.numpy(), layouts, self._offsets)
        self._structs: dict[tuple[Any, bool], Any] = {}

    def upload(self, stream: wp.Stream | None = None) -> list[wp.array]:
        """Copy the block to the device, in its current stream if none is given, and return the arrays there."""
        if self._twin is not self._block:
            wp.copy(self._block, self._twin, stream=stream)
        return self.arrays

    def queue_download(self) -> None:
        """Queue the copy to the host in the device's current stream; `download` copies a large block itself."""
        if self._twin is not self._block and self._is_pinned:
            wp.copy(self._twin, self._block)

    def download(self, *, is_queued: bool = False) -> list[np.ndarray]:
        """Copy the block to the host, if `queue_download` has not, wait for that, and return the arrays there."""
        if self._twin is self._block:
            return self.host
        if not self._is_pinned:
            return _host_views(to_host([self._block])[0], self._key[1], self._offsets)
        if not is_queued:
            self.queue_download()
        wp.synchronize_stream(wp.get_stream(self._block.device))
        return self.host

    @property
    def size(self) -> int:
        """Memory of the block on the device [bytes]."""
        return self._block.size * ALIGNMENT

    @cached_property
    def host_arrays(self) -> list[wp.array]:
        """The arrays of `host`, for kernels that run on the CPU."""
        if self._twin is self._block:
            return self.arrays
        return _views(self._twin, self._key[1], self._offsets)

    def struct(self, kind: Callable[[], Any], *names: str | None, on_host: bool = False) -> Any:
        """Return a Warp struct that has the arrays as fields of these names, in their order, but those of None.

        It is made once for a block.

        Args:
            kind: The struct.
            names: Its field for each array.
            on_host: Whether the arrays are those of `host_arrays`.
        """
        key = kind, on_host
        if key not in self._structs:
            made = kind()
            for name, array in zip(names, self.host_arrays if on_host else self.arrays, strict=True):
                if name is not None:
                    setattr(made, name, array)
            self._structs[key] = made
        return self._structs[key]

    def release(self) -> None:
        """Give the block back: neither its arrays nor their host views are used any more, by work in any stream."""
        if self.is_kept:
            if len(_free) > KEPT_KINDS:
                _free.clear()
            free = _free.setdefault(self._key, deque())
            if not (free and self._is_large):
                free.append(self)


def borrow_arrays(device: str, *layouts: Layout, is_scratch: bool = False) -> PackedArrays:
    """Return a block of arrays with undefined values, one that was released if there is one.

    Args:
        device: Warp device.
        layouts: Shape and type of each array.
        is_scratch: Whether the host never sees them.
    """
    free = _free.get((device, layouts, is_scratch))
    return (None if free is None else take_free(free)) or PackedArrays(device, layouts, is_scratch)


def take_free(free: deque[T]) -> T | None:
    """Return one of those that nobody uses, None if there are none; any thread may take the last one at any time."""
    try:
        return free.pop()
    except IndexError:
        return None


def device_arrays(device: str, layouts: Sequence[Layout]) -> list[wp.array]:
    """Return arrays with undefined values in one block on a device, which is freed with the last of them.

    Args:
        device: Warp device.
        layouts: Shape and type of each array.
    """
    offsets, size = _offsets(layouts)
    return _views(_memory(size, device), layouts, offsets)


def packed_block(device: str, layouts: Sequence[Layout]) -> tuple[wp.array, list[wp.array], HostViews]:
    """Return a block of memory on a device, arrays that share it, and what finds them in a copy of it on the host.

    Args:
        device: Warp device.
        layouts: Shape and type of each array.
    """
    offsets, size = _offsets(layouts)
    block = _memory(size, device)
    return block, _views(block, layouts, offsets), lambda host: _host_views(host, layouts, offsets)


def padded_count(count: int) -> int:
    """Return a number of rows of at least `count`, one of few, so that blocks of similar sizes are used again."""
    return count if count > KEPT_BYTES else max(64, 1 << (count - 1).bit_length())


def _memory(size: int, device: str, *, pinned: bool = False) -> wp.array:
    """Return memory of a number of bytes, a multiple of `ALIGNMENT`, as large elements: Warp counts them in 31 bits."""
    return wp.empty(size // ALIGNMENT, dtype=wp.mat44, device=device, pinned=pinned)


@cache
def _size_of(kind: Any) -> int:
    return wp.types.type_size_in_bytes(kind)


def _offsets(layouts: Sequence[Layout]) -> tuple[list[int], int]:
    """Return where each array starts in the block, and the size of the block [bytes]."""
    offsets, end = [], 0
    for shape, kind in layouts:
        offsets.append(end)
        size = _size_of(kind) * math.prod(shape)
        end += -(-size // ALIGNMENT) * ALIGNMENT
    return offsets, max(end, ALIGNMENT)


def _views(block: wp.array, layouts: Sequence[Layout], offsets: Sequence[int]) -> list[wp.array]:
    views = []
    for (shape, kind), offset in zip(layouts, offsets, strict=True):
        view = wp.array(ptr=(block.ptr or 0) + offset, shape=shape, dtype=kind, device=block.device)
        view._ref = block  # the memory lives as long as one of its arrays
        views.append(view)
    return views


def _host_views(block: np.ndarray, layouts: Sequence[Layout], offsets: Sequence[int]) -> list[np.ndarray]:
    views = []
    for (shape, kind), offset in zip(layouts, offsets, strict=True):
        scalar, element = scalar_type(kind)
        views.append(np.ndarray((*shape, *element), scalar, block, offset))
    return views
