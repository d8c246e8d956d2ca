"""Register the LiDAR."""

from mmw.config.sensor_spec import Estimate, Modality, SensorSpec
from mmw.sensors.lidar.config import Lidar, sweep_duration
from mmw.sensors.lidar.tables import LIDAR

BYTES_PER_RAY = 4.65
"""Size of one ray in the tables, misses included [bytes]: 29.16 GB for 209,400 sweeps of 30,016 rays of `full.yaml`;
dual returns take up to 1.6 times as much."""


def _estimate(config: Lidar) -> Estimate:
    rays = config.channels * config.points_per_channel
    return Estimate(rays, rays * BYTES_PER_RAY)


SPEC = SensorSpec(
    type="lidar",
    title="LiDAR",
    kind="points",
    config=Lidar,
    tables=(LIDAR,),
    shared_tables=("box_visibility",),
    simulate="mmw.sensors.lidar.simulate:simulate",
    capture="mmw.sensors.lidar.capture:capture_lidar",
    warp_output=True,
    estimate=_estimate,
    defaults=lambda: (Lidar(),),
    kernels=lambda config, on_gpu: {"lidar.trace": 4, "lidar.returns": 2},
    sweep_s=lambda config: sweep_duration(config) if config.rolling else 0.0,
    needs_clear_view=True,
    window=Modality("lidar", "points", ("x", "y", "z", "intensity")),
    views={
        "plot": "mmw.viz.plots.samples:draw_lidar_sample",
        "figure": "mmw.viz.plots.weather_comparison:plot_lidar",
        "viewer": "mmw.viz.rerun.samples:log_lidar",
    },
)
