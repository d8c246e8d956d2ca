"""Register the RGB camera."""

from collections.abc import Mapping

from mmw.config.sensor_spec import Estimate, Modality, SensorSpec
from mmw.sensors.camera_group.spec_parts import KERNELS, camera_estimate, camera_projection
from mmw.sensors.ground_truth.tables import BOXES_2D, SEGMENTATION
from mmw.sensors.rgb.config import RgbCamera, paper_cameras
from mmw.sensors.rgb.tables import FLOW, NORMALS, RGB

BYTES_PER_PIXEL = {"jpeg": 0.22, "png": 0.95}
"""Size of one pixel at the default quality [bytes]: 46.31 GB for 685,500 images of 640 x 480 of `full.yaml`; PNG takes
4.3 times as much (648 images of eight scenarios in four towns)."""

NORMALS_BYTES_PER_PIXEL, FLOW_BYTES_PER_PIXEL = 0.1, 0.6
"""Sizes of one pixel of normals and of flow [bytes]."""


def _estimate(config: RgbCamera) -> Estimate:
    size = BYTES_PER_PIXEL[config.format]
    size += config.normals * NORMALS_BYTES_PER_PIXEL + config.flow * FLOW_BYTES_PER_PIXEL
    return camera_estimate(config, size)


def _kernels(config: RgbCamera, on_gpu: bool) -> Mapping[str, float]:
    modules = {
        "shading.reflections": 10, "shading.shade": 7, "shading.shadows": 5, "shading.surface_samples": 4,
        "shading.denoise": 2, "camera.tone_mapping": 1, "shading.clouds": 1, "camera.image_samples": 1,
    }  # fmt: skip
    return {**KERNELS, **modules, **({"camera.jpeg": 2} if on_gpu and config.format == "jpeg" else {})}


def _rows(config: RgbCamera) -> dict[str, int]:
    flags = {name: int(getattr(config, name)) for name in ("segmentation", "normals", "flow")}
    return {"rgb": 1, **flags}


SPEC = SensorSpec(
    type="rgb",
    title="RGB",
    kind="image",
    config=RgbCamera,
    tables=(RGB, SEGMENTATION, NORMALS, FLOW, BOXES_2D),
    shared_tables=("box_visibility",),
    simulate="mmw.sensors.rgb.simulate:simulate",
    start="mmw.sensors.camera_group.capture:started_cameras",
    warp_output=True,
    rows_per_sample=_rows,
    estimate=_estimate,
    defaults=paper_cameras,
    kernels=_kernels,
    camera=camera_projection,
    needs_clear_view=True,
    needs_appearance=True,
    warm_up="mmw.sensors.render.sky.warm_up:bake_skies",
    decode="mmw.dataset.frame:camera_view",
    window=Modality("rgb", "rgb"),
    views={"plot": "mmw.viz.plots.samples:draw_rgb_sample", "viewer": "mmw.viz.rerun.samples:log_rgb"},
)
