"""Launch kernels again and again on the same arrays, without checking and packing their arguments each time."""

import math
from collections.abc import Sequence
from typing import Any

import warp as wp

KEPT_LAUNCHES = 64
"""Launches that one recorder keeps; design value."""


class LaunchRecorder:
    """Launches of kernels on a device, recorded at the first call with the same arguments.

    Arguments are told apart by being the same objects: arrays, structs and numbers that stay the same from call to
    call. What a struct holds, and the number of threads, may change in between. The recorder keeps them alive.
    """

    def __init__(self, device: str) -> None:
        """Record nothing yet."""
        self._device = device
        self._recorded: dict[tuple[int, ...], tuple[wp.Launch, Any]] = {}

    def launch(
        self,
        kernel: wp.Kernel,
        dim: tuple[int, ...],
        inputs: Sequence[Any],
        outputs: Sequence[Any],
        block_dim: int | None = None,
    ) -> None:
        """Launch a kernel as `wp.launch` does; a launch of no threads does nothing."""
        if not math.prod(dim):
            return
        key = tuple(map(id, (kernel, *inputs, *outputs)))
        found = self._recorded.get(key)
        if found is None:
            launch = wp.launch(kernel, dim, inputs, outputs, device=self._device, block_dim=block_dim, record_cmd=True)
            assert launch is not None  # it has threads
            if len(self._recorded) >= KEPT_LAUNCHES:
                self._recorded.clear()
            found = self._recorded[key] = launch, [dim, kernel, inputs, outputs]
        launch, kept = found
        if kept[0] != dim:
            launch.set_dim(dim)
            kept[0] = dim
        launch.launch()
