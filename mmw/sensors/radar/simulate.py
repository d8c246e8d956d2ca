"""Simulate a radar: rays traced once a batch, points, maps and samples evaluated in every weather."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from mmw.core.recorded_work import Same
from mmw.kernels.radar.resolution_cells import CellSums
from mmw.kernels.radar.trace import RadarHits, RadarRays
from mmw.physics.materials.material import Material
from mmw.physics.weather.weather import Weather
from mmw.scene.views import view_twists
from mmw.sensors.radar.config import Radar
from mmw.sensors.radar.detection import detect
from mmw.sensors.radar.detection_arrays import DetectionArrays
from mmw.sensors.radar.iq import radar_iq_samples
from mmw.sensors.radar.multipath import PlacedPaths, TracedPaths, place_paths, shade_paths, trace_paths
from mmw.sensors.radar.points import RadarPoints
from mmw.sensors.radar.power_maps import radar_maps
from mmw.sensors.radar.radar_arrays import RadarArrays
from mmw.sensors.radar.rain_clutter import rain_clutter
from mmw.sensors.radar.resolution_cells import RadarCells, bin_rays, cell_order, queue_sums, sort_rays, sum_cells
from mmw.sensors.radar.trace import (
    carla_points,
    dense_points,
    launch_rays,
    place_rays,
    radar_link,
    shade_radar,
    surfaces_on_device,
    trace_radar,
)
from mmw.sensors.sensor_input import SensorInput
from mmw.sensors.workspace import workspace


class _Echoes:
    """The echoes of a batch: those of its hits, with phases and further paths where the radar has them."""

    def __init__(self, config: Radar, hits: RadarHits, paths: TracedPaths | None, arrays: RadarArrays):
        self._config, self._hits, self._paths, self._arrays = config, hits, paths, arrays
        self._placed: dict[bool, PlacedPaths | None] = {}

    def shade(self, materials: Sequence[Material], weather: Weather, *, merges: bool) -> RadarRays:
        """Return the echoes in one weather; see `mmw.sensors.radar.multipath.place_paths`."""
        if self._paths is None:
            return shade_radar(self._hits, materials, weather, self._config, self._arrays)
        if merges not in self._placed:  # the same in every weather
            self._placed[merges] = place_paths(self._hits, self._paths, self._config, merges=merges)
        return shade_paths(self._hits, self._paths, self._placed[merges], materials, weather, self._config)

    @property
    def has_mirrors(self) -> bool:
        """True if a ray has several paths, so that those that interfere and single ones differ."""
        return self._config.multipath != "none"


def simulate(data: SensorInput, config: Radar) -> dict[str, RadarPoints]:
    """Return the points of all views in each weather, with the maps and samples that the radar is configured for."""
    return dict(scans(data, config))


def scans(data: SensorInput, config: Radar) -> Iterator[tuple[str, RadarPoints]]:
    """Trace all views once, and yield what `simulate` returns in one weather after the other.

    Where the rays go does not depend on the weather; fluctuation, noise, rain and false alarms do, each by its own key.
    """
    velocity, _ = view_twists(data.scene.arrays, data.motion, data.views)
    keys = data.keys(config.name)
    count, device = len(data.views), data.scene.device
    arrays = workspace(
        data.cache, config, count, config.ray_count, lambda: RadarArrays(count, config.ray_count, device)
    )
    needs_cells = config.mode == "physical" and (config.output == "detections" or len(config.maps) > 0)
    if needs_cells and not config.needs_paths:
        place_rays(data.scene, data.views, velocity, config, keys, arrays)
        for place, (name, weather) in enumerate(data.weathers.items()):
            cells, weather_keys = _cells(data, config, arrays, name, is_first=place == 0), data.keys(name, config.name)
            iq = radar_iq_samples(config, arrays.rays, weather_keys) if config.iq else None
            given = (weather, weather_keys, cells, arrays.rays, arrays.detections)
            yield name, replace(_evaluate(data, config, velocity, *given), iq=iq)
        return
    hits = trace_radar(data.scene, data.views, velocity, config, keys, arrays)
    paths = trace_paths(data.scene, data.views, velocity, config, keys) if config.needs_paths else None
    echoes = _Echoes(config, hits, paths, arrays)
    order = None
    for name, weather in data.weathers.items():
        if config.mode == "carla":
            yield name, carla_points(hits)
            continue
        materials = data.scene.arrays.materials[name]
        rays = echoes.shade(materials, weather, merges=True)
        if needs_cells and order is None:
            order = bin_rays(config, rays, arrays.cells)  # the same in every weather
        weather_keys, iq = data.keys(name, config.name), None
        if config.iq:
            points = echoes.shade(materials, weather, merges=False) if echoes.has_mirrors else rays
            iq = radar_iq_samples(config, points, weather_keys)
        cells = None if order is None else sum_cells(order, rays, coherent=config.coherent)
        given = (weather, weather_keys, cells, rays, arrays.detections)
        yield name, replace(_evaluate(data, config, velocity, *given), iq=iq)


def _cells(data: SensorInput, config: Radar, arrays: RadarArrays, weather: str, *, is_first: bool) -> RadarCells:
    """Return the cells of placed rays in one weather: in the first one they are traced and sorted too.

    All is launched as one (`ReplayedLaunches`).
    """
    materials, air = data.scene.arrays.materials[weather], data.weathers[weather]
    order = cell_order(config, arrays.rays, arrays.cells)

    def launch() -> None:
        if is_first:
            launch_rays(data.scene, config, arrays)
        shade_radar(arrays.hits, materials, air, config, arrays)
        if is_first:
            sort_rays(order, arrays.rays)
        queue_sums(order, arrays.rays)

    if not arrays.shape[0]:
        return sum_cells(order, arrays.rays)
    surface = surfaces_on_device(materials, air, config.carrier_hz, arrays.device)
    objects = data.scene.struct if is_first else None, surface, radar_link(air, config)
    arrays.launches.run(launch, arrays.cells.room, *map(Same, objects))
    return sum_cells(order, arrays.rays, queued=arrays.cells.sums(CellSums))


def _evaluate(
    data: SensorInput,
    config: Radar,
    velocity: np.ndarray,
    weather: Weather,
    keys: np.ndarray,
    cells: RadarCells | None,
    rays: RadarRays,
    arrays: DetectionArrays,
) -> RadarPoints:
    device = data.scene.device
    if cells is None:
        return dense_points(rays, config)
    clutter = rain_clutter(config, weather, data.views.pose, velocity, keys, device)
    maps = tuple(radar_maps(config, kind, cells, clutter, keys, device) for kind in config.maps)
    is_dense = config.output == "dense"
    points = dense_points(rays, config) if is_dense else detect(config, cells, clutter, keys, device, arrays)
    return replace(points, maps=maps)
