"""Define the table of depth cameras."""

from mmw.storage.table_spec import F32, column, encoded_image, list_of, sensor_table

DEPTH = sensor_table(
    "depth",
    "One depth image.",
    encoded_image("image", "cm", "16-bit PNG of depth along the optical axis; meters = value * 0.01; 0 = no return"),
    column(
        "depth_m",
        list_of(F32),
        "m",
        "depth before rounding, row after row from the top left pixel; 0 = no return; null unless the sensor has "
        "`format: float32`, and only there beyond 655.35 m, where the image is 0",
        nullable=True,
    ),
    frames_per_group=4,
    level=1,
)
