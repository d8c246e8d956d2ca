"""Launch a kernel again and again: what stays the same from launch to launch is packed once."""

import math
import threading
import weakref
from collections.abc import Sequence
from typing import Any

import warp as wp

_records = threading.local()
"""Last launch of each kernel, device and block size; threads have their own, as they change it."""


def launch_again(
    kernel: wp.Kernel, dim: Sequence[int], arguments: Sequence[Any], device: str, block_dim: int | None = None
) -> None:
    """Launch a kernel as `wp.launch` does, in a fraction of its time where most arguments are objects of the last one.

    Fields of structs may have changed since. Nothing is kept alive for the next launch.

    Args:
        kernel: The kernel.
        dim: Launch size.
        arguments: Inputs, then outputs.
        device: Warp device.
        block_dim: Threads of a block, see `wp.launch`.
    """
    if not math.prod(dim):
        return
    known = _records.__dict__.setdefault("launches", {})
    key = kernel, device, block_dim
    record, held, size = known.get(key, (None, [], ()))
    if record is None or kernel.module.load(record.device, record.block_dim) is not record.module_exec:
        record = wp.launch(kernel, dim, inputs=arguments, device=device, block_dim=block_dim, record_cmd=True)
        assert record is not None
        record.fwd_args = None  # they would be kept alive
        held = [_held(value) for value in arguments]
    else:
        for index, (old, new) in enumerate(zip(held, arguments, strict=True)):
            if old is not new and not (type(old) is weakref.ref and old() is new):
                record.set_param_at_index(index, new)
                held[index] = _held(new)
        if size != dim:
            record.set_dim(dim)
    known[key] = record, held, dim
    record.launch()


def _held(value: Any) -> Any:
    """Return a number as it is, and a weak reference to an array or struct."""
    return value if isinstance(value, (int, float)) else weakref.ref(value)
