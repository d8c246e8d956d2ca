"""Tables of the inertial and satellite sensors."""

from mmw.tables.schema.columns import F32, F64, OWNED, SENSOR, TableSpec, xyz

IMU = TableSpec(
    "imu",
    "One sample of an inertial measurement unit, in the sensor's frame.",
    (
        *OWNED,
        SENSOR,
        *xyz("ax ay az", F32, "m/s^2", "measured specific force along the sensor's {}; +9.81 on z at rest"),
        *xyz("gx gy gz", F32, "rad/s", "measured angular rate about the sensor's {}"),
        *xyz("ax_true ay_true az_true", F64, "m/s^2", "noise-free specific force along the sensor's {}"),
        *xyz("gx_true gy_true gz_true", F64, "rad/s", "noise-free angular rate about the sensor's {}"),
    ),
    ("frame", "agent", "sensor"),
)
