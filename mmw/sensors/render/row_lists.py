"""List rows of samples whose number only the device knows: launches have room for as many as were needed so far.

Rows are counted on the device, and the counts come to the host with the images. If one exceeds the room of its list,
the images are made again with more (`RowLists.fit`).
"""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from mmw.core.recorded_work import NewArrays
from mmw.kernels.camera import image_samples as picture
from mmw.sensors.render.camera import BLOCK_DIM

if TYPE_CHECKING:
    from mmw.sensors.render.visibility_buffer import SampleBuffer

SHARES = {"edges": 0.25, "traced": 0.15, "shaded": 0.03, "reflected": 0.35, "words": 0.15}
"""List -> rows over pixel centers that there is room for from the start: pixels on edges, further samples that are
traced and shaded, reflected rays, words of JPEG files. Design values, above those of 13 images of 320 x 240 of
`town03_roundabout`: 0.19, 0.14, 0.02, 0.08 (0.33 in rain), 0.09."""

MIN_ROOM = 1 << 13
"""Rows that each list has room for at least, as far as there can be so many: small images need no second try."""

MARGIN = 1.25
"""Room of a list over the rows that exceeded it."""

MAX_LISTS = 256
"""Lists of a launch: three, one for each group of weathers, and one for the files of each weather."""


class ListShares:
    """Rows over pixel centers that lists have room for, by list; they grow where there were more."""

    def __init__(self) -> None:
        """Begin with `SHARES`."""
        self.shares = dict(SHARES)

    @property
    def key(self) -> tuple[float, ...]:
        """The shares, as a part of the key of recorded work."""
        return tuple(self.shares.values())

    def room(self, name: str, pixels: int, most: int) -> int:
        """Return the rows that a list has room for.

        Args:
            name: The list.
            pixels: Pixel centers.
            most: Rows that there can be.
        """
        return min(max(math.ceil(self.shares[name] * pixels), MIN_ROOM), most)


@dataclass(frozen=True)
class RowList:
    """Rows of samples, in the order of their threads."""

    row: wp.array
    """The rows; there may be room for more."""
    count: wp.array
    """Their number, shape [1], which exceeds the room where rows are missing."""

    def __len__(self) -> int:
        """Return the rows that there is room for."""
        return len(self.row)


class RowLists:
    """The lists of one launch.

    Attributes:
        arrays: Source of all arrays of the launch.
        shares: Room of the lists.
        counts: Rows of each list, in the order in which they were made, shape [MAX_LISTS], int32, on the device.
    """

    def __init__(self, arrays: NewArrays, shares: ListShares, pixels: int) -> None:
        """Begin without a list; `pixels` is the number of pixel centers."""
        self.arrays, self.shares, self._pixels = arrays, shares, pixels
        self.counts = arrays.empty(MAX_LISTS, int)
        self._rooms: list[tuple[str, int]] = []

    def room(self, name: str, most: int) -> int:
        """Return the rows that a list has room for, see `ListShares.room`."""
        return self.shares.room(name, self._pixels, most)

    def list(self, name: str, buffer: "SampleBuffer", flags: wp.array, threads: int, first_thread: int = 0) -> RowList:
        """Return the rows of the samples whose threads raised their flags.

        Args:
            name: The list, one of `SHARES`.
            buffer: What the pixels see.
            flags: From `empty_flags`.
            threads: Threads that have one.
            first_thread: Thread that the first flag belongs to.
        """
        arrays, words, device = self.arrays, len(flags) // 8, flags.device
        row = arrays.empty(self.room(name, threads), int)
        first = arrays.empty(words + 1, int)
        if not words:
            first.zero_()
        else:
            flag = wp.array(ptr=flags.ptr, dtype=wp.uint64, shape=words, device=device)
            count = arrays.empty(words + 1, int)
            launch = {"dim": words, "device": device, "block_dim": BLOCK_DIM}
            wp.launch(picture.flag_count_kernel, inputs=[flag], outputs=[count], **launch)
            wp.utils.array_scan(count, first, inclusive=False)
            inputs = [buffer.picture, flag, first, first_thread]
            wp.launch(picture.flagged_row_kernel, inputs=inputs, outputs=[row], **launch)
        self.count(name, len(row), first, words)  # the number after the last word is that of all flags
        return RowList(row, first[words:])

    def count(self, name: str, room: int, numbers: wp.array, place: int) -> None:
        """Note that a list has some room, and the number of its rows at a place of an array on the device, int32."""
        wp.copy(self.counts, numbers, dest_offset=len(self._rooms), src_offset=place, count=1)
        self._rooms.append((name, room))

    def fit(self, counts: np.ndarray) -> bool:
        """Return whether all lists had room for their rows; make more for those that had not.

        Args:
            counts: `counts` on the host.
        """
        fits = True
        for (name, room), count in zip(self._rooms, counts.tolist(), strict=False):
            if count > room:
                fits = False
                shares = self.shares.shares
                shares[name] = max(shares[name], MARGIN * count / self._pixels)
        return fits


def empty_flags(arrays: NewArrays, threads: int) -> wp.array:
    """Return room for a flag a thread, 0 or 1, in whole words of eight; all are 0."""
    return arrays.full(-(-threads // 8) * 8, 0, wp.uint8)
