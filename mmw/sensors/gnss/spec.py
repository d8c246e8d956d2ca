"""Register the GNSS receiver."""

from mmw.config.sensor_spec import Estimate, Modality, SensorSpec
from mmw.sensors.gnss.config import Gnss
from mmw.sensors.gnss.tables import GNSS

SAMPLE_BYTES = 48.0
"""Size of one sample, measured on town03 [bytes]."""

SPEC = SensorSpec(
    type="gnss",
    title="GNSS",
    kind="scalar",
    config=Gnss,
    tables=(GNSS,),
    simulate="mmw.sensors.gnss.simulate:simulate",
    to_tables="mmw.sensors.gnss.rows:to_tables",
    estimate=lambda config: Estimate(bytes=SAMPLE_BYTES),
    defaults=lambda: (Gnss(),),
    window=Modality(
        "gnss", "numbers", ("latitude_deg", "longitude_deg", "altitude_m", "v_east", "v_north", "v_up"), "float64"
    ),  # a step of float32 is 0.4 m of latitude
)
