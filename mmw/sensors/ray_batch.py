"""Share parts of sensors that trace rays: the check of a batch's size, and empty arrays."""

from typing import Any

from mmw.core.errors import InputError
from mmw.core.packed_arrays import device_arrays

BLOCK_DIM = 64
"""Threads of a block for kernels that query a BVH, whose stacks lie in shared memory."""

MAX_COUNT = 2**31 - 1
"""Returns of one batch: they are counted in 32 bits."""


def check_count(sensor: str, views: int, rays: int, returns: int = 1) -> None:
    """Check that 32 bits count the returns of a batch.

    Raises:
        InputError: If they do not.
    """
    if views * rays * returns > MAX_COUNT:
        raise InputError(
            f"{sensor} batch of {views} views x {rays} rays; one launch holds {MAX_COUNT} returns; "
            "lower compute.batch_frames"
        )


def empty_struct(struct: Any, shape: int | tuple[int, ...], device: str, **shapes: int | tuple[int, ...]) -> Any:
    """Return a struct of arrays of one shape, but for those with a shape of their own; a kernel writes the values.

    The arrays lie in one block of memory: an allocation costs the same for one as for all.
    """
    names = list(struct.vars)
    layouts = [(_shape(shapes.get(name, shape)), struct.vars[name].type.dtype) for name in names]
    result = struct()
    for name, array in zip(names, device_arrays(device, layouts), strict=True):
        setattr(result, name, array)
    return result


def _shape(shape: int | tuple[int, ...]) -> tuple[int, ...]:
    return (shape,) if isinstance(shape, int) else shape
