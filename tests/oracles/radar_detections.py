"""Detect radar echoes in NumPy: random numbers, threshold, false alarms, local maxima and estimates, in float64."""

import numpy as np

from mmw.sensors import Radar
from mmw.sensors.radar.rain_clutter import RainClutter
from mmw.sensors.radar.resolution_cells import RadarCells, angle_cells

ECHO, ERROR, RAIN_PLACE, ALARM, ALARM_PLACE = range(5)
"""Draws of a view's random numbers."""


def uniform(key: np.ndarray, item: np.ndarray, draw: int) -> np.ndarray:
    """Return four uniform numbers of each item, shape [N, 4], float32: hash pcg4d of Jarzynski and Olano (2020)."""
    mask = np.uint64(0xFFFFFFFF)
    words = np.stack(np.broadcast_arrays(key[..., 0], key[..., 1], item, draw)).astype(np.int64).astype(np.uint64)
    x, y, z, w = ((v * np.uint64(1664525) + np.uint64(1013904223)) & mask for v in words & mask)
    for is_last in (False, True):
        x = (x + y * w) & mask
        y = (y + z * x) & mask
        z = (z + x * y) & mask
        w = (w + y * z) & mask
        if not is_last:
            x, y, z, w = (v ^ (v >> np.uint64(16)) for v in (x, y, z, w))
    cell = (np.stack([x, y, z, w], axis=-1) >> np.uint64(8)).astype(np.float32)
    return np.minimum((cell + np.float32(0.5)) * np.float32(2.0**-24), np.float32(1.0 - 2.0**-24))


def normal(key: np.ndarray, item: np.ndarray, draw: int) -> np.ndarray:
    """Return four standard normal numbers of each item, shape [N, 4], by Box and Muller (1958)."""
    u = uniform(key, item, draw).astype(np.float64)
    radius, angle = np.sqrt(-2.0 * np.log(u[:, ::2])), 2.0 * np.pi * u[:, 1::2]
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1).reshape(-1, 4)


def detections(
    config: Radar, cells: RadarCells, clutter: RainClutter | None, keys: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the columns of `RadarPoints`, and `view`, of what `mmw.sensors.radar.detection.detect` detects."""
    noise, level = config.noise_w, -config.noise_w * np.log(config.false_alarm_probability)
    steps = np.array(
        [
            config.range_resolution,
            config.velocity_resolution,
            2.0 / config.azimuth_antennas,
            2.0 / config.elevation_antennas,
        ]
    )
    counts = np.array([config.range_cells + 1, config.chirps, config.azimuth_antennas, config.elevation_antennas])
    measures = np.array([1, 1, counts[2] > 1, counts[3] > 1])

    own = keys[cells.view]
    power = cells.power.astype(np.float64)
    if config.coherent:
        drawn = normal(own, cells.cell, ECHO) * np.sqrt(noise / 2.0)
        received = (np.sqrt(power) + drawn[:, 0]) ** 2 + drawn[:, 1] ** 2
    else:
        received = -np.log(uniform(own, cells.cell, ECHO)[:, 0].astype(np.float64)) * (noise + power)
    place = np.column_stack([cells.range, cells.velocity, cells.y, cells.z]).astype(np.float64)
    rcs = cells.rcs * (received - noise) / power
    is_there = received > level
    found = [
        (view, *place[i], received[i], rcs[i], cells.object_id[i], 0, cells.cell[i])
        for i, view in enumerate(cells.view)
        if is_there[i]
    ]

    def number(cell: tuple[int, ...]) -> int:
        return int(np.ravel_multi_index(tuple(np.array(cell) % counts), tuple(counts)))

    drawn_for = set(zip(cells.view.tolist(), cells.cell.tolist(), strict=True))
    if clutter is not None:
        for view, r, j in zip(*np.nonzero(clutter.power > 0.0), strict=True):
            middle, width = (x[view, j] / steps[1] for x in (clutter.mean_velocity, clutter.spread))
            first, last = np.rint(middle - 3.0 * width), np.rint(middle + 3.0 * width)
            angles = int(clutter.y_cell[j]), int(clutter.z_cell[j])
            drawn_for |= {
                (view, number((r, int(v), *angles))) for v in np.arange(first, min(last, first + counts[1] - 1) + 1)
            }
            received_w = float(clutter.power[view, r, j])
            if received_w > level:
                cell = (r, int(clutter.velocity_cell[view, r, j]), *angles)
                part = uniform(keys[view], np.array([number(cell)]), RAIN_PLACE)[0].astype(np.float64) - 0.5
                at = (np.array(cell) + part) * steps * measures
                rcs_m2 = clutter.rcs_per_w[r, j] * (received_w - noise)
                found.append((view, abs(at[0]), *at[1:], received_w, rcs_m2, -1, 1, number(cell)))

    y_cells = angle_cells(counts[2], config.horizontal_fov_deg)
    z_cells = angle_cells(counts[3], config.vertical_fov_deg)
    shape = (counts[0], counts[1], len(y_cells), len(z_cells))
    for view, key in enumerate(keys):
        end, item = 0.0, 0
        while True:
            u, part = (uniform(key, np.array([item]), draw)[0].astype(np.float64) for draw in (ALARM, ALARM_PLACE))
            item, end = item + 1, end + np.floor(np.log(u[0]) / np.log1p(-config.false_alarm_probability)) + 1.0
            if end > np.prod(shape):
                break
            r, v, y, z = np.unravel_index(int(end) - 1, shape)
            cell = (int(r), int(v) if 2 * v < counts[1] else int(v) - counts[1], int(y_cells[y]), int(z_cells[z]))
            if (view, number(cell)) in drawn_for or np.hypot(cell[2] * steps[2], cell[3] * steps[3]) > 1.0:
                continue
            at = (np.array(cell) + part - 0.5) * steps * measures
            received_w = level - noise * np.log(u[1])
            rcs_m2 = (received_w - noise) * at[0] ** 4 / config.link_constant
            found.append((view, abs(at[0]), *at[1:], received_w, rcs_m2, -1, 2, number(cell)))

    table = np.array(found, dtype=np.float64).reshape(-1, 10)
    table = table[np.lexsort((table[:, 1].astype(np.float32), table[:, 0]))]
    kept = [i for i in range(len(table)) if not _has_stronger(table, i, steps, counts)]
    return _measured(config, table[kept], keys, steps, measures)


def _has_stronger(table: np.ndarray, own: int, steps: np.ndarray, counts: np.ndarray) -> bool:
    """Return whether a stronger point of the view is less than a cell away on every axis; positions in float32."""
    places, powers = table[:, 1:5].astype(np.float32), table[:, 5].astype(np.float32)
    gap = np.abs(places - places[own])
    ring = (steps * counts).astype(np.float32)
    gap[:, 1:] = np.where(counts[1:] == 1, 0.0, np.minimum(gap[:, 1:], ring[1:] - gap[:, 1:]))
    is_near = (gap < 0.9999 * steps).all(axis=1) & (table[:, 0] == table[own, 0])
    is_stronger = (powers > powers[own]) | ((powers == powers[own]) & (np.arange(len(table)) < own))
    return bool((is_near & is_stronger).any())


def _measured(
    config: Radar, table: np.ndarray, keys: np.ndarray, steps: np.ndarray, measures: np.ndarray
) -> dict[str, np.ndarray]:
    view, label = table[:, 0].astype(int), table[:, 8].astype(int)
    snr = table[:, 5] / config.noise_w - 1.0
    error = normal(keys[view], table[:, 9].astype(np.int64), ERROR) / (1.6 * np.sqrt(2.0 * snr))[:, None]
    error = np.clip(error, -0.5, 0.5) * (label == 0)[:, None]
    place = table[:, 1:5] + error * steps * measures
    for axis, half in ((1, config.max_velocity), (2, 1.0), (3, 1.0)):
        if axis == 1 or measures[axis]:
            place[:, axis] = (place[:, axis] + half) % (2.0 * half) - half
    y, z = place[:, 2], np.clip(place[:, 3], -1.0, 1.0)
    return {
        "view": view,
        "range": np.abs(place[:, 0]),
        "azimuth": np.arctan2(y, np.sqrt(np.maximum(1.0 - y**2 - z**2, 0.0))),
        "elevation": np.arcsin(z),
        "velocity": place[:, 1],
        "power_db": 10.0 * np.log10(1000.0 * config.noise_w * snr),
        "snr_db": 10.0 * np.log10(snr),
        "rcs_dbsm": 10.0 * np.log10(table[:, 6]),
        "object_id": table[:, 7].astype(int),
        "label": label,
    }
