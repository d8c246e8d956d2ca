"""Prepare a search for paths: links in the order of their transmitters, poses, and the surfaces of the scene."""

from copy import copy
from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np
import warp as wp

from mmw.channel.links import Links
from mmw.channel.path_solver.surface_table import SurfaceTable
from mmw.config import ChannelConfig
from mmw.core.packed_arrays import Layout, PackedArrays, borrow_arrays
from mmw.core.transfer import scalar_type
from mmw.core.transforms import conjugate, normalize, rotate
from mmw.kernels.channel.surfaces import LinkEnds
from mmw.scene.device_scene import DeviceScene

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
    first_link: np.ndarray
    """First link of each source, and the number of links, shape [A + 1], int32."""
    device: tuple[wp.array, ...] = ()
    """These arrays on the device, where they are there already, see `Search.source_arrays`."""

    def __len__(self) -> int:
        return len(self.batch_index)

    def part(self, begin: int, end: int) -> "Sources":
        """Return some of the sources; links keep their numbers."""
        if begin == 0 and end == len(self):
            return self
        return Sources(self.batch_index[begin:end], self.position[begin:end], self.first_link[begin : end + 1])


@dataclass(frozen=True)
class SortedLinks:
    """Links in the order of their sources."""

    order: np.ndarray
    """Row of each among the links that were sorted, shape [L]."""
    sources: Sources
    ends: LinkEnds
    """Both ends of every link on the device; `tx` are the sources."""


class Search:
    """Input of every step of a search for paths.

    Attributes:
        scene: The scene with the batch of the links loaded.
        links: The links.
        config: Rays, candidate mode, depth, and which interactions are wanted.
        table: Surfaces of the scene, with their wedges if diffraction is wanted.
        host_pose: Instance-to-world poses with unit quaternions, shape [S, V, 7]; NaN for absent instances.
        pose: The same on the device, shape [S, V].
        outlines: Outlines of the planes on the device, empty where surfaces are infinite.
        forward: The links in the order of their transmitters.
        rank: Place of each link in that order, shape [L], int32.
    """

    def __init__(self, scene: DeviceScene, links: Links, config: ChannelConfig, table: SurfaceTable):
        """Sort the links and upload the poses; the arguments are the attributes of these names."""
        self.scene, self.links, self.config, self.table = scene, links, config, table
        rows = [scene.arrays.frame_row(frame) for frame in scene.batch_frames]
        self.host_pose = scene.arrays.poses[rows][:, scene.instance_actor]
        self.host_pose[..., 3:] = normalize(self.host_pose[..., 3:])
        back = conjugate(self.host_pose[..., 3:])
        self._inverse = back, -rotate(back, self.host_pose[..., :3])
        self._blocks: list[PackedArrays] = []
        self._scratch: list[tuple[tuple[tuple[int, ...], Any], wp.array]] = []
        self.outlines = table.outlines_on_device(scene.device, config.carriers_hz)
        more = (self.host_pose, wp.transformd)
        self.forward, (self.pose,) = self._sorted(links.batch_index, links.tx.position, links.rx.position, more)
        self.rank = np.empty(len(links), dtype=np.int32)
        self.rank[self.forward.order] = np.arange(len(links))

    def scratch(self, shape: tuple[int, ...], kind: Any) -> wp.array:
        """Return an array on the device until `release`, with undefined values; small ones are used again."""
        size = wp.types.type_size_in_bytes(kind) * prod(shape)
        if size > SCRATCH_BYTES or len(self._scratch) >= SCRATCH_ARRAYS:
            return wp.empty(shape, dtype=kind, device=self.scene.device)
        free = self.table.scratch.get((shape, kind))
        array = free.pop() if free else wp.empty(shape, dtype=kind, device=self.scene.device)
        self._scratch.append(((shape, kind), array))
        return array

    def borrow(self, *layouts: Layout, is_scratch: bool = False) -> PackedArrays:
        """Return a block of arrays until `release`, see `borrow_arrays`."""
        block = borrow_arrays(self.scene.device, *layouts, is_scratch=is_scratch)
        self._blocks.append(block)
        return block

    def upload(self, *parts: tuple[np.ndarray, Any]) -> PackedArrays:
        """Return arrays on the device until `release`: values and Warp type of each."""
        layouts = [(values.shape[: values.ndim - len(scalar_type(kind)[1])], kind) for values, kind in parts]
        block = self.borrow(*layouts)
        for view, (values, _) in zip(block.host, parts, strict=True):
            view[...] = values
        block.upload()
        return block

    def release(self) -> None:
        """Give the arrays on the device back, after the last launch; `forward` and `pose` are gone."""
        for block in self._blocks:
            block.release()
        self._blocks.clear()
        if len(self.table.scratch) > SCRATCH_KINDS:
            self.table.scratch.clear()
        for key, array in self._scratch:
            self.table.scratch.setdefault(key, []).append(array)
        self._scratch.clear()
        del self.forward, self.pose

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
        return self._sorted(batch_index, tx, rx)[0]

    def _sorted(
        self, batch_index: np.ndarray, tx: np.ndarray, rx: np.ndarray, *more: tuple[np.ndarray, Any]
    ) -> tuple[SortedLinks, list[wp.array]]:
        """Return `sort`, and more arrays that are uploaded together with the ends."""
        order = np.lexsort((tx[:, 2], tx[:, 1], tx[:, 0], batch_index))
        at, of_batch = tx[order], batch_index[order]
        is_first = np.ones(len(order), dtype=bool)
        is_first[1:] = (at[1:] != at[:-1]).any(axis=1) | (of_batch[1:] != of_batch[:-1])
        first_use = np.flatnonzero(is_first)
        first_link = np.append(first_use, len(order)).astype(np.int32)
        position = at[first_use]
        instances = self.host_pose.shape[1]
        local = np.empty((2, len(order), instances + 1, 3))
        local[0, :, instances], local[1, :, instances] = at, rx[order]
        if instances:
            turn, shift = (values[of_batch] for values in self._inverse)
            local[:, :, :instances] = rotate(turn, local[:, :, instances:]) + shift
        source = is_first.cumsum() - 1
        own = _source_parts(of_batch[first_use], position, first_link, self.scene.origin)
        parts = (of_batch, wp.int32), (source, wp.int32), (local[0], wp.vec3d), (local[1], wp.vec3d)
        block = self.upload(*parts, *own, *more)
        ends = block.struct(LinkEnds, "batch_index", "source", "tx", "rx", *(len(own) + len(more)) * (None,))
        sources = Sources(own[0][0].astype(np.int32), position, first_link, tuple(block.arrays[4 : 4 + len(own)]))
        return SortedLinks(order, sources, ends), block.arrays[4 + len(own) :]

    def source_arrays(self, sources: Sources) -> tuple[wp.array, ...]:
        """Return batch index, position in the scene frame and in the world [m], and first links of sources."""
        if sources.device:
            return sources.device
        own = _source_parts(sources.batch_index, sources.position, sources.first_link, self.scene.origin)
        return tuple(self.upload(*own).arrays)


def _source_parts(
    batch_index: np.ndarray, position: np.ndarray, first_link: np.ndarray, origin: np.ndarray
) -> tuple[tuple[np.ndarray, Any], ...]:
    scene = position - origin
    return (batch_index, wp.int32), (scene, wp.vec3), (position, wp.vec3d), (first_link, wp.int32)
