"""Hold the arrays that the rays of one radar are traced into, and sorted by resolution cell, on a device."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from typing import Any

import warp as wp

from mmw.core.packed_arrays import PackedArrays, padded_count
from mmw.core.replayed_launches import ReplayedLaunches
from mmw.kernels.core import structs
from mmw.kernels.radar import trace as radar
from mmw.scene.views import VIEW_TYPES
from mmw.sensors.radar.detection_arrays import DetectionArrays
from mmw.sensors.ray_batch import empty_struct

SHARED = ("range", "azimuth", "elevation", "velocity", "object_id")
"""Arrays that hits and echoes have in common."""

FIRST_ROOM = 4096
"""Cells that sums have room for before it is known how many are occupied; a radar of `full.yaml` has some 2000."""


class CellArrays:
    """Arrays that sort the echoes of A views by resolution cell; the next ones overwrite them.

    Attributes:
        shape: Views, and echoes of a view.
        key: Key (view, cell, object) of each echo, with room to sort, shape [2 C], int64; C is the number of echoes.
        ray: Number of each echo, with room to sort, shape [2 C].
        sorted: `key` and `ray` of the C echoes, shape [C] each.
        is_first: 1 for the first echo of a cell, shape [C].
        first_up_to: Number of cells up to each echo, shape [C].
        start: First echo of each cell, shape [C].
        room: Cells that sums have room for.
        device: Warp device name.
    """

    def __init__(self, views: int, per_view: int, device: str):
        """Allocate them; nothing is written."""
        self.shape, count = (views, per_view), max(views * per_view, 1)
        self.key = wp.empty(2 * count, dtype=wp.int64, device=device)
        self.ray = wp.empty(2 * count, dtype=int, device=device)
        self.sorted = self.key[: views * per_view], self.ray[: views * per_view]
        self.is_first, self.first_up_to, self.start = (wp.empty(count, dtype=int, device=device) for _ in range(3))
        self.room = min(padded_count(count), FIRST_ROOM)
        self.device = str(device)
        self._sums: dict[tuple[str, int], PackedArrays] = {}

    def sums(self, struct: Any) -> PackedArrays:
        """Return a block of the arrays of a struct of sums; the last array is their number."""
        found = self._sums.get((struct.key, self.room))
        if found is None:
            *columns, count = (variable.type.dtype for variable in struct.vars.values())
            layouts = *(((self.room,), kind) for kind in columns), ((1,), count)
            found = self._sums[struct.key, self.room] = PackedArrays(self.device, layouts)
        return found


class RadarArrays:
    """Arrays of one radar for A views of R rays each; the next batch overwrites what the last one left in them.

    Attributes:
        shape: A and R.
        views: Sensor poses, in the block `given`.
        velocity: Velocity of each view's sensor [m/s], shape [A].
        key: Key of each view's random numbers, shape [A].
        given: Block of what the host gives for a batch: the columns of `views`, `velocity` and `key`.
        hits: First hits, shape [A, R].
        rays: Echoes in one weather, shape [A, R].
        cells: Arrays that sort the echoes.
        detections: Arrays that the echoes are detected in.
        launches: Runs the launches of a batch.
        device: Warp device name.
    """

    def __init__(self, views: int, rays: int, device: str):
        """Allocate them; nothing is written."""
        self.given = PackedArrays(
            device, tuple(((views,), kind) for kind in (*VIEW_TYPES, wp.vec3, wp.vec2ui)), is_pinned=True
        )
        *own, self.velocity, self.key = self.given.arrays
        self.views = structs.Views()
        self.views.batch_index, self.views.pose, self.views.ignore = own
        self.shape = views, rays
        self.hits = empty_struct(radar.RadarHits, (views, rays), device)
        self.rays = radar.RadarRays()
        for name in SHARED:
            setattr(self.rays, name, getattr(self.hits, name))
        self.rays.rcs, self.rays.power = (wp.empty((views, rays), dtype=float, device=device) for _ in range(2))
        self.cells = CellArrays(views, rays, device)
        self.detections = DetectionArrays(views)
        self.launches = ReplayedLaunches(str(device))
        self.device = str(device)
