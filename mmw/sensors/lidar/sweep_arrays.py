"""Hold the arrays that the sweeps of one LiDAR are traced into on a device, and read the returns back."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from collections.abc import Callable, Hashable
from functools import cached_property

import numpy as np
import warp as wp

from mmw.core.packed_arrays import PackedArrays
from mmw.core.remember import remembered
from mmw.core.repeated_launch import launch_again
from mmw.core.replayed_launches import ReplayedLaunches
from mmw.core.transfer import queue_bytes, to_host
from mmw.kernels.core import structs
from mmw.kernels.lidar import returns as lidar_returns
from mmw.kernels.lidar import trace as lidar
from mmw.scene.device_scene import DeviceScene
from mmw.scene.views import VIEW_TYPES
from mmw.sensors.lidar.config import Lidar, sweep_duration
from mmw.sensors.lidar.scan_pattern import lidar_order, lidar_pattern
from mmw.sensors.ray_batch import BLOCK_DIM, empty_struct
from mmw.sensors.samples import Array, Output
from mmw.sensors.workspace import KEPT_RAYS

SPARE_SHARE, SPARE_BYTES = 1.05, 1 << 14
"""How much more than the returns of the last sweep is copied to the host before it is known how many there are now: a
vehicle moves by 0.3 m meanwhile. Design values."""


class SweepArrays:
    """Arrays of one LiDAR for A views of R rays each; a sweep overwrites what the last one left in them.

    Attributes:
        config: The LiDAR.
        shape: A and R.
        device: Warp device name.
        views: Sensor poses, in the block `given`.
        sweep: Firing times, and the motion of the sensors meanwhile.
        time_s: Time of each view since the start of the scenario [s], shape [A].
        key: Key of each view's random numbers, shape [A], vec2ui.
        given: Block of what the host gives for a sweep: the columns of `views`, time, key, and velocity and rate of the
            sensors.
        rays: First hits, shape [A, R].
        returns: Returns of every ray, shape [A, R, 1 or 2].
        count: How many they are, shape [A, R].
        up_to: Returns up to the end of each ray, shape [A, R].
        pattern: Directions of the rays in the sensor frame, and their numbers in the order of the threads, shape [R].
        block: Returns that `gather` found, see `LidarPoints`; the next sweep writes to it again.
    """

    def __init__(self, config: Lidar, views: int, device: str, directions: np.ndarray | None = None):
        """Allocate them; nothing is written.

        Args:
            config: The LiDAR.
            views: A.
            device: Warp device name.
            directions: Unit directions of the rays in the sensor frame, shape [R, 3], of one channel; None for those of
                the LiDAR.
        """
        self.config, self.device = config, device
        self.pattern = _on_device(config, str(device)) if directions is None else _rays(directions, device)
        self.shape = views, self.pattern[1].size
        moving = views if config.rolling else 0
        self.given = PackedArrays(
            device,
            tuple(((views,), kind) for kind in (*VIEW_TYPES, wp.float32, wp.vec2ui)) + (((moving,), wp.vec3),) * 2,
            is_pinned=True,
        )
        *own, self.time_s, self.key, velocity, rate = self.given.arrays
        self.views, self.sweep = structs.Views(), lidar.Sweep()
        self.views.batch_index, self.views.pose, self.views.ignore = own
        self.sweep.points_per_channel = config.points_per_channel if directions is None else len(directions)
        if config.rolling:
            self.sweep.duration_s, self.sweep.velocity, self.sweep.rate = sweep_duration(config), velocity, rate
        self.rays = empty_struct(lidar.LidarRays, self.shape, device)
        slots = 2 if config.returns == "dual" else 1
        self.returns = wp.empty((*self.shape, slots), dtype=lidar_returns.LidarReturn, device=device)
        self.count, self.up_to = (wp.empty(self.shape, dtype=int, device=device) for _ in range(2))
        self._flat = self.count.flatten(), self.up_to.flatten()
        self._ends = PackedArrays(device, (((views,), wp.int32),), is_pinned=True)
        self._return_bytes = 4 * (6 if config.rolling else 5) + (3 if slots == 2 else 2)
        self.block = wp.empty(0, dtype=wp.uint8, device=device)
        # A single frame does not wait for the number of returns; a large batch does not hold room for all rays.
        self._is_small = self.returns.size <= KEPT_RAYS
        self._launches = ReplayedLaunches(str(device))
        self._likely_bytes = 0

    @cached_property
    def _points(self) -> lidar_returns.LidarPoints:
        """Room for as many returns as there can be."""
        return self._room(self.returns.size)

    def _room(self, count: int) -> lidar_returns.LidarPoints:
        size = self._return_bytes * count
        points = lidar_returns.LidarPoints()
        points.marks = wp.empty(-(-size // 4) * 4, dtype=wp.uint8, device=self.device)
        for name, kind in (("numbers", wp.float32), ("ids", wp.int32)):
            view = wp.array(ptr=points.marks.ptr, shape=-(-size // 4), dtype=kind, device=self.device)
            view._ref = points.marks
            setattr(points, name, view)
        return points

    def run(self, key: tuple[Hashable, ...], launch: Callable[[], None]) -> None:
        """Launch, or replay what a small batch launched; see `ReplayedLaunches.run`."""
        if self._is_small:
            self._launches.run(launch, *key)
        else:
            launch()

    def trace(self, scene: DeviceScene) -> None:
        """Find the first hits of all rays, from what `given` holds on the device."""
        kernel, sweep = (lidar.rolling_kernel, [self.sweep]) if self.config.rolling else (lidar.lidar_kernel, [])
        inputs = [scene.struct, self.views, *sweep, *self.pattern, self.config.range_m]
        launch_again(kernel, self.shape, [*inputs, self.rays], str(self.device), BLOCK_DIM)

    def gather(self) -> None:
        """Gather the returns of all rays in `block`; `read` waits for their number, as a large batch does here."""
        wp.utils.array_scan(*self._flat, inclusive=True)
        points = self._points if self._is_small else self._room(int(to_host([self._flat[1][-1:]])[0][0]))
        found = [self.rays, self.returns, self.count, self.up_to]
        inputs = [*found, self.pattern[0], self.views, self.sweep, self.config.deskew]
        kernel, outputs = lidar_returns.gather_kernel, [points, self._ends.arrays[0]]
        if self._is_small:
            launch_again(kernel, self.shape, [*inputs, *outputs], str(self.device))
        else:
            wp.launch(kernel, self.shape, inputs, outputs, device=self.device)
        self._ends.queue_download()
        self.block = points.marks

    def read(self, output: Output) -> tuple[np.ndarray, Array]:
        """Wait for what `gather` launched.

        Args:
            output: Where the returns are wanted.

        Returns:
            First point of every view, and N, shape [A + 1], int32; and `block` in memory of its own.
        """
        device, offsets, queued = wp.get_device(self.device), np.zeros(self.shape[0] + 1, dtype=np.int32), None
        if device.is_cuda and output == "numpy" and self._is_small and self._likely_bytes:  # one wait instead of two
            queued = queue_bytes(self.block, min(self._likely_bytes, self.block.size), wp.get_stream(device))
        offsets[1:] = self._ends.download(is_queued=True)[0]
        size = self._return_bytes * int(offsets[-1])
        self._likely_bytes = int(SPARE_SHARE * size) + SPARE_BYTES
        if queued is not None and size <= queued.size:
            return offsets, queued[:size]
        if output == "warp":
            return offsets, wp.clone(self.block[:size])
        if device.is_cuda:
            return offsets, to_host([self.block[:size]])[0] if size else np.zeros(0, dtype=np.uint8)
        return offsets, self.block.numpy()[:size].copy()

    def columns(self, kept: Array, count: int, output: Output) -> dict[str, Array]:
        """Return the columns of the block of `read`, as `PointCloud` has them."""
        end = 4 * (6 if self.config.rolling else 5) * count
        found = {
            "values": _column(kept, 0, (4, count), wp.float32).transpose(),
            "object_id": _column(kept, 16 * count, (count,), wp.int32),
            "ring": _column(kept, end, (count,), wp.uint8),
            "label": _column(kept, end + count, (count,), wp.uint8),
        }
        if self.config.rolling:
            found["time_offset"] = _column(kept, 20 * count, (count,), wp.float32)
        if self.config.returns == "dual":
            found["return_number"] = _column(kept, end + 2 * count, (count,), wp.uint8)
        for name, kind in (("time_offset", wp.float32), ("return_number", wp.uint8)):
            if name not in found:
                found[name] = (
                    np.zeros(count, wp.dtype_to_numpy(kind))
                    if output == "numpy"
                    else wp.zeros(count, dtype=kind, device=self.device)
                )
        return found


def _column(block: Array, start: int, shape: tuple[int, ...], kind: type) -> Array:
    """Return a part of a block of bytes as an array."""
    if isinstance(block, np.ndarray):
        return np.ndarray(shape, wp.dtype_to_numpy(kind), block, start)
    column = wp.array(ptr=(block.ptr or 0) + start, shape=shape, dtype=kind, device=block.device)
    column._ref = block
    return column


@remembered(size=32)
def _on_device(config: Lidar, device: str) -> tuple[wp.array, wp.array]:
    return _rays(lidar_pattern(config), device, lidar_order(config.channels, config.points_per_channel))


def _rays(directions: np.ndarray, device: str, order: np.ndarray | None = None) -> tuple[wp.array, wp.array]:
    order = np.arange(len(directions), dtype=np.int32) if order is None else order
    return (
        wp.array(directions.astype(np.float32), dtype=wp.vec3, device=device),
        wp.array(order, dtype=wp.int32, device=device),
    )
