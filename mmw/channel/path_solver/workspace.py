"""Keep the memory of searches of one shape, and record what they launch."""

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any

import warp as wp

from mmw.core.packed_arrays import Layout, PackedArrays, borrow_arrays
from mmw.core.recorded_work import KeptArrays
from mmw.kernels.channel.link_order import LINK_KEYS

MAX_KEPT_LINKS = 64
"""Most links of a search whose memory and records are kept for the next one of its shape: with more, the host's time
counts little. Design value."""

RECORD_BYTES = 1 << 27
"""Most memory of the arrays of a record [bytes]: what takes more is launched directly. Design value."""

MAX_RECORDS = 8
"""Most records of a workspace: all are dropped beyond. Design value."""


class Workspace:
    """Memory of one search at a time for some number of links and poses, and its records.

    Attributes:
        given: Block for `GivenLinks` and `LinkOrder` on the host.
        links: Block for `OrderedLinks`.
        is_kept: Whether the workspace is for further searches too.
    """

    def __init__(self, device: str, links: int, poses: tuple[int, int]) -> None:
        """Allocate for a number of links and a shape of poses [S, V]."""
        self._device = device
        self.is_kept = links <= MAX_KEPT_LINKS
        layouts = given_layouts(links, poses), ordered_layouts(links, poses)
        if self.is_kept:
            self.given, self.links = PackedArrays("cpu", layouts[0]), PackedArrays(device, layouts[1], is_pinned=True)
        else:
            self.given, self.links = borrow_arrays("cpu", *layouts[0]), borrow_arrays(device, *layouts[1])
        self._records: dict[Hashable, _Record] = {}

    def release(self) -> None:
        """Give the blocks back where the workspace is not kept."""
        if not self.is_kept:
            self.given.release()
            self.links.release()

    def run(self, key: Hashable, launch: Callable[[KeptArrays | None, bool], Any]) -> Any:
        """Launch, or replay what was launched with a key, and return what `launch` returned.

        The first launch with a key loads the kernels and makes all arrays, the second one is recorded.

        Args:
            key: All that decides what is launched.
            launch: Launches kernels, given a source of all arrays that it needs, None for any, and whether a record is
                made: neither waits then, nor copies to or from the host but within blocks of that source or this
                workspace.
        """
        record = self._records.get(key)
        if record is None:
            arrays = KeptArrays(self._device)
            result = launch(arrays, False)
            if len(self._records) >= MAX_RECORDS:
                self._records.clear()
            is_small = arrays.size <= RECORD_BYTES
            self._records[key] = _Record(arrays, result) if is_small else _Record(None, None)
            return result
        if record.arrays is None:
            return launch(None, False)
        if record.graph is None:
            record.arrays.rewind()
            with wp.ScopedCapture(self._device, force_module_load=False) as capture:
                record.result = launch(record.arrays, True)
            record.graph = capture.graph
        wp.capture_launch(record.graph)
        return record.result


@dataclass
class _Record:
    """Launches of one key."""

    arrays: KeptArrays | None
    """None where they would take too much memory, so that nothing is recorded."""
    result: Any
    graph: wp.Graph | None = None


def given_layouts(links: int, poses: tuple[int, int]) -> tuple[Layout, ...]:
    """Return layouts of `GivenLinks` and `LinkOrder` for a number of links and a shape of poses [S, V]."""
    ints, vectors = ((links,), wp.int32), ((links,), wp.vec3d)
    given = ints, vectors, vectors, (poses, wp.transformd)
    return *given, ((links, LINK_KEYS), wp.float64), ints, ints, ((1,), wp.int32)


def ordered_layouts(links: int, poses: tuple[int, int]) -> tuple[Layout, ...]:
    """Return layouts of `OrderedLinks` for a number of links and a shape of poses [S, V]."""
    ints, ends = ((links,), wp.int32), ((links, poses[1] + 1), wp.vec3d)
    places = ((links,), wp.vec3), ((links,), wp.vec3d)
    return ints, ints, ends, ends, ints, *places, ((links + 1,), wp.int32), (poses, wp.transformd)
