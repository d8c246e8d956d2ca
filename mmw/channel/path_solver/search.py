"""Prepare a search for paths: links in the order of their transmitters, poses, and the surfaces of the scene."""

from collections.abc import Callable, Hashable, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cache, cached_property
from math import prod
from typing import Any, TypeVar

import numpy as np
import warp as wp

from mmw.channel.links import Links
from mmw.channel.path_solver.surface_table import SurfaceTable
from mmw.channel.path_solver.workspace import Workspace, given_layouts, ordered_layouts
from mmw.config import ChannelConfig
from mmw.core.packed_arrays import Layout, PackedArrays, borrow_arrays
from mmw.core.recorded_work import KeptArrays
from mmw.core.repeated_launch import launch_again
from mmw.core.transfer import scalar_type
from mmw.kernels.channel.link_order import GivenLinks, LinkOrder, OrderedLinks, order_links_kernel
from mmw.kernels.channel.surfaces import LinkEnds
from mmw.scene.device_scene import DeviceScene

T = TypeVar("T")

WORKSPACE_KINDS = 4
"""Most shapes of searches whose memory is kept; design value."""

SCRATCH_BYTES = 1 << 22
"""Largest array of a search that is kept for the next one [bytes]: an allocation costs what a kernel takes to fill some
megabytes. Design value."""

SCRATCH_ARRAYS = 32
"""Most arrays that a search holds to the end for the next one; design value."""

SCRATCH_KINDS = 64
"""Most combinations of shape and type of which arrays are kept; design value."""


@dataclass(frozen=True)
class Sources:
    """The transmitters of a batch, one row a frame and actor, with their links one after the other."""

    batch_index: np.ndarray
    """Position of each source's frame in the batch, shape [A], int32."""
    position: np.ndarray
    """World frame [m], shape [A, 3]."""
    origin: np.ndarray
    """Start of its rays, scene frame [m], shape [A, 3], float32."""
    first_link: np.ndarray
    """First link of each source, and the number of links, shape [A + 1], int32."""
    device: tuple[wp.array, ...]
    """Batch index, position in the scene frame and in the world [m], and first links on the device, until the search
    is released; they may be longer."""

    def __len__(self) -> int:
        return len(self.batch_index)

    def part(self, begin: int, end: int) -> "Sources":
        """Return some of the sources; links keep their numbers."""
        if begin == 0 and end == len(self):
            return self
        ends = (end, end, end, end + 1)
        return Sources(
            self.batch_index[begin:end],
            self.position[begin:end],
            self.origin[begin:end],
            self.first_link[begin : end + 1],
            tuple(array[begin:stop] for array, stop in zip(self.device, ends, strict=True)),
        )


@dataclass(frozen=True)
class SortedLinks:
    """Links in the order of their sources."""

    order: np.ndarray
    """Row of each among the links that were sorted, shape [L]."""
    sources: Sources
    ends: LinkEnds
    """Both ends of every link on the device; `tx` are the sources."""
    host_pose: np.ndarray
    """Instance-to-world poses with unit quaternions, shape [S, V, 7]."""
    pose: wp.array
    """The same on the device, shape [S, V]."""


class Search:
    """Input of every step of a search for paths.

    Attributes:
        scene: The scene with the batch of the links loaded.
        links: The links.
        config: Rays, candidate mode, depth, and which interactions are wanted.
        table: Surfaces of the scene, with their wedges if diffraction is wanted.
        host_pose: Instance-to-world poses with unit quaternions, shape [S, V, 7]; NaN for absent instances.
        outlines: Outlines of the planes on the device, empty where surfaces are infinite.
        rows: Row of `scene.arrays.poses` of each frame of the batch, shape [S].
        order: Row of each link in the order of the transmitters, shape [L].
        sources: The transmitters.
    """

    def __init__(self, scene: DeviceScene, links: Links, config: ChannelConfig, table: SurfaceTable):
        """Sort the links and upload the poses; the arguments are the attributes of these names."""
        self.scene, self.links, self.config, self.table = scene, links, config, table
        self._blocks: list[PackedArrays] = []
        self._scratch: list[tuple[tuple[tuple[int, ...], Any], wp.array]] = []
        self._kept: KeptArrays | None = None
        self._is_recording = False
        self.outlines = table.outlines_on_device(scene.device, config.carriers_hz)
        self.rows = scene.arrays.frame_rows(scene.batch_frames)
        self._shape = len(links), (len(self.rows), len(scene.instance_actor))
        free = table.workspaces.get(self._shape)
        self._space = free.pop() if free else Workspace(scene.device, *self._shape)
        ends = links.batch_index, links.tx.position, links.rx.position
        self._forward = self._sorted(self._space.given, self._space.links, *ends)
        self._is_uploaded = False
        self.order, self.sources = self._forward.order, self._forward.sources
        self.host_pose = self._forward.host_pose.copy()

    @property
    def forward(self) -> SortedLinks:
        """The links in the order of their transmitters."""
        if not self._is_uploaded:
            self.upload_links()
        return self._forward

    @property
    def pose(self) -> wp.array:
        """The poses on the device, shape [S, V]."""
        return self.forward.pose

    def upload_links(self) -> None:
        """Copy links and poses to the device, which needs no call but in what is recorded."""
        self._space.links.upload()
        self._is_uploaded = True

    def run(self, key: Hashable | None, launch: Callable[[], T]) -> T:
        """Launch, or replay what was launched with a key, and return what `launch` returned.

        Args:
            key: All that decides what is launched, beside the numbers of links and poses; None where nothing is
                recorded.
            launch: Launches kernels by `launch` of this search, on its arrays and scratch. With a key, it begins with
                `upload_links` and neither waits nor copies to or from the host but by `PackedArrays.fetch`.
        """
        if key is None:
            return launch()

        def launch_on(kept: KeptArrays | None, is_recording: bool) -> T:
            self._kept, self._is_recording = kept, is_recording
            try:
                return launch()
            finally:
                self._kept, self._is_recording = None, False

        result = self._space.run(key, launch_on)
        self._is_uploaded = True
        return result

    def launch(
        self, kernel: wp.Kernel, dim: Sequence[int], arguments: Sequence[Any], block_dim: int | None = None
    ) -> None:
        """Launch a kernel on the device of the scene, see `launch_again`."""
        if self._is_recording:
            wp.launch(kernel, dim, arguments, device=self.scene.device, block_dim=block_dim)
        else:
            launch_again(kernel, dim, arguments, self.scene.device, block_dim)

    @cached_property
    def rank(self) -> np.ndarray:
        """Place of each link in the order of `forward`, shape [L], int32."""
        rank = np.empty(len(self.links), dtype=np.int32)
        rank[self.order] = np.arange(len(self.links))
        return rank

    def pattern_count(self, depth: int) -> int:
        """Return how many ways there are for a ray to go through its surfaces or off them, for rays that follow `depth`
        of them; one launch each."""
        return 2 ** (depth - 1) if self.config.refraction and self.table.has_slabs else 1

    def scratch(self, shape: tuple[int, ...], kind: Any) -> wp.array:
        """Return an array on the device until `release`, with undefined values; small ones are used again."""
        if self._kept is not None:
            return self._kept.empty(shape, kind)
        size = wp.types.type_size_in_bytes(kind) * prod(shape)
        if size > SCRATCH_BYTES or len(self._scratch) >= SCRATCH_ARRAYS:
            return wp.empty(shape, dtype=kind, device=self.scene.device)
        free = self.table.scratch.get((shape, kind))
        array = free.pop() if free else wp.empty(shape, dtype=kind, device=self.scene.device)
        self._scratch.append(((shape, kind), array))
        return array

    def borrow(self, *layouts: Layout, is_scratch: bool = False) -> PackedArrays:
        """Return a block of arrays until `release`, see `borrow_arrays`."""
        if self._kept is not None:
            return self._kept.block(layouts, is_scratch=is_scratch)
        block = borrow_arrays(self.scene.device, *layouts, is_scratch=is_scratch)
        self._blocks.append(block)
        return block

    def once(self, name: str, make: Callable[[], T]) -> T:
        """Return what a function makes; recorded launches keep it."""
        return make() if self._kept is None else self._kept.once(name, make)

    def upload(self, *parts: tuple[np.ndarray, Any]) -> PackedArrays:
        """Return arrays on the device until `release`: values and Warp type of each."""
        layouts = [(values.shape[: values.ndim - len(scalar_type(kind)[1])], kind) for values, kind in parts]
        block = self.borrow(*layouts)
        for view, (values, _) in zip(block.host, parts, strict=True):
            view[...] = values
        block.upload()
        return block

    def release(self) -> None:
        """Give all arrays back, after the last launch; what is sorted and on the device is gone."""
        for block in self._blocks:
            block.release()
        self._blocks.clear()
        if len(self.table.scratch) > SCRATCH_KINDS:
            self.table.scratch.clear()
        for key, array in self._scratch:
            self.table.scratch.setdefault(key, []).append(array)
        self._scratch.clear()
        self._space.release()
        if self._space.is_kept:
            if len(self.table.workspaces) > WORKSPACE_KINDS:
                self.table.workspaces.clear()
            self.table.workspaces.setdefault(self._shape, []).append(self._space)
        del self._space, self._forward, self.order, self.sources

    def with_rays(self, rays: int) -> "Search":
        """Return the same search with another number of rays a transmitter."""
        other = copy(self)
        other.config = self.config.model_copy(update={"samples_per_tx": rays})
        return other

    def backward(self) -> tuple[SortedLinks, np.ndarray]:
        """Return the reversed links, and the row of each in the order of the transmitters, shape [L]."""
        return self.sorted_part(np.arange(len(self.links)), is_reversed=True)

    def sorted_part(self, rows: np.ndarray, *, is_reversed: bool) -> tuple[SortedLinks, np.ndarray]:
        """Return some of the links, and the row of each in the order of the transmitters, shape [n].

        Args:
            rows: The links, shape [n].
            is_reversed: Whether the receivers are the sources.
        """
        ends = self.links.tx.position[rows], self.links.rx.position[rows]
        links = self.sort(self.links.batch_index[rows], *(ends[::-1] if is_reversed else ends))
        return links, self.rank[rows[links.order]]

    def sort(self, batch_index: np.ndarray, tx: np.ndarray, rx: np.ndarray) -> SortedLinks:
        """Return links, from `tx` to `rx` [m], in an order that brings those of one transmitter together."""
        given = borrow_arrays("cpu", *given_layouts(len(batch_index), self._shape[1]))
        self._blocks.append(given)
        block = self.borrow(*ordered_layouts(len(batch_index), self._shape[1]))
        links = self._sorted(given, block, batch_index, tx, rx)
        block.upload()
        return links

    def _sorted(
        self, given: PackedArrays, links: PackedArrays, batch_index: np.ndarray, tx: np.ndarray, rx: np.ndarray
    ) -> SortedLinks:
        """Return `sort` in blocks of a workspace, without the upload."""
        scene = self.scene
        inputs = batch_index, tx, rx, scene.arrays.poses.take(self.rows, axis=0).take(scene.instance_actor, axis=1)
        for target, values in zip(given.host, inputs, strict=False):
            target[...] = values
        arguments = [
            given.struct(GivenLinks, *_GIVEN),
            vector(*scene.origin.tolist()),
            given.struct(LinkOrder, *_ORDER),
            links.struct(OrderedLinks, *OrderedLinks.vars, on_host=True),
        ]
        launch_again(order_links_kernel, (1,), arguments, "cpu")
        *_, order, sources = given.host
        number = int(sources[0])
        *_, batch_index, origin, position, first_link, host_pose = links.host
        return SortedLinks(
            order,
            Sources(
                batch_index[:number],
                position[:number],
                origin[:number],
                first_link[: number + 1],
                tuple(links.arrays[4:8]),
            ),
            links.struct(LinkEnds, *_ENDS),
            host_pose,
            links.arrays[-1],
        )


_GIVEN, _ORDER = (*GivenLinks.vars, *4 * (None,)), (*4 * (None,), *LinkOrder.vars)
"""Fields of structs for each array of `given_layouts`."""

_ENDS = (*LinkEnds.vars, *5 * (None,))
"""Fields of a struct for each array of `ordered_layouts`."""


@cache
def vector(x: float, y: float, z: float) -> wp.vec3d:
    """Return a vector for kernels."""
    return wp.vec3d(x, y, z)
