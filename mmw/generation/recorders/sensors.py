"""Trace the sensors of a batch of frames."""

from collections.abc import Sequence

import numpy as np

from mmw.config import SensorConfig
from mmw.config.sensor_spec import SENSORS, SensorSpec
from mmw.core.registry import load_reference
from mmw.scene.table_rows import names
from mmw.scene.views import make_views
from mmw.sensors.batch import Batch, TableRows
from mmw.sensors.sensor_input import SensorInput


def record_sensors(job: Batch, frames: Sequence[int], collected: TableRows) -> None:
    """Trace every sensor in a batch of frames and add its rows.

    Sensors whose kinds name the same `capture` are traced in one call.
    """
    together: dict[str, list[SensorConfig]] = {}
    for sensor in job.config.sensors:
        spec = SENSORS[sensor.type]
        if spec.capture:
            together.setdefault(spec.capture, []).append(sensor)
        else:
            _simulate(job, spec, sensor, frames, collected)
    for capture, sensors in together.items():
        load_reference(capture)(job, sensors, frames, collected)


def _simulate(job: Batch, spec: SensorSpec, sensor: SensorConfig, frames: Sequence[int], collected: TableRows) -> None:
    """Add the rows of a sensor that is simulated by itself."""
    views = make_views(job.arrays, frames, sensor)
    views = views.take(views.frame % sensor.period_frames == 0)
    rays = round(len(views) * spec.estimate(sensor).rays)
    with job.clock.stage(sensor.name, rays):
        weathers = {name: job.weather(name) for name in collected}
        data = SensorInput(job.scene, job.motion, views, weathers, job.config.seed, job.scenario.name)
        samples = load_reference(spec.simulate)(data, sensor)
        to_tables = load_reference(spec.to_tables)
        key = {
            "frame": views.frame.astype(np.int32),
            "agent": names(job.arrays, views.actor),
            "sensor": sensor.name,
        }
        for weather, tables in collected.items():
            for name, columns in to_tables(data, sensor, samples[weather]).items():
                tables[name].append({**key, **columns})
