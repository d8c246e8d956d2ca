"""The table of LiDAR sweeps."""

import pyarrow as pa

from mmw.tables.schema.columns import F32, I32, OWNED, SENSOR, TableSpec, column, list_of, xyz

LIDAR = TableSpec(
    "lidar",
    "One LiDAR sweep: the returns of one whole turn; rays without a return are left out.",
    (
        *OWNED,
        SENSOR,
        column("point_count", I32, "count", "returns in the sweep, the length of the lists"),
        *xyz("x y z", list_of(F32), "m", "{} of each return, sensor frame, on a grid of 1/1024 m"),
        column("intensity", list_of(F32), "-", "returned intensity, 0 to 1, on a grid of 1/256"),
        column("ring", list_of(pa.uint8()), "index", "laser channel of each return, 0 the highest"),
        column("object_id", list_of(I32), "id", "object that each return lies on, a row of `objects`"),
    ),
    ("frame", "agent", "sensor"),
    frames_per_group=1,
    level=1,
)
