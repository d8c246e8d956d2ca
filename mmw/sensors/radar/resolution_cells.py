"""Sort the rays of a batch into resolution cells once, and sum the cells in every weather."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

import math
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.core.errors import InputError
from mmw.core.packed_arrays import PackedArrays, padded_count
from mmw.core.remember import remembered
from mmw.core.repeated_launch import launch_again
from mmw.kernels.radar import path_sums
from mmw.kernels.radar import resolution_cells as radar_cells
from mmw.kernels.radar import trace as radar
from mmw.sensors.radar.config import Radar
from mmw.sensors.radar.radar_arrays import CellArrays

MAX_CELLS = 2**31 - 1
"""Cells of one sweep: they are counted in 32 bits."""

MAX_PLACES = 2 ** (63 - 24)
"""Cells of a batch: with the object they make a key of 63 bits."""


COLUMNS = tuple(radar_cells.CellSums.vars)[:-1]
"""Columns of sums, in the order of `RadarCells`, which has one more with multipath."""


@dataclass(frozen=True)
class SortedRays:
    """Rays of a batch in the order of their cells, on the device: geometry only, so it serves every weather."""

    grid: radar_cells.CellGrid
    views: int
    """Views of the batch, A."""
    arrays: CellArrays
    """Sorted keys and numbers of the rays, and where the cells start."""


@dataclass(frozen=True)
class RadarCells:
    """Echoes of every occupied cell of a batch in one weather, K cells by view and number."""

    offsets: np.ndarray
    """First cell of every view, and K, shape [A + 1], int32."""
    view: np.ndarray
    """View, shape [K], int32."""
    cell: np.ndarray
    """Number of the cell in `CellGrid`, shape [K], int32."""
    power: np.ndarray
    """Mean power of the echo [W], or its power where amplitudes are added, above 0, shape [K], float32."""
    rcs: np.ndarray
    """Radar cross section in the cell [m2], shape [K], float32."""
    range: np.ndarray
    """Mean weighted by power, as are the next three [m], shape [K], float32."""
    velocity: np.ndarray
    """Radial velocity, positive while the distance grows, folded [m/s], shape [K], float32."""
    y: np.ndarray
    """Direction cosine along y, sin(azimuth) cos(elevation); 0 with one antenna in a row, shape [K], float32."""
    z: np.ndarray
    """Direction cosine along z, sin(elevation); 0 with one antenna in a column, shape [K], float32."""
    object_id: np.ndarray
    """Object with the largest share of the power, shape [K], int32."""
    path_type: np.ndarray | None = None
    """Path of that share, as `RadarPoints.path_type`, shape [K], uint8; None for rays without multipath."""


@remembered(size=64)
def cell_grid(config: Radar) -> radar_cells.CellGrid:
    """Return the cells of a radar.

    Steps are c / 2B in range, wavelength / 2T in velocity and 2 / N in the direction cosine: N antennas half a
    wavelength apart.

    Raises:
        InputError: If a sweep has more cells than 32 bits can count.

    Source: Richards, Fundamentals of Radar Signal Processing, 2nd edition, chapters 4, 5 and 9.
    """
    grid = radar_cells.CellGrid()
    grid.range_step, grid.velocity_step = config.range_resolution, config.velocity_resolution
    grid.y_step, grid.z_step = 2.0 / config.azimuth_antennas, 2.0 / config.elevation_antennas
    grid.ranges, grid.velocities = config.range_cells + 1, config.chirps
    grid.ys, grid.zs = config.azimuth_antennas, config.elevation_antennas
    count = grid.ranges * grid.velocities * grid.ys * grid.zs
    if count > MAX_CELLS:
        raise InputError(
            f"sensor {config.name}: {count} resolution cells; at most {MAX_CELLS} can be counted; lower bandwidth_hz, "
            "azimuth_antennas or elevation_antennas, or raise chirp_time_s"
        )
    return grid


def centred(cell: np.ndarray, count: int) -> np.ndarray:
    """Return wrapped cells 0 to count - 1 as -(count / 2) to (count - 1) / 2: times the step, their middles."""
    return np.where(2 * cell < count, cell, cell - count)


def angle_cells(count: int, fov_deg: float) -> np.ndarray:
    """Return the cells of a direction cosine whose middles lie in a field of view, from right to left or bottom to top.

    Args:
        count: Antennas along the axis, as many as cells.
        fov_deg: Field of view, centered on boresight [deg].

    Returns:
        Centered cells, shape [n], int64; the middle one is always there.
    """
    cell = np.sort(centred(np.arange(count), count))
    return cell[np.abs(cell) * 2.0 / count <= math.sin(math.radians(fov_deg / 2.0)) + 1e-9]


def unravel(grid: radar_cells.CellGrid, cell: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the range cell and the centered velocity, y and z cells of cells by number."""
    shape = (grid.ranges, grid.velocities, grid.ys, grid.zs)
    r, v, y, z = np.unravel_index(cell, shape)
    return r, centred(v, grid.velocities), centred(y, grid.ys), centred(z, grid.zs)


def number(grid: radar_cells.CellGrid, r: np.ndarray, v: np.ndarray, y: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return the numbers of cells, int32; velocity, y and z cells wrap around. The arguments broadcast."""
    v, y, z = v % grid.velocities, y % grid.ys, z % grid.zs
    return (((r * grid.velocities + v) * grid.ys + y) * grid.zs + z).astype(np.int32)


def cell_order(config: Radar, rays: radar.RadarRays, arrays: CellArrays | None = None) -> SortedRays:
    """Return what `bin_rays` returns, before anything is sorted."""
    grid = cell_grid(config)
    views, per_view = rays.range.shape
    if views * grid.ranges * grid.velocities * grid.ys * grid.zs >= MAX_PLACES:
        raise InputError(
            f"sensor {config.name}: {views} views have more than 2^39 resolution cells; keys hold no more; "
            "lower compute.batch_frames"
        )
    if arrays is None or arrays.shape != (views, per_view):
        arrays = CellArrays(views, per_view, rays.range.device)
    return SortedRays(grid, views, arrays)


def bin_rays(config: Radar, rays: radar.RadarRays, arrays: CellArrays | None = None) -> SortedRays:
    """Return the rays of a batch in the order of their resolution cells, and where each occupied cell starts.

    Rays without an object, and beyond the last range cell, are left out. Equal keys keep the order of the rays, so sums
    over a cell are the same on every run.

    Args:
        config: Cells.
        rays: Echoes [A, R]; only range, angles, velocity and object are read, which no weather changes.
        arrays: Where they are sorted, if these have the shape of the rays; None for new ones.

    Raises:
        InputError: If the batch has more cells than a key can hold.
    """
    order = cell_order(config, rays, arrays)
    sort_rays(order, rays)
    return order


def sort_rays(order: SortedRays, rays: radar.RadarRays) -> None:
    """Launch what sorts the rays of an order."""
    arrays = order.arrays
    count, device = math.prod(arrays.shape), arrays.device
    if count == 0:
        return
    launch_again(radar_cells.cell_key_kernel, arrays.shape, [rays, order.grid, arrays.key, arrays.ray], device)
    wp.utils.radix_sort_pairs(arrays.key, arrays.ray, count)
    launch_again(radar_cells.is_first_kernel, (count,), [arrays.sorted[0], arrays.is_first], device)
    wp.utils.array_scan(arrays.is_first, arrays.first_up_to, inclusive=True)
    launch_again(radar_cells.cell_start_kernel, (count,), [arrays.is_first, arrays.first_up_to, arrays.start], device)


def queue_sums(order: SortedRays, rays: radar.RadarRays, *, coherent: bool = False) -> PackedArrays:
    """Launch the sums of as many cells as there is room for, and their copy to the host; return their block."""
    arrays = order.arrays
    inputs = [rays, order.grid, *arrays.sorted, arrays.start, arrays.first_up_to]
    if coherent or _has_paths(rays):
        struct, kernel = path_sums.PathSums, path_sums.path_sum_kernel
        inputs.append(int(coherent))
    else:
        struct, kernel = radar_cells.CellSums, radar_cells.cell_sum_kernel
    block = arrays.sums(struct)
    launch_again(kernel, (arrays.room,), [*inputs, block.struct(struct, *struct.vars)], arrays.device)
    block.queue_download()
    return block


def _has_paths(rays: radar.RadarRays) -> bool:
    return rays.path_type is not None  # an array, with multipath


def sum_cells(
    order: SortedRays, rays: radar.RadarRays, *, coherent: bool = False, queued: PackedArrays | None = None
) -> RadarCells:
    """Return what the occupied cells return in one weather; cells without any power have no row.

    The next sums of the same arrays may overwrite the values.

    Args:
        order: From `bin_rays`, for rays that differ from these in power and phase at most.
        rays: Echoes [A, R] in the weather.
        coherent: True adds up complex amplitudes, by the phases of the rays, False powers.
        queued: What `queue_sums` returned, if the sums are launched already.
    """
    arrays = order.arrays
    if not math.prod(arrays.shape):
        none = (
            np.zeros(0, dtype=np.int32 if name in ("view", "cell", "object_id") else np.float32) for name in COLUMNS
        )
        return RadarCells(np.zeros(order.views + 1, dtype=np.int32), *none)
    while True:
        block = queue_sums(order, rays, coherent=coherent) if queued is None else queued
        *columns, (count,) = block.download(is_queued=True)
        if count <= arrays.room:
            break
        arrays.room, queued = padded_count(int(count)), None
    has_power = columns[COLUMNS.index("power")][:count] > 0.0
    columns = [column[:count] for column in columns]
    if not has_power.all():
        columns = [column[has_power] for column in columns]
    offsets = np.searchsorted(columns[0], np.arange(order.views + 1)).astype(np.int32)
    return RadarCells(offsets, *(columns if _has_paths(rays) else columns[: len(COLUMNS)]))
