"""Copy arrays from the device to the host through a pool of page-locked buffers."""

import weakref
from collections import deque
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
import warp as wp

POOL_BYTES = 4 << 30
"""Maximum page-locked memory of a process [bytes]: further arrays are copied through pageable memory, about ten times
slower. One batch of 64 frames of four LiDARs of 30,016 rays takes 0.17 GB in one weather."""

ROUND_BYTES = 1 << 20
"""Granularity of buffer sizes [bytes]."""

_free: deque[wp.array] = deque()
"""Free buffers. Finalizers append to it in any thread."""

_allocated = 0
"""Total size of all buffers [bytes]; only one thread copies arrays."""


class HostCopy:
    """Asynchronous copy of device arrays to the host. They must not change before `wait`, whatever else is launched."""

    def __init__(self, arrays: Sequence[wp.array], stream: wp.Stream | None = None, *, is_new: bool = False) -> None:
        """Queue the copies.

        Args:
            arrays: Arrays of one device.
            stream: Stream that the copies go into; None: they come after all work launched so far, in their own one.
            is_new: Whether `wait` copies arrays of the CPU too, rather than share them.
        """
        self._arrays, self._is_new = arrays, is_new
        self._pinned: list[np.ndarray | None] = [None] * len(arrays)
        self._stream: wp.Stream | None = None
        self._is_over = False
        if arrays and (device := wp.get_device(arrays[0].device)).is_cuda:
            if stream is None:
                stream = _copy_stream(device.alias)
                stream.wait_stream(wp.get_stream(device))
            self._stream = stream
            self._pinned = [_pinned(array, stream) for array in arrays]

    def close(self) -> None:
        """Wait where nobody has: the buffers are free then."""
        if self._stream is not None and not self._is_over:
            wp.synchronize_stream(self._stream)
        self._is_over = True

    def wait(self) -> list[np.ndarray]:
        """Wait, and return the arrays; see `to_host`."""
        self.close()
        if self._stream is None and self._is_new:
            return [array.numpy().copy() for array in self._arrays]
        return [array.numpy() if view is None else view for array, view in zip(self._arrays, self._pinned, strict=True)]


@cache
def _copy_stream(device: str) -> wp.Stream:
    """Return a device's stream for copies, for which other work does not wait."""
    return wp.Stream(device)


def to_host(arrays: Sequence[wp.array]) -> list[np.ndarray]:
    """Return device arrays as NumPy arrays, after a single synchronization.

    Arrays of a GPU become views of page-locked buffers; a buffer is free again when its last view is deleted. Arrays
    of the CPU are shared, not copied.
    """
    return HostCopy(arrays).wait()


def numpy_type(array: wp.array) -> tuple[np.dtype, tuple[int, ...]]:
    """Return the NumPy type of an array's scalars, and the shape of an element: empty, or that of a vector."""
    return scalar_type(array.dtype)


@cache
def scalar_type(kind: Any) -> tuple[np.dtype, tuple[int, ...]]:
    """Return the NumPy type of the scalars of a Warp type, and the shape of an element: empty, or that of a vector."""
    scalar = getattr(kind, "_wp_scalar_type_", kind)
    return np.dtype(wp.dtype_to_numpy(scalar)), getattr(kind, "_shape_", ())


def queue_bytes(source: wp.array, size: int, stream: wp.Stream) -> np.ndarray | None:
    """Queue the copy of the first bytes of an array of a GPU, `uint8`, to a page-locked buffer; return them there.

    They are undefined until the stream is waited for, and the buffer is free again as that of `to_host`. None if the
    pool is full.
    """
    buffer = _allocate(size)
    if buffer is None:
        return None
    wp.copy(buffer, source, count=size, stream=stream)
    whole = buffer.numpy()
    weakref.finalize(whole, _free.append, buffer)
    return whole[:size]


def _pinned(array: wp.array, stream: wp.Stream) -> np.ndarray | None:
    """Queue the copy of an array to a page-locked buffer and return its view; None if the pool is full."""
    size = array.size * wp.types.type_size_in_bytes(array.dtype)
    if size == 0:
        return None
    values = queue_bytes(wp.array(ptr=array.ptr, shape=size, dtype=wp.uint8, device=array.device), size, stream)
    kind, element = numpy_type(array)
    return None if values is None else values.view(kind).reshape(*array.shape, *element)


def _allocate(size: int) -> wp.array | None:
    """Return a free buffer of at least and less than about twice a size, or a new one; None if the pool is full."""
    global _allocated
    free = [_free.popleft() for _ in range(len(_free))]
    fitting = min((b for b in free if size <= b.size <= 2 * size + ROUND_BYTES), key=lambda b: b.size, default=None)
    needed = -(-size // ROUND_BYTES) * ROUND_BYTES
    if fitting is None:
        while free and _allocated + needed > POOL_BYTES:  # release buffers of other sizes
            _allocated -= free.pop(0).size
    _free.extend(buffer for buffer in free if buffer is not fitting)
    if fitting is None and _allocated + needed <= POOL_BYTES:
        fitting = wp.empty(needed, dtype=wp.uint8, device="cpu", pinned=True)
        _allocated += needed
    return fitting
