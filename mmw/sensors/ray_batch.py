"""Share parts of sensors that trace rays: the check of a batch's size, and empty arrays."""

from typing import Any

from mmw.core.errors import InputError
from mmw.core.recorded_work import NewArrays

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
    """Return a struct of new arrays, see `NewArrays.struct`; a kernel writes the values."""
    return NewArrays(device).struct(struct, shape, **shapes)
