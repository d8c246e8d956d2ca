"""Make power maps of a radar: range against azimuth, or against velocity, from the cells of the detections."""

import numpy as np

from mmw.kernels.radar import resolution_cells as radar_cells
from mmw.sensors.radar.config import Radar
from mmw.sensors.radar.detection import cell_echoes, uniform
from mmw.sensors.radar.points import MapKind, RadarMaps
from mmw.sensors.radar.rain_clutter import RainClutter
from mmw.sensors.radar.resolution_cells import RadarCells, angle_cells, cell_grid, centred, unravel
from mmw.sensors.radar.trace import decibels

MAP_DRAW: dict[str, int] = {"range_azimuth": 8, "range_doppler": 9}
"""Draw of the random numbers of a map's noise, by kind; the item is the pixel."""

LOBE = 2
"""Cells on either side that an echo leaks into: half the main lobe of the Hann window. The sidelobes beyond it, 31 dB
down, are left out."""


def hann_response(x: np.ndarray) -> np.ndarray:
    """Return the power response of a Hann window x bins from an echo, 1 at 0 and 0 beyond the main lobe.

    Source: F. Harris, "On the use of windows for harmonic analysis with the discrete Fourier transform", Proc. IEEE 66,
    1978: sinc(x) / (1 - x^2).
    """
    x = np.abs(np.asarray(x, dtype=np.float64))
    is_pole = np.abs(x - 1.0) < 1e-6
    response = np.where(is_pole, 0.5, np.sinc(x) / np.where(is_pole, 1.0, 1.0 - x**2))
    return np.where(x < LOBE, response**2, 0.0)


def radar_maps(
    config: Radar, kind: MapKind, cells: RadarCells, clutter: RainClutter | None, keys: np.ndarray, device: str
) -> RadarMaps:
    """Return maps of the strongest cell in each pixel: peak hold over velocity and z, or over y and z.

    The echo of a cell, drawn as for the detections, leaks along the two axes of the map as a Hann window spreads it
    from where its mean is: an echo between two cells is 1.4 dB down in both. Thermal noise is the largest of as many
    exponential numbers as a pixel holds cells of the field of view, by inverse transform of its distribution, so a
    detection of power P shows up as about P, over a floor of about ln(n) times the noise of one cell. Rain is that of
    `RainClutter`, without leakage.
    """
    grid = cell_grid(config)
    y_cells = angle_cells(grid.ys, config.horizontal_fov_deg)
    z_count = len(angle_cells(grid.zs, config.vertical_fov_deg))
    if kind == "range_azimuth":
        columns, first, step, behind = len(y_cells), y_cells[0], grid.y_step, grid.velocities * z_count
    else:
        columns, first = grid.velocities, -(grid.velocities // 2)
        step, behind = grid.velocity_step, len(y_cells) * z_count
    shape = (len(keys), grid.ranges, columns)
    power = _noise(config, shape, behind, keys, MAP_DRAW[kind], device)
    _add_echoes(config, kind, grid, int(first), cells, cell_echoes(config, cells, keys), power)
    if clutter is not None:
        _add_rain(kind, grid, int(first), clutter, power)
    values = decibels(power * 1000.0)
    return RadarMaps(kind, values, 0.0, float(grid.range_step), float(first * step), float(step))


def _noise(
    config: Radar, shape: tuple[int, int, int], behind: int, keys: np.ndarray, draw: int, device: str
) -> np.ndarray:
    pixels = shape[1] * shape[2]
    view, item = np.repeat(np.arange(shape[0]), pixels), np.tile(np.arange(pixels), shape[0])
    u = uniform(keys, view, item, draw, device)[:, 0]
    return (-config.noise_w * np.log(-np.expm1(np.log(u) / behind))).reshape(shape)


def _add_echoes(
    config: Radar,
    kind: MapKind,
    grid: radar_cells.CellGrid,
    first: int,
    cells: RadarCells,
    echo: np.ndarray,
    power: np.ndarray,
) -> None:
    r, v, y, _ = unravel(grid, cells.cell)
    if kind == "range_azimuth":
        column, count, position = y, grid.ys, cells.y / grid.y_step
    else:
        column, count, position = v, grid.velocities, cells.velocity / grid.velocity_step
    along = cells.range / grid.range_step
    for row_shift in range(-LOBE, LOBE + 1):
        row = r + row_shift
        across = echo * hann_response(row - along)
        for shift in range(-LOBE, LOBE + 1) if count > 1 else (0,):
            at = column + shift
            leaked = across * (hann_response(at - position) if count > 1 else 1.0)
            pixel = centred(at % count, count) - first  # the axis wraps around
            is_there = (row >= 0) & (row < power.shape[1]) & (pixel >= 0) & (pixel < power.shape[2])
            place = (cells.view[is_there], row[is_there], pixel[is_there])
            np.maximum.at(power, place, leaked[is_there])


def _add_rain(kind: MapKind, grid: radar_cells.CellGrid, first: int, clutter: RainClutter, power: np.ndarray) -> None:
    view, row, direction = np.nonzero(clutter.power)
    if kind == "range_azimuth":
        column = clutter.y_cell[direction]
    else:
        column = centred(clutter.velocity_cell[view, row, direction] % grid.velocities, grid.velocities)
    np.maximum.at(power, (view, row, column - first), clutter.power[view, row, direction].astype(np.float64))
