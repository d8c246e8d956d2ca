"""Detect targets in resolution cells: fluctuating echoes, noise, threshold, local maxima, errors of the estimates.

An echo in noise, after a square-law detector, is an exponential number with the mean N (1 + SNR): Swerling's first case
in complex Gaussian noise. Above the threshold -N ln(Pfa) it is a detection, so Pd = Pfa^(1 / (1 + SNR)). Cells of rain
and cells that hold noise alone are drawn the same way. Of detections less than a cell apart on every axis the strongest
stays: two points are two detections exactly if they are a cell apart or more in range, velocity, y or z.

Where a cell holds the sum of amplitudes (`Radar.coherent`), its fluctuation is there already: its echo is steady within
a sample, and noise is added to it as a complex number, so power follows Rice's distribution and Pd Marcum's Q.

Source: P. Swerling, "Probability of detection for fluctuating targets", RAND RM-1217, 1954; Richards, Fundamentals of
Radar Signal Processing, 2nd edition, chapter 6.
"""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

import math

import numpy as np
import warp as wp

from mmw.core.host_kernels import HOST
from mmw.core.packed_arrays import borrow_arrays, padded_count
from mmw.core.remember import remembered
from mmw.core.repeated_launch import launch_again
from mmw.kernels.radar import detection as radar_detection
from mmw.kernels.radar import estimates
from mmw.kernels.radar import resolution_cells as radar_cells
from mmw.kernels.radar import thresholds as radar_thresholds
from mmw.sensors.radar.config import Radar
from mmw.sensors.radar.detection_arrays import FIELDS, DetectionArrays
from mmw.sensors.radar.points import LABEL_RAIN, RadarPoints
from mmw.sensors.radar.rain_clutter import RainClutter
from mmw.sensors.radar.resolution_cells import RadarCells, angle_cells, cell_grid, number

RAIN_PLACE_DRAW = int(radar_thresholds.RAIN_PLACE_DRAW)
"""Draw of the place of rain in its cell, by cell."""

LIKELY_ECHOES = 1024
"""Echoes above the threshold of a view that there is room for at first; design value."""


def _columns(cells: RadarCells) -> list[np.ndarray | None]:
    return [getattr(cells, name) for name in FIELDS[radar_thresholds.Cells][1:]]


def cell_echoes(config: Radar, cells: RadarCells, keys: np.ndarray) -> np.ndarray:
    """Return what each occupied cell receives, echo and noise [W], shape [K], float64; keyed by view and cell."""
    count = len(cells.view)
    room = DetectionArrays(len(keys)).room(count, count)
    room.give(keys, cells.offsets, _columns(cells))
    given, echoes = room.struct(radar_thresholds.Cells), room.struct(radar_thresholds.Echoes)
    launch_again(radar_thresholds.echo_kernel, (count,), [room.key, receiver(config), given, echoes.power], HOST)
    return echoes.power.numpy()[:count]


def detect(
    config: Radar,
    cells: RadarCells,
    clutter: RainClutter | None,
    keys: np.ndarray,
    device: str,
    arrays: DetectionArrays | None = None,
) -> RadarPoints:
    """Return the detections of a batch in one weather, by view and range.

    Echoes of surfaces, of rain and of noise alone pass the same threshold, which is set for the thermal noise. Noise
    alone exceeds it in Pfa of the cells of the field of view, false alarms. Estimates are the mean of the cell's
    echoes, weighted by power, with a normal error of step / (1.6 sqrt(2 SNR)) on every axis, at most half a step: of a
    radar that interpolates peaks. Those of rain and false alarms are anywhere in their cell. `power_db` and `snr_db`
    are what was measured less the mean noise; `rcs_dbsm` follows from them, for false alarms as of a target in clear
    air on boresight. An axis with one antenna measures no angle: it reads 0.

    Args:
        config: Cells, noise and threshold.
        cells: Mean powers of the occupied cells (`mmw.sensors.radar.resolution_cells.sum_cells`).
        clutter: Rain (`mmw.sensors.radar.rain_clutter.rain_clutter`), None without.
        keys: Key of each view's random numbers, with the weather, shape [A, 2], uint32.
        device: Warp device of the rain.
        arrays: Arrays for as many views; None for new ones.
    """
    link, grid, views = receiver(config), cell_grid(config), len(keys)
    rain = [] if clutter is None else _rain(config, clutter, keys, device)
    arrays = DetectionArrays(views) if arrays is None else arrays
    given, needed = _columns(cells), views * (LIKELY_ECHOES + link.most)
    while True:
        room = arrays.room(len(cells.view), needed)
        room.give(keys, cells.offsets, given)
        echoes = room.struct(radar_thresholds.Echoes)
        inputs = [room.key, grid, link, room.struct(radar_thresholds.Cells), echoes]
        launch_again(radar_thresholds.threshold_kernel, (1,), inputs, HOST)
        *columns, place, (first_alarm, found) = room.columns(radar_thresholds.Echoes)
        found, needed = int(found), int(found) + (len(rain[0]) if rain else 0)
        if needed <= room.echoes:
            break
    if clutter is not None:
        alarms = slice(int(first_alarm), found)
        columns[0][alarms][_is_rain(config, clutter, columns[0][alarms], *place[alarms].T)] = -1
        for column, values in zip(columns, rain, strict=True):
            column[found:needed] = values
    outputs = [room.struct(estimates.Candidates), room.struct(estimates.Detections)]
    launch_again(estimates.estimate_kernel, (1,), [room.key, grid, link, echoes, needed, *outputs], HOST)
    first, *measured = room.columns(estimates.Detections)
    offsets = first.copy()
    *values, path_type = (column[: offsets[-1]].copy() for column in measured)
    return RadarPoints(offsets, *values, path_type=None if cells.path_type is None else path_type)


@remembered(size=32)
def receiver(config: Radar) -> radar_thresholds.Receiver:
    """Return what decides over detections."""
    grid, link = cell_grid(config), radar_thresholds.Receiver()
    y_cells = angle_cells(grid.ys, config.horizontal_fov_deg)
    z_cells = angle_cells(grid.zs, config.vertical_fov_deg)
    mean = grid.ranges * grid.velocities * len(y_cells) * len(z_cells) * config.false_alarm_probability
    link.most = math.ceil(mean + 10.0 * math.sqrt(mean) + 20.0)  # more are ten standard deviations away
    link.noise, link.threshold = config.noise_w, threshold(config)
    link.log_miss = math.log1p(-config.false_alarm_probability)
    link.link_constant, link.max_velocity = config.link_constant, config.max_velocity
    for name in ("range_step", "velocity_step", "y_step", "z_step"):
        setattr(link, name, getattr(grid, name))
    link.is_coherent = config.coherent
    link.y_cell, link.z_cell = (wp.array(cells, dtype=wp.int32, device=HOST) for cells in (y_cells, z_cells))
    return link


def uniform(keys: np.ndarray, view: np.ndarray, item: np.ndarray, draw: int | np.ndarray, device: str) -> np.ndarray:
    """Return four uniform numbers in (0, 1) for each item of a list, shape [N, 4], float64.

    Args:
        keys: Key of each view's random numbers, shape [A, 2], uint32.
        view: View of each item, shape [N].
        item: Cell, pixel or number, shape [N].
        draw: Which draw of the item, one for all or shape [N].
        device: Warp device name.
    """
    count, room = len(view), padded_count(len(view))
    block = borrow_arrays(device, ((len(keys),), wp.vec2ui), *[((room,), wp.int32)] * 3, ((room,), wp.vec4))
    host = block.host
    host[0][:], host[1][:count], host[2][:count], host[3][:count] = keys, view, item, draw
    *inputs, out = block.upload()
    launch_again(radar_detection.uniform_kernel, (count,), [*inputs, out], device)
    numbers = block.download()[4][:count].astype(np.float64)
    block.release()
    return numbers


def threshold(config: Radar) -> float:
    """Return the power above which a cell is a detection [W]: noise exceeds it with the false alarm probability."""
    return -config.noise_w * math.log(config.false_alarm_probability)


def _inside(
    grid: radar_cells.CellGrid, r: np.ndarray, v: np.ndarray, y: np.ndarray, z: np.ndarray, u: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Return positions in cells by four uniform numbers, u [D, 4]; an axis with one antenna measures 0."""
    part = u - 0.5
    return (
        np.abs(r + part[:, 0]) * grid.range_step,
        (v + part[:, 1]) * grid.velocity_step,
        (y + part[:, 2]) * grid.y_step * (grid.ys > 1),
        (z + part[:, 3]) * grid.z_step * (grid.zs > 1),
    )


def _rain(config: Radar, clutter: RainClutter, keys: np.ndarray, device: str) -> list[np.ndarray]:
    """Return the columns of `Echoes` but the last two of the rain above the threshold."""
    grid = cell_grid(config)
    view, r, direction = np.nonzero(clutter.power > threshold(config))
    power = clutter.power[view, r, direction].astype(np.float64)
    v, y, z = clutter.velocity_cell[view, r, direction], clutter.y_cell[direction], clutter.z_cell[direction]
    cell = number(grid, r, v, y, z)
    places = _inside(grid, r, v, y, z, uniform(keys, view, cell, RAIN_PLACE_DRAW, device))
    rcs = clutter.rcs_per_w[r, direction] * (power - config.noise_w)
    nothing, label = np.full(len(view), -1, dtype=np.int32), np.full(len(view), LABEL_RAIN, dtype=np.uint8)
    return [view, *places, power, rcs, nothing, label, cell, np.zeros_like(label)]


def _is_rain(
    config: Radar, clutter: RainClutter, view: np.ndarray, r: np.ndarray, v: np.ndarray, y: np.ndarray, z: np.ndarray
) -> np.ndarray:
    """Return whether rain was drawn for cells: velocity cells within three standard deviations, as the kernel's."""
    step, count = config.velocity_resolution, config.chirps
    low, high = int(clutter.y_cell.min()), int(clutter.z_cell.min())
    place = np.full((int(clutter.y_cell.max()) - low + 1, int(clutter.z_cell.max()) - high + 1), -1)
    place[clutter.y_cell - low, clutter.z_cell - high] = np.arange(len(clutter.y_cell))
    direction = place[y - low, z - high]
    middle, width = clutter.mean_velocity[view, direction] / step, 3.0 * clutter.spread[view, direction] / step
    first, last = np.rint(middle - width), np.rint(middle + width)
    is_drawn = (direction >= 0) & (clutter.power[view, r, direction] > 0.0)
    return is_drawn & ((v - first) % count <= last - first)
