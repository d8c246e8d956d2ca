"""Trace radar rays once a batch, and evaluate the radar equation in every weather."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import warp as wp

from mmw.core.remember import remembered
from mmw.core.repeated_launch import launch_again
from mmw.core.transfer import to_host
from mmw.kernels.radar import trace as radar
from mmw.physics.em.attenuation import path_loss_db
from mmw.physics.materials.material import Material
from mmw.physics.weather.weather import Weather
from mmw.scene.device_scene import DeviceScene
from mmw.scene.views import Views
from mmw.sensors.radar.config import Radar
from mmw.sensors.radar.points import LABEL_OBJECT, RadarPoints
from mmw.sensors.radar.radar_arrays import SHARED, RadarArrays
from mmw.sensors.radar.reflectivity import reflectivity_table
from mmw.sensors.ray_batch import BLOCK_DIM, check_count

RADOME_RAIN_MM_H = 10.0
"""Rain rate at which a wet radome has the loss `Radar.wet_radome_db` [mm/h]."""


def trace_radar(
    scene: DeviceScene,
    views: Views,
    velocity: np.ndarray,
    config: Radar,
    keys: np.ndarray,
    arrays: RadarArrays | None = None,
) -> radar.RadarHits:
    """Return the first surface on every ray of every view: geometry and motion only, so it serves every weather.

    `carla` casts CARLA's rays: end points on the plane x = range, at a radius u and an angle 2 pi v of the ellipse
    that the field of view cuts out of it, with u and v uniform. The rays are dense in the middle, and reach
    range / cos(angle) off it. A surface moves with its actor's origin; the town is at rest, and is hit like
    everything else.

    `physical` casts one ray in each cell of a grid that is even in azimuth and in the sine of elevation, so that all
    rays have the same solid angle. Where in its cell is random and anew in each frame: each point of a cell is equally
    likely, so the sum over an object's rays has its RCS as the mean, however small the object is. Rays through the
    middles of the cells would see or miss a thin pole in all frames alike. A surface moves with its own point.

    Args:
        scene: Town and vehicles, with the views' frames loaded.
        views: Sensor poses, A rows.
        velocity: Velocity of each view's sensor, world frame [m/s], shape [A, 3] (`mmw.scene.views.view_twists`).
        config: Field of view, range and number of rays R.
        keys: Key of each view's random numbers, without the weather (`mmw.scene.views.view_keys`), shape [A, 2],
            uint32.
        arrays: Where the hits go; None for new ones.

    Returns:
        Arrays of shape [A, R] on the scene's device.

    Raises:
        ValueError: If a view's frame is not loaded in the scene, the batch has too many rays, or velocities or keys are
            not one a view.

    Source: CARLA 0.9.15 `sensor.other.radar`. Its velocity is positive while the distance grows, as ours, whatever its
    documentation says. Stratified sampling: M. Pharr, W. Jakob, G. Humphreys, Physically Based Rendering.
    """
    device, rays = scene.device, config.ray_count
    arrays = RadarArrays(len(views), rays, device) if arrays is None else arrays
    place_rays(scene, views, velocity, config, keys, arrays)
    launch_rays(scene, config, arrays)
    return arrays.hits


def place_rays(
    scene: DeviceScene, views: Views, velocity: np.ndarray, config: Radar, keys: np.ndarray, arrays: RadarArrays
) -> None:
    """Write what `launch_rays` copies to the device; see `trace_radar`."""
    for name, values, width in (("velocity", velocity, 3), ("keys", keys, 2)):
        if np.shape(values) != (len(views), width):
            raise ValueError(
                f"radar: {name} has shape {np.shape(values)}; one row a view is needed, ({len(views)}, {width}); make "
                "it from the same views"
            )
    check_count("radar", len(views), config.ray_count)
    if len(views):
        *own, velocity_out, key_out = arrays.given.host
        views.write(scene, own)
        velocity_out[:], key_out[:] = velocity, keys


def launch_rays(scene: DeviceScene, config: Radar, arrays: RadarArrays) -> None:
    """Launch what finds the hits of rays that are placed."""
    if not arrays.shape[0]:
        return
    arrays.given.upload()
    common = [scene.struct, arrays.views, arrays.velocity, arrays.key]
    if config.mode == "carla":
        kernel, inputs = radar.carla_kernel, [*common, _carla_plane(config)]
    else:
        kernel, inputs = radar.grid_kernel, [*common, radar_grid(config), config.range_m]
    launch_again(kernel, arrays.shape, [*inputs, arrays.hits], arrays.device, BLOCK_DIM)


@remembered(size=32)
def _carla_plane(config: Radar) -> wp.vec3:
    """Return the distance of the plane on which CARLA's rays end, and the half axes of the ellipse on it [m]."""
    half_azimuth = math.radians(config.horizontal_fov_deg) / 2.0
    half_elevation = math.radians(config.vertical_fov_deg) / 2.0
    return wp.vec3(*(config.range_m * np.array([1.0, math.tan(half_azimuth), math.tan(half_elevation)])))


@remembered(size=32)
def radar_grid(config: Radar) -> radar.RadarGrid:
    """Return the grid of rays of `physical`."""
    grid = radar.RadarGrid()
    grid.columns, grid.rows = config.azimuth_rays, config.elevation_rays
    grid.half_azimuth = math.radians(config.horizontal_fov_deg) / 2.0
    grid.half_sine = math.sin(math.radians(config.vertical_fov_deg) / 2.0)
    return grid


def air_loss_db_per_km(weather: Weather, carrier_hz: float) -> float:
    """Return the attenuation of a level, vertically polarised wave by rain, fog and gas of a weather, one way [dB/km].

    Source: ITU-R P.838-3, P.840-9 and P.676-13, see `mmw.physics.em.attenuation`.
    """
    losses = path_loss_db(weather, carrier_hz, np.array([1000.0]), np.zeros(1))
    return float(sum(loss[0, 0] for loss in losses.values()))


def radome_loss_db(weather: Weather, config: Radar) -> float:
    """Return the loss of the water film on the radome, both ways together [dB]; 0 without rain.

    The film grows as the cube root of the rain rate, and the loss of a thin film with its thickness.

    Source: laminar flow of a film, D. Gibble, "Effect of rain on transmission performance of a satellite communication
    system", IEEE International Convention Record, 1964.
    """
    return config.wet_radome_db * (weather.rain_mm_h / RADOME_RAIN_MM_H) ** (1.0 / 3.0)


@remembered(owners=2, size=32)
def radar_link(weather: Weather, config: Radar) -> radar.RadarLink:
    """Return the radar equation of one weather."""
    link = radar.RadarLink()
    link.constant = config.link_constant * 10.0 ** (-radome_loss_db(weather, config) / 10.0)
    link.solid_angle = config.solid_angle
    link.loss_per_m = 2.0 * air_loss_db_per_km(weather, config.carrier_hz) / 1000.0 * math.log(10.0) / 10.0
    link.azimuth_beam = math.radians(config.horizontal_beam_deg or config.horizontal_fov_deg)
    link.elevation_beam = math.radians(config.vertical_beam_deg or config.vertical_fov_deg)
    return link


@remembered(owners=2, size=32)
def surfaces_on_device(materials: Sequence[Material], weather: Weather, carrier_hz: float, device: str) -> wp.array:
    """Return `reflectivity_table` on a device, shape [M], vec3."""
    return wp.array(reflectivity_table(materials, weather, carrier_hz), dtype=wp.vec3, device=device)


def shade_radar(
    hits: radar.RadarHits,
    materials: Sequence[Material],
    weather: Weather,
    config: Radar,
    arrays: RadarArrays | None = None,
) -> radar.RadarRays:
    """Return the echoes of traced rays in one weather.

    A ray represents the surface that its solid angle W covers, W R^2 / cos(incidence): times the backscatter
    coefficient that is its share of the RCS, and the radar equation makes power of it.

    Args:
        hits: Hits of the rays, of `physical`.
        materials: Materials by id, as they are in the weather (`SceneData.materials[weather]`).
        weather: Rain, fog and air on the path, and how wet surfaces are.
        config: Power, antennas and carrier.
        arrays: Those that have the hits; the echoes of the next weather then overwrite these. None for echoes that
            stay.

    Returns:
        Arrays of shape [A, R] on the device; all but `power` and `rcs` are those of `hits`.

    Raises:
        ValueError: If there are no materials, one has an unknown base, or the carrier is outside a loss model.
    """
    device, shape = hits.range.device, hits.range.shape
    if arrays is None:
        rays = radar.RadarRays()
        for name in SHARED:
            setattr(rays, name, getattr(hits, name))
        rays.rcs, rays.power = (wp.empty(shape, dtype=float, device=device) for _ in range(2))
    else:
        rays = arrays.rays
    surface = surfaces_on_device(materials, weather, config.carrier_hz, str(device))
    inputs = [hits, surface, radar_link(weather, config)]
    launch_again(radar.echo_kernel, shape, [*inputs, rays.rcs, rays.power], str(device), BLOCK_DIM)
    return rays


def decibels(values: np.ndarray) -> np.ndarray:
    """Return 10 log10 of positive values, float32."""
    return (10.0 * np.log10(values.astype(np.float64))).astype(np.float32)


def carla_points(hits: radar.RadarHits) -> RadarPoints:
    """Return what CARLA's radar reports: every ray with a hit, in the order of the rays."""
    columns = to_host([getattr(hits, name) for name in SHARED])
    return _points(columns, columns[-1] >= 0, None, None, None)


def dense_points(rays: radar.RadarRays, config: Radar) -> RadarPoints:
    """Return every ray that has an echo, in the order of the rays, without noise or threshold.

    Echoes of multipath follow those of all rays of their view.
    """
    has_paths = config.multipath != "none"
    names = (*SHARED, "power", "rcs", *(("path_type",) if has_paths else ()))
    found = to_host([getattr(rays, name) for name in names])
    columns, power, rcs = found[: len(SHARED)], found[len(SHARED)], found[len(SHARED) + 1]
    is_echo = power > 0.0
    power_w = power[is_echo].astype(np.float64)
    points = _points(
        columns, is_echo, decibels(power_w * 1000.0), decibels(power_w / config.noise_w), decibels(rcs[is_echo])
    )
    return replace(points, path_type=found[-1][is_echo]) if has_paths else points


def _points(
    columns: Sequence[np.ndarray],
    is_kept: np.ndarray,
    power_db: np.ndarray | None,
    snr_db: np.ndarray | None,
    rcs_dbsm: np.ndarray | None,
) -> RadarPoints:
    """Return some of the rays, by the columns of `SHARED`."""
    offsets = np.concatenate([[0], np.cumsum(is_kept.sum(axis=1))]).astype(np.int32)
    *lists, object_id = (column[is_kept] for column in columns)
    label = np.full(len(object_id), LABEL_OBJECT, dtype=np.uint8)
    return RadarPoints(offsets, *lists, power_db, snr_db, rcs_dbsm, object_id, label)
