"""Define the table of LiDAR sweeps."""

import pyarrow as pa

from mmw.storage.table_spec import F32, I32, column, list_of, sensor_table, xyz

LIDAR = sensor_table(
    "lidar",
    "One LiDAR sweep: the returns of one whole turn, channel by channel; rays without a return are left out.",
    column("point_count", I32, "count", "returns in the sweep, the length of the lists"),
    *xyz("x y z", list_of(F32), "m", "{} of each return, sensor frame, on a grid of 1/1024 m"),
    column("intensity", list_of(F32), "-", "returned power x range^2, 0 to 1, on a grid of 1/256"),
    column("ring", list_of(pa.uint8()), "index", "laser channel of each return, 0 the highest"),
    column("object_id", list_of(I32), "id", "object of each return, a row of `objects`; -1 for rain and fog"),
    column("label", list_of(pa.uint8()), "index", "what returned: 0 surface, 1 rain, 2 fog"),
    column("time_offset", list_of(F32), "s", "firing of each return after the frame's instant, -0.01 to 0"),
    column("return_number", list_of(pa.uint8()), "index", "0 the strongest or only return of a ray, 1 its last"),
    *(
        column(
            f"flow_{axis}", list_of(F32), "m",
            f"{axis} of each return's way to the next frame, sensor frame; null unless asked for", nullable=True,
        )
        for axis in "xyz"
    ),
    frames_per_group=1,
    level=1,
)  # fmt: skip
