"""Hold the arrays that the echoes of one radar are detected in, on the host."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from mmw.core.host_kernels import HOST
from mmw.core.packed_arrays import Layout, PackedArrays, padded_count
from mmw.kernels.radar.estimates import Candidates, Detections
from mmw.kernels.radar.thresholds import Cells, Echoes

STRUCTS = (Cells, Echoes, Candidates, Detections)
"""Structs whose arrays are in the block of a `DetectionRoom`, after the keys of random numbers."""

FIELDS = {struct: tuple(struct.vars) for struct in STRUCTS}
"""Struct -> its fields."""

_ends = np.cumsum([1, *map(len, FIELDS.values())]).tolist()
_SPANS = {struct: slice(*_ends[place : place + 2]) for place, struct in enumerate(STRUCTS)}
_NAMES = {
    struct: (*[None] * span.start, *FIELDS[struct], *[None] * (_ends[-1] - span.stop))
    for struct, span in _SPANS.items()
}


class DetectionRoom:
    """Arrays for the cells, echoes and detections of a batch.

    Attributes:
        cells: Cells that there is room for.
        echoes: Echoes above the threshold that there is room for.
        key: Key of each view's random numbers.
    """

    def __init__(self, views: int, cells: int, echoes: int) -> None:
        """Allocate them; nothing is written."""
        self.cells, self.echoes = cells, echoes
        sizes = {Cells: cells, Echoes: echoes + 1, Candidates: echoes + 1, Detections: echoes}
        layouts: list[Layout] = [((views,), wp.vec2ui)]
        for struct in STRUCTS:
            special = {"first": views + 1, "count": 2}
            layouts += [((special.get(name, sizes[struct]),), var.type.dtype) for name, var in struct.vars.items()]
        self._block = PackedArrays(HOST, tuple(layouts))
        self.key = self._block.arrays[0]

    def struct(self, kind: Any) -> Any:
        """Return one of the structs."""
        return self._block.struct(kind, *_NAMES[kind])

    def columns(self, kind: Any) -> list[np.ndarray]:
        """Return the arrays of one of the structs."""
        return self._block.host[_SPANS[kind]]

    def give(self, keys: np.ndarray, offsets: np.ndarray, values: Sequence[np.ndarray | None]) -> None:
        """Write the key of each view's random numbers, and cells.

        Args:
            keys: Keys, shape [A, 2], uint32.
            offsets: First cell of every view, and K, shape [A + 1].
            values: Columns of the cells in the order of `Cells`, shape [K] each; None is 0.
        """
        first, *columns = self.columns(Cells)
        self._block.host[0][:], first[:] = keys, offsets
        for column, own in zip(columns, values, strict=True):
            column[: offsets[-1]] = 0 if own is None else own


class DetectionArrays:
    """Arrays for the batches of some views, with as much room as one of them needed; the next one overwrites them."""

    def __init__(self, views: int) -> None:
        """Hold nothing yet."""
        self._views = views
        self._made: DetectionRoom | None = None

    def room(self, cells: int, echoes: int) -> DetectionRoom:
        """Return arrays with room for at least so many cells, and echoes above the threshold."""
        made = self._made
        if made is None or made.cells < cells or made.echoes < echoes:
            least = (0, 0) if made is None else (made.cells, made.echoes)
            made = self._made = DetectionRoom(
                self._views, max(padded_count(cells), least[0]), max(padded_count(echoes), least[1])
            )
        return made
