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
from dataclasses import dataclass, fields, replace

import numpy as np
import warp as wp

from mmw.core.packed_arrays import borrow_arrays, padded_count
from mmw.core.remember import remembered
from mmw.core.repeated_launch import launch_again
from mmw.kernels.radar import detection as radar_detection
from mmw.kernels.radar import resolution_cells as radar_cells
from mmw.sensors.radar.config import Radar
from mmw.sensors.radar.points import LABEL_FALSE_ALARM, LABEL_OBJECT, LABEL_RAIN, RadarPoints
from mmw.sensors.radar.rain_clutter import RainClutter
from mmw.sensors.radar.resolution_cells import RadarCells, angle_cells, cell_grid, centred, number
from mmw.sensors.radar.trace import decibels

ECHO_DRAW, ERROR_DRAW, RAIN_PLACE_DRAW, ALARM_DRAW, ALARM_PLACE_DRAW = range(5)
"""Draws of a view's random numbers: by cell the first three, by number of the false alarm the others."""

BARTON = 1.6
"""Slope of an estimator of a peak: its error is step / (1.6 sqrt(2 SNR)). Source: D. Barton, Modern Radar System
Analysis, 1988, for a beam or a pulse of common shape."""


@dataclass
class _Points:
    """Cells above the threshold, shape [D] each: where they are, and what was received."""

    view: np.ndarray
    range: np.ndarray
    velocity: np.ndarray
    y: np.ndarray
    z: np.ndarray
    power: np.ndarray
    """Echo and noise [W]."""
    rcs: np.ndarray
    """RCS that explains the power without the noise [m2]."""
    object_id: np.ndarray
    label: np.ndarray
    cell: np.ndarray
    """Number of the cell: the item of the random numbers."""
    path_type: np.ndarray


_COLUMNS = tuple(field.name for field in fields(_Points))


def cell_echoes(config: Radar, cells: RadarCells, keys: np.ndarray, device: str) -> np.ndarray:
    """Return what each occupied cell receives, echo and noise [W], shape [K], float64; keyed by view and cell."""
    kernel = radar_detection.normal_kernel if config.coherent else radar_detection.uniform_kernel
    return _echoes(config, cells, _draw(kernel, keys, cells.view, cells.cell, ECHO_DRAW, device))


def _echoes(config: Radar, cells: RadarCells, numbers: np.ndarray) -> np.ndarray:
    """Return the same of numbers that are drawn, shape [K, 4]: normal for `Radar.coherent`, else uniform."""
    if config.coherent:
        noise = numbers * math.sqrt(config.noise_w / 2.0)
        return (np.sqrt(cells.power.astype(np.float64)) + noise[:, 0]) ** 2 + noise[:, 1] ** 2
    return -np.log(numbers[:, 0]) * (config.noise_w + cells.power.astype(np.float64))


def detect(config: Radar, cells: RadarCells, clutter: RainClutter | None, keys: np.ndarray, device: str) -> RadarPoints:
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
        device: Warp device name.
    """
    noise = _noise_cells(config, len(keys))
    echoes, u, place = _first_draws(config, cells, noise, keys, device)
    found = [_objects(config, cells, echoes)]
    if clutter is not None:
        found.append(_rain(config, clutter, keys, device))
    found.append(_false_alarms(config, noise, cells, clutter, u, place))
    points = _Points(*(np.concatenate(columns) for columns in zip(*map(_columns, found), strict=True)))
    points = _select(points, np.lexsort((points.range.astype(np.float32), points.view)))
    is_peak, normal = _peaks(config, points, keys, device)
    points = _select(points, is_peak)
    measured = _measured(config, points, normal[is_peak], len(keys))
    return measured if cells.path_type is None else replace(measured, path_type=points.path_type)


@dataclass(frozen=True)
class _NoiseCells:
    """Cells of the field of view of a radar, which false alarms are drawn in, and the items of their random numbers."""

    y_cells: np.ndarray
    z_cells: np.ndarray
    shape: tuple[int, int, int, int]
    """Number of cells in range, velocity, y and z."""
    most: int
    """False alarms of a view: more are ten standard deviations away."""
    view: np.ndarray
    """View of each item, shape [A most]."""
    item: np.ndarray
    """Number of each item in its view, shape [A most]."""


@remembered(size=32)
def _noise_cells(config: Radar, views: int) -> _NoiseCells:
    grid = cell_grid(config)
    y_cells = angle_cells(grid.ys, config.horizontal_fov_deg)
    z_cells = angle_cells(grid.zs, config.vertical_fov_deg)
    shape = (grid.ranges, grid.velocities, len(y_cells), len(z_cells))
    mean = math.prod(shape) * config.false_alarm_probability
    most = math.ceil(mean + 10.0 * math.sqrt(mean) + 20.0)
    view, item = np.repeat(np.arange(views), most), np.tile(np.arange(most), views)
    return _NoiseCells(y_cells, z_cells, shape, most, view, item)


def _first_draws(
    config: Radar, cells: RadarCells, noise: _NoiseCells, keys: np.ndarray, device: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return `cell_echoes`, and the uniform numbers of false alarms and of their places, shape [A most, 4] each.

    All are drawn at once, as each draw waits for the device.
    """
    first = 0 if config.coherent else len(cells.view)
    own = (cells.view, cells.cell) if first else (noise.view[:0], noise.item[:0])
    view, item = (np.concatenate(parts) for parts in zip(own, *[(noise.view, noise.item)] * 2, strict=True))
    draw = np.repeat((ECHO_DRAW, ALARM_DRAW, ALARM_PLACE_DRAW), (first, len(noise.view), len(noise.view)))
    echo, u, place = np.split(uniform(keys, view, item, draw, device), (first, first + len(noise.view)))
    echoes = _echoes(config, cells, echo) if not config.coherent else cell_echoes(config, cells, keys, device)
    return echoes, u, place


def _columns(points: _Points) -> list[np.ndarray]:
    return [getattr(points, name) for name in _COLUMNS]


def _draw(
    kernel: wp.Kernel, keys: np.ndarray, view: np.ndarray, item: np.ndarray, draw: int | np.ndarray, device: str
) -> np.ndarray:
    count, room = len(view), padded_count(len(view))
    block = borrow_arrays(device, ((len(keys),), wp.vec2ui), *[((room,), wp.int32)] * 3, ((room,), wp.vec4))
    host = block.host
    host[0][:], host[1][:count], host[2][:count], host[3][:count] = keys, view, item, draw
    *inputs, out = block.upload()
    launch_again(kernel, (count,), [*inputs, out], device)
    numbers = block.download()[4][:count].astype(np.float64)
    block.release()
    return numbers


def uniform(keys: np.ndarray, view: np.ndarray, item: np.ndarray, draw: int | np.ndarray, device: str) -> np.ndarray:
    """Return four uniform numbers in (0, 1) for each item of a list, shape [N, 4], float64.

    Args:
        keys: Key of each view's random numbers, shape [A, 2], uint32.
        view: View of each item, shape [N].
        item: Cell, pixel or number, shape [N].
        draw: Which draw of the item, one for all or shape [N].
        device: Warp device name.
    """
    return _draw(radar_detection.uniform_kernel, keys, view, item, draw, device)


def threshold(config: Radar) -> float:
    """Return the power above which a cell is a detection [W]: noise exceeds it with the false alarm probability."""
    return -config.noise_w * math.log(config.false_alarm_probability)


def _select(points: _Points, rows: np.ndarray) -> _Points:
    return _Points(*(column[rows] for column in _columns(points)))


def _objects(config: Radar, cells: RadarCells, power: np.ndarray) -> _Points:
    """Return the occupied cells above the threshold; `power` is from `cell_echoes`."""
    rcs = cells.rcs * (power - config.noise_w) / cells.power
    label = np.full(len(power), LABEL_OBJECT, dtype=np.uint8)
    places = (cells.range, cells.velocity, cells.y, cells.z)
    path_type = np.zeros(len(power), dtype=np.uint8) if cells.path_type is None else cells.path_type
    points = _Points(cells.view, *places, power, rcs, cells.object_id, label, cells.cell, path_type)
    return _select(points, power > threshold(config))


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


def _rain(config: Radar, clutter: RainClutter, keys: np.ndarray, device: str) -> _Points:
    grid = cell_grid(config)
    view, r, direction = np.nonzero(clutter.power > threshold(config))
    power = clutter.power[view, r, direction].astype(np.float64)
    v, y, z = clutter.velocity_cell[view, r, direction], clutter.y_cell[direction], clutter.z_cell[direction]
    cell = number(grid, r, v, y, z)
    places = _inside(grid, r, v, y, z, uniform(keys, view, cell, RAIN_PLACE_DRAW, device))
    rcs = clutter.rcs_per_w[r, direction] * (power - config.noise_w)
    nothing, label = np.full(len(view), -1, dtype=np.int32), np.full(len(view), LABEL_RAIN, dtype=np.uint8)
    return _Points(view, *places, power, rcs, nothing, label, cell, np.zeros_like(label))


def _false_alarms(
    config: Radar,
    noise: _NoiseCells,
    cells: RadarCells,
    clutter: RainClutter | None,
    u: np.ndarray,
    in_cell: np.ndarray,
) -> _Points:
    """Return the cells of the field of view in which noise alone exceeds the threshold.

    The cells form a line; from one false alarm to the next it is a geometric number of cells. Cells that echoes or
    rain were drawn for have had their noise. `u` and `in_cell` are the uniform numbers of `_first_draws`.
    """
    grid, shape = cell_grid(config), noise.shape
    gap = np.floor(np.log(u[:, 0]) / math.log1p(-config.false_alarm_probability)) + 1.0
    place = (np.cumsum(gap.reshape(-1, noise.most), axis=1) - 1.0).reshape(-1)
    is_there = place < math.prod(shape)
    view, u, in_cell, place = noise.view[is_there], u[is_there], in_cell[is_there], place[is_there].astype(np.int64)
    r, v, y, z = np.unravel_index(place, shape)
    y, z = noise.y_cells[y], noise.z_cells[z]
    v = centred(v, grid.velocities)
    cell = number(grid, r, v, y, z)
    per_view = np.int64(2**31)
    occupied = np.append(cells.view * per_view + cells.cell, np.iinfo(np.int64).max)  # ascending
    alarm = view * per_view + cell
    is_occupied = occupied[np.searchsorted(occupied, alarm)] == alarm
    if clutter is not None:
        is_occupied |= _is_rain(config, clutter, view, r, v, y, z)
    rows = ~is_occupied & ((y * grid.y_step) ** 2 + (z * grid.z_step) ** 2 <= 1.0)
    view, cell, u = view[rows], cell[rows], u[rows]
    places = _inside(grid, r[rows], v[rows], y[rows], z[rows], in_cell[rows])
    power = threshold(config) - config.noise_w * np.log(u[:, 1])
    rcs = (power - config.noise_w) * places[0] ** 4 / config.link_constant
    nothing, label = np.full(len(view), -1, dtype=np.int32), np.full(len(view), LABEL_FALSE_ALARM, dtype=np.uint8)
    return _Points(view, *places, power, rcs, nothing, label, cell, np.zeros_like(label))


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


def _peaks(config: Radar, points: _Points, keys: np.ndarray, device: str) -> tuple[np.ndarray, np.ndarray]:
    """Return which points have no stronger one less than a cell away, and four normal numbers of each, shape [D, 4]."""
    count, room = len(points.view), padded_count(len(points.view))
    places = ("range", "velocity", "y", "z", "power")
    block = borrow_arrays(
        device,
        ((len(keys),), wp.vec2ui),
        *[((room,), wp.int32)] * 3,
        *[((room,), wp.float32)] * len(places),
        ((room,), wp.int32),
        ((room,), wp.vec4),
    )
    key, view, cell, draw, *values = block.host[:-2]
    key[:], view[:count], view[count:], cell[:count], draw[:count] = keys, points.view, -1, points.cell, ERROR_DRAW
    for name, column in zip(places, values, strict=True):
        column[:count] = getattr(points, name)
    arrays = block.upload()
    candidates = block.struct(radar_detection.Candidates, None, "view", None, None, *places, None, None)
    launch_again(radar_detection.peak_kernel, (count,), [candidates, cell_grid(config), arrays[-2]], device)
    launch_again(radar_detection.normal_kernel, (count,), [*arrays[:4], arrays[-1]], device)
    *_, is_peak, normal = block.download()
    found = is_peak[:count] != 0, normal[:count].astype(np.float64)
    block.release()
    return found


def _measured(config: Radar, points: _Points, normal: np.ndarray, views: int) -> RadarPoints:
    """Return the points of some views as they are measured, with errors from four normal numbers of each."""
    grid = cell_grid(config)
    snr = (points.power - config.noise_w) / config.noise_w
    error = np.clip(normal / (BARTON * np.sqrt(2.0 * snr))[:, None], -0.5, 0.5)
    error *= (points.label == LABEL_OBJECT)[:, None]  # the others are anywhere in their cell already
    range_ = np.abs(points.range + error[:, 0] * grid.range_step)
    velocity = _folded(points.velocity + error[:, 1] * grid.velocity_step, config.max_velocity)
    y = _folded(points.y + error[:, 2] * grid.y_step, 1.0) if grid.ys > 1 else points.y
    z = _folded(points.z + error[:, 3] * grid.z_step, 1.0) if grid.zs > 1 else points.z
    z = np.clip(z, -1.0, 1.0)
    azimuth = np.arctan2(y, np.sqrt(np.maximum(1.0 - y**2 - z**2, 0.0)))
    offsets = np.searchsorted(points.view, np.arange(views + 1)).astype(np.int32)
    places = (value.astype(np.float32) for value in (range_, azimuth, np.arcsin(z), velocity))
    power = decibels((points.power - config.noise_w) * 1000.0)
    return RadarPoints(
        offsets, *places, power, decibels(snr), decibels(points.rcs), points.object_id.astype(np.int32), points.label
    )


def _folded(value: np.ndarray, half: float) -> np.ndarray:
    """Return values in [-half, half)."""
    return (value + half) % (2.0 * half) - half
