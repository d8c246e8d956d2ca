"""Define the table of inertial measurement units."""

from mmw.storage.table_spec import F32, F64, NAME, column, sensor_table, xyz

IMU = sensor_table(
    "imu",
    "One sample of an inertial measurement unit, in the sensor's axes.",
    column("handedness", NAME, "", "axes of the row: right (x forward, y left, z up) or left (y right, as CARLA)"),
    *xyz("ax ay az", F32, "m/s^2", "measured specific force along the sensor's {}; +9.81 on z at rest"),
    *xyz("gx gy gz", F32, "rad/s", "measured angular rate about the sensor's {}"),
    *xyz("ax_true ay_true az_true", F64, "m/s^2", "specific force along the sensor's {} without errors"),
    *xyz("gx_true gy_true gz_true", F64, "rad/s", "angular rate about the sensor's {} without errors"),
    *xyz("ax_bias ay_bias az_bias", F32, "m/s^2", "bias in the measured specific force along the sensor's {}"),
    *xyz("gx_bias gy_bias gz_bias", F32, "rad/s", "bias in the measured angular rate about the sensor's {}"),
    column("compass", F64, "rad", "true heading of the sensor's x axis, clockwise from north, 0 to 2 pi"),
)
