"""Capture GNSS samples of a batch."""

from collections.abc import Sequence

import numpy as np

from mmw.scene.scene_data import SceneData
from mmw.scene.table_rows import Columns, sample_columns, split
from mmw.sensors.batch import Batch, TableRows, collect
from mmw.sensors.gnss.config import Gnss
from mmw.sensors.gnss.simulate import GnssBatch, make_gnss


def capture_gnss(batch: Batch, sensors: Sequence[Gnss], frames: Sequence[int], collected: TableRows) -> None:
    """Add the samples of GNSS receivers."""
    for sensor in sensors:
        with batch.clock.stage(sensor.name):
            samples = make_gnss(batch.arrays, frames, sensor, batch.config.seed, batch.scenario.name)
            collect(collected, {"gnss": gnss_rows(batch.arrays, sensor.name, samples)})


def gnss_rows(arrays: SceneData, sensor: str, gnss: GnssBatch) -> Columns:
    """Return rows of the `gnss` table for one sensor."""
    return {
        **sample_columns(arrays, sensor, gnss.frame, gnss.actor),
        **split(("latitude_deg", "longitude_deg", "altitude_m"), gnss.geodetic),
        **split(("latitude_true_deg", "longitude_true_deg", "altitude_true_m"), gnss.geodetic_true),
        **split(("v_east", "v_north", "v_up"), gnss.velocity.astype(np.float32)),
        "speed": gnss.speed.astype(np.float32),
        "heading": gnss.heading.astype(np.float32),
    }
