"""Capture radar samples of a batch: traced once, evaluated in every weather."""

from collections.abc import Sequence

from mmw.sensors.batch import Batch, TableRows
from mmw.sensors.ground_truth.visibility_rows import point_rows
from mmw.sensors.radar.config import Radar
from mmw.sensors.radar.rows import radar_iq_rows, radar_map_rows, radar_rows
from mmw.sensors.radar.simulate import scans


def capture_radar(batch: Batch, sensors: Sequence[Radar], frames: Sequence[int], collected: TableRows) -> None:
    """Add the samples of radars, and how many of their points lie on each actor."""
    arrays = batch.arrays
    for sensor in sensors:
        views = batch.views(frames, sensor)
        with batch.clock.stage(sensor.name, len(views) * sensor.ray_count):
            for weather, points in scans(batch.sensor_input(views, collected), sensor):
                tables = collected[weather]
                if points.iq is not None:
                    tables["radar_iq"].append(radar_iq_rows(arrays, sensor.name, views, points.iq))
                for maps in points.maps:
                    tables["radar_maps"].append(radar_map_rows(arrays, sensor.name, views, maps))
                tables["radar"].append(radar_rows(arrays, sensor.name, views, points))
                on_actors = (arrays, sensor.name, views, "radar_points", points.offsets, points.direct_object_id)
                tables["box_visibility"].append(batch.submit(point_rows, *on_actors))
