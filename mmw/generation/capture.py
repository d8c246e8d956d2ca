"""Capture one batch of frames: ground truth, every sensor and the radio channel, in all weathers."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager

import numpy as np

from mmw.channel.links import Links, make_links
from mmw.channel.path_solver.solver import launched_rays, solve_paths
from mmw.channel.path_solver.surface_table import SurfaceTable
from mmw.channel.paths import PathSet
from mmw.channel.rows import link_rows, path_gain_rows, path_geometry_rows
from mmw.config import SensorConfig
from mmw.config.sensor_spec import SENSORS, SensorSpec
from mmw.core.registry import load_reference
from mmw.generation.plugin_faults import checked_columns, plugin_faults
from mmw.scene.rows import frame_rows, pose_rows
from mmw.scene.table_rows import actor_names, names
from mmw.sensors.batch import Batch, TableRows, collect
from mmw.sensors.ground_truth.boxes_3d import box_rows, make_boxes
from mmw.sensors.ground_truth.visibility import start_sight
from mmw.sensors.ground_truth.visibility_rows import sight_rows


def capture_frames(
    batch: Batch, frames: Sequence[int], collected: TableRows, sensors: Sequence[SensorConfig] | None = None
) -> None:
    """Trace one batch of frames and add its rows in every weather of `collected`.

    Args:
        batch: The scenario.
        frames: The frames.
        collected: Where the rows go.
        sensors: In place of those of the configuration: the same ones, on fewer agents.
    """
    with batch.clock.stage("batch set-up"):
        batch.scene.load_batch(frames)
    capture_ground_truth(batch, frames, collected)
    capture_sensors(batch, frames, collected, sensors)
    if batch.surfaces is not None:
        capture_channel(batch, batch.surfaces, channel_links(batch, frames), collected)


def capture_ground_truth(batch: Batch, frames: Sequence[int], collected: TableRows) -> None:
    """Add frames, poses, boxes and, if there is a channel, lines of sight between antennas and actors."""
    with started_sight(batch, frames, collected):
        capture_poses(batch, frames, collected)
        capture_boxes(batch, frames, collected)


def capture_poses(batch: Batch, frames: Sequence[int], collected: TableRows) -> None:
    """Add frames and poses of agents."""
    with batch.clock.stage("ground truth"):
        rows = batch.submit(frame_rows, batch.arrays, frames, batch.config.seed)
        collect(collected, {"frames": rows, "poses": pose_rows(batch.arrays, frames, batch.motion)})


def capture_boxes(batch: Batch, frames: Sequence[int], collected: TableRows) -> None:
    """Add boxes of vehicles and people."""
    with batch.clock.stage("ground truth"):
        collect(collected, {"boxes": box_rows(batch.arrays, make_boxes(batch.arrays, frames, batch.motion))})


@contextmanager
def started_sight(batch: Batch, frames: Sequence[int], collected: TableRows) -> Iterator[None]:
    """Trace lines of sight of antennas, if there is a channel, and add their rows at the end of a `with` statement.

    The host waits for the device at the end alone.
    """
    channel, traced = batch.config.channel, []
    if channel.enabled:
        with batch.clock.stage("ground truth"):
            due = channel.is_due(batch.arrays.numbers(frames), batch.arrays.rate_hz)
            for antenna in channel.antennas:
                traced.append((antenna.name, start_sight(batch.scene.optical, frames, antenna, due)))
    yield
    with batch.clock.stage("ground truth"):
        for name, wait in traced:
            collect(collected, {"box_visibility": batch.submit(sight_rows, batch.arrays, name, wait())})


def capture_sensors(
    batch: Batch, frames: Sequence[int], collected: TableRows, sensors: Sequence[SensorConfig] | None = None
) -> None:
    """Add the rows of every sensor, see `started_sensors`."""
    with started_sensors(batch, frames, collected, sensors):
        pass


@contextmanager
def started_sensors(
    batch: Batch, frames: Sequence[int], collected: TableRows, sensors: Sequence[SensorConfig] | None = None
) -> Iterator[None]:
    """Add the rows of every sensor at the end of a `with` statement.

    Those whose specs have a `start` begin at its beginning and are waited for last: on a GPU the host traces everything
    else meanwhile. Kinds of sensors that name the same function are traced in one call.
    """
    started, captured, alone = _by_function(batch.config.sensors if sensors is None else sensors)
    with ExitStack() as stack:
        for start, group in started.items():
            stack.enter_context(load_reference(start)(batch, group, frames, collected))
        yield
        for sensor in alone:
            _simulate(batch, SENSORS[sensor.type], sensor, frames, collected)
        for capture, group in captured.items():
            load_reference(capture)(batch, group, frames, collected)


Groups = dict[str, list[SensorConfig]]
"""Function that captures sensors -> the sensors."""


def _by_function(sensors: Iterable[SensorConfig]) -> tuple[Groups, Groups, list[SensorConfig]]:
    """Return the sensors that are started, those that are captured in groups, and those that are simulated alone."""
    started: Groups = {}
    captured: Groups = {}
    alone = []
    for sensor in sensors:
        spec = SENSORS[sensor.type]
        if spec.start:
            started.setdefault(spec.start, []).append(sensor)
        elif spec.capture:
            captured.setdefault(spec.capture, []).append(sensor)
        else:
            alone.append(sensor)
    return started, captured, alone


def _simulate(
    batch: Batch, spec: SensorSpec, sensor: SensorConfig, frames: Sequence[int], collected: TableRows
) -> None:
    """Add the rows of a sensor that is simulated by itself."""
    views = batch.views(frames, sensor)
    with batch.clock.stage(sensor.name, round(len(views) * spec.estimate(sensor).rays)):
        data = batch.sensor_input(views, collected)
        with plugin_faults(sensor):
            samples = load_reference(spec.simulate)(data, sensor)
            by_weather = {name: load_reference(spec.to_tables)(data, sensor, samples[name]) for name in collected}
        key = {
            "frame": views.frame.astype(np.int32),
            "agent": names(batch.arrays, views.actor),
            "sensor": sensor.name,
        }
        for weather, tables in collected.items():
            for name, columns in by_weather[weather].items():
                tables[name].append(checked_columns(sensor, name, {**key, **columns}))


def channel_links(batch: Batch, frames: Sequence[int]) -> Links:
    """Return the links of those of some frames that the channel samples."""
    config = batch.config.channel
    with batch.clock.stage("channel"):
        links = make_links(batch.arrays, frames, config, batch.motion)
        if config.takes_all(batch.arrays.rate_hz):
            return links
        is_due = config.is_due(batch.arrays.numbers(frames), batch.arrays.rate_hz)
        return links.take(np.flatnonzero(is_due[links.batch_index]))


def capture_channel(batch: Batch, surfaces: SurfaceTable, links: Links, collected: TableRows) -> None:
    """Add links and their paths: traced once, their field evaluated in every weather."""
    channel_rows(batch, links, trace_channel(batch, surfaces, links, collected), collected)
    batch.clock.rays["channel"] += launched_rays(links, batch.config.channel)


def trace_channel(batch: Batch, surfaces: SurfaceTable, links: Links, weathers: Iterable[str]) -> PathSet:
    """Return the paths of links, with their field in some weathers."""
    config = batch.config.channel
    with batch.clock.stage("channel"):
        materials = {weather: batch.arrays.materials[weather] for weather in weathers}
        air = {weather: batch.weather(weather) for weather in materials}
        return solve_paths(batch.scene, links, config, materials, surfaces, air, motion=batch.motion)


def channel_rows(batch: Batch, links: Links, paths: PathSet, collected: TableRows) -> None:
    """Add rows of links and their paths, which threads make.

    The geometry of paths is the same in every weather: only the first of `collected` has it.
    """
    config, agents = batch.config.channel, actor_names(batch.arrays.actors)
    antennas = config.antenna_names
    for weather, tables in collected.items():
        kinds = config.link_names
        tables["links"].append(batch.submit(link_rows, agents, antennas, kinds, links, paths, weather))
        tables["path_gains"].append(batch.submit(path_gain_rows, agents, antennas, links, paths, weather))
    for tables in list(collected.values())[:1]:
        tables["path_geometry"].append(batch.submit(path_geometry_rows, agents, antennas, links, paths))
