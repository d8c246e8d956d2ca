"""Replay launches that come again and again on the same arrays as one call, in the stream of the other work."""

from collections.abc import Callable, Hashable

import warp as wp

from mmw.core.recorded_work import prefers_records


class ReplayedLaunches:
    """Launches directly at the first call with a key, records the second one in a row, and replays it from then on.

    Only a GPU gains by it: on the CPU `mmw.core.repeated_launch` is as quick, so that every call launches directly
    there, and on a GPU that cannot record (`mmw.core.recorded_work.prefers_records`). The first call loads the kernels.
    """

    def __init__(self, device: str) -> None:
        """Hold no record yet."""
        self._device = device
        self._records = prefers_records(device)
        self._key: tuple[Hashable, ...] | None = None
        self._graph: wp.Graph | None = None

    def run(self, launch: Callable[[], None], *key: Hashable) -> None:
        """Do what `launch` does in the current stream of the device.

        Args:
            launch: Launches kernels and copies page-locked memory, on arrays that stay; nothing comes to the host.
            key: All numbers that decide what it launches.
        """
        if not self._records or key != self._key:
            self._key, self._graph = key, None
            launch()
            return
        if self._graph is None:
            with wp.ScopedCapture(self._device, force_module_load=False) as capture:
                launch()
            self._graph = capture.graph
        wp.capture_launch(self._graph)
