"""The table of radar samples."""

import pyarrow as pa

from mmw.storage.table_spec import F32, I32, OWNED, SENSOR, TableSpec, column, list_of

RADAR = TableSpec(
    "radar",
    "One radar sample: its points, detections or rays as the sensor is configured; what meets nothing is left out.",
    (
        *OWNED,
        SENSOR,
        column("point_count", I32, "count", "points of the sample, the length of the lists"),
        column("range", list_of(F32), "m", "distance of each point from the sensor"),
        column(
            "azimuth", list_of(F32), "rad", "angle in the sensor's x-y plane, positive to the left; CARLA's is minus it"
        ),
        column("elevation", list_of(F32), "rad", "angle above the sensor's x-y plane, CARLA's altitude"),
        column("velocity", list_of(F32), "m/s", "radial velocity relative to the sensor, positive while receding"),
        column(
            "power_db",
            list_of(F32),
            "dBm",
            "received power, losses of the weather included; null in compat",
            nullable=True,
        ),
        column("snr_db", list_of(F32), "dB", "power over the noise of a cell; null in compat", nullable=True),
        column("rcs_dbsm", list_of(F32), "dBsm", "radar cross section; null in compat", nullable=True),
        column(
            "object_id",
            list_of(I32),
            "id",
            "object that each point lies on, a row of `objects`; -1 for clutter and noise",
        ),
        column("label", list_of(pa.uint8()), "index", "what returned: 0 object, 1 rain clutter, 2 false alarm"),
    ),
    ("frame", "agent", "sensor"),
    frames_per_group=4,
    level=1,
)
