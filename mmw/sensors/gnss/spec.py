"""Register the GNSS receiver."""

from collections.abc import Mapping

from mmw.config.sensor_spec import Estimate, Modality, SensorSpec
from mmw.sensors.gnss.config import Gnss
from mmw.sensors.gnss.tables import GNSS, GNSS_SATELLITES

SAMPLE_BYTES = 48.0
"""Size of one sample, measured on town03 [bytes]."""

SATELLITES_BYTES = 160.0
"""Size of the satellites of one sample, measured on town03 [bytes]."""


def _estimate(config: Gnss) -> Estimate:
    if config.mode != "ray_traced":
        return Estimate(bytes=SAMPLE_BYTES)
    return Estimate(config.samples_per_tx, SAMPLE_BYTES + SATELLITES_BYTES)


def _kernels(config: Gnss, on_gpu: bool) -> Mapping[str, float]:
    modules = {"navigation.gnss": 2}
    if config.mode != "carla":
        modules["core.random_series"] = 2
    if config.mode == "ray_traced":
        modules |= {"channel.image_method": 7, "channel.reflection_candidates": 2}
    return modules


SPEC = SensorSpec(
    type="gnss",
    title="GNSS",
    kind="scalar",
    config=Gnss,
    tables=(GNSS, GNSS_SATELLITES),
    simulate="mmw.sensors.gnss.simulate:simulate",
    to_tables="mmw.sensors.gnss.rows:to_tables",
    rows_per_sample=lambda config: {"gnss": int(config.mode != "ray_traced")},
    variable_rows=lambda config: ("gnss", "gnss_satellites") if config.mode == "ray_traced" else (),
    estimate=_estimate,
    defaults=lambda: (Gnss(),),
    kernels=_kernels,
    window=Modality(
        "gnss", "numbers", ("latitude_deg", "longitude_deg", "altitude_m", "v_east", "v_north", "v_up"), "float64"
    ),  # a step of float32 is 0.4 m of latitude
)
