"""Register the depth camera."""

from mmw.config.sensor_spec import Estimate, Modality, SensorSpec
from mmw.sensors.camera_group.spec_parts import KERNELS, camera_estimate, camera_projection
from mmw.sensors.depth.config import DepthCamera
from mmw.sensors.depth.tables import DEPTH
from mmw.sensors.ground_truth.tables import BOXES_2D, SEGMENTATION

BYTES_PER_PIXEL = 0.1
"""Size of one depth pixel as 16-bit PNG [bytes]: 28 to 32 kB for an image of 640 x 480 on town03."""

FLOAT_BYTES_PER_PIXEL = 0.9
"""Size of one depth pixel before rounding, `format: float32` [bytes]: 275 kB for an image of 640 x 480 on town03."""


def _estimate(config: DepthCamera) -> Estimate:
    size = BYTES_PER_PIXEL + (config.format == "float32") * FLOAT_BYTES_PER_PIXEL
    return camera_estimate(config, size)


SPEC = SensorSpec(
    type="depth",
    title="Depth",
    kind="image",
    config=DepthCamera,
    tables=(DEPTH, SEGMENTATION, BOXES_2D),
    shared_tables=("box_visibility",),
    simulate="mmw.sensors.depth.simulate:simulate",
    start="mmw.sensors.camera_group.capture:started_cameras",
    warp_output=True,
    rows_per_sample=lambda config: {"depth": 1, "segmentation": int(config.segmentation)},
    estimate=_estimate,
    defaults=lambda: (DepthCamera(),),
    kernels=lambda config, on_gpu: KERNELS,
    camera=camera_projection,
    needs_clear_view=True,
    decode="mmw.dataset.frame:camera_view",
    window=Modality("depth", "depth"),
    views={
        "plot": "mmw.viz.plots.samples:draw_depth_sample",
        "figure": "mmw.viz.plots.weather_comparison:plot_depth",
        "viewer": "mmw.viz.rerun.samples:log_depth",
    },
)
