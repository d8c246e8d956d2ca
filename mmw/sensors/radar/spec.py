"""Register the radar."""

import math
from collections.abc import Mapping

from mmw.config.sensor_spec import Estimate, Modality, SensorSpec
from mmw.sensors.radar.config import Radar
from mmw.sensors.radar.tables import RADAR, RADAR_IQ, RADAR_MAPS

BYTES_PER_RAY = {"carla": 8.8, "dense": 24.0}
"""Size of one ray where rays are stored, misses included, measured on town03 [bytes]."""

ECHOES_PER_RAY = {"none": 1.0, "ground": 1.4, "full": 1.6}
"""Stored echoes over those without multipath, by `Radar.multipath`, in dense samples of town03."""

DETECTIONS_BYTES = 3_000.0
"""Size of the detections of one sample, measured on eight scenarios [bytes]."""

MAP_PIXEL_BYTES, IQ_SAMPLE_BYTES = 4.0, 8.0
"""Sizes of a pixel of a radar map, float32, and of a sample, complex64 [bytes]; noise does not compress."""


def _estimate(config: Radar) -> Estimate:
    stored = "carla" if config.mode == "carla" else config.output
    size = DETECTIONS_BYTES
    if stored in BYTES_PER_RAY:
        size = config.ray_count * BYTES_PER_RAY[stored] * ECHOES_PER_RAY[config.multipath]
    columns = {"range_azimuth": config.azimuth_antennas, "range_doppler": config.chirps}
    size += sum(columns[kind] for kind in config.maps) * (config.range_cells + 1) * MAP_PIXEL_BYTES
    if config.iq:
        size += math.prod(config.iq_shape) * IQ_SAMPLE_BYTES
    return Estimate(config.ray_count, size)


def _kernels(config: Radar, on_gpu: bool) -> Mapping[str, float]:
    modules = {"radar.trace": 3}
    if config.mode == "physical" and config.output == "detections":
        modules |= {"radar.resolution_cells": 1, "radar.thresholds": 2, "radar.estimates": 1}
        if config.maps:
            modules["radar.detection"] = 1
        if config.needs_paths:
            modules["radar.path_sums"] = 1
    if config.needs_paths:
        modules["radar.bounce_paths"] = 4
    if config.multipath != "none":
        modules["radar.echo_paths"] = 3
    return modules


SPEC = SensorSpec(
    type="radar",
    title="Radar",
    kind="points",
    config=Radar,
    tables=(RADAR, RADAR_MAPS, RADAR_IQ),
    shared_tables=("box_visibility",),
    simulate="mmw.sensors.radar.simulate:simulate",
    capture="mmw.sensors.radar.capture:capture_radar",
    rows_per_sample=lambda config: {"radar": 1, "radar_maps": len(config.maps), "radar_iq": int(config.iq)},
    estimate=_estimate,
    defaults=lambda: (Radar(),),
    kernels=_kernels,
    needs_clear_view=True,
    window=Modality("radar", "points", ("range", "azimuth", "elevation", "velocity")),
    views={
        "plot": "mmw.viz.plots.samples:draw_radar_sample",
        "figure": "mmw.viz.plots.weather_comparison:plot_radar",
        "viewer": "mmw.viz.rerun.samples:log_radar",
    },
)
