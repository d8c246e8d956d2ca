"""Define the tables of GNSS receivers."""

import pyarrow as pa

from mmw.storage.table_spec import F32, F64, OWNED, SENSOR, TableSpec, column, sensor_table

GNSS = sensor_table(
    "gnss",
    "One sample of a satellite navigation receiver; the sensor's `params` give the reference point and the map. Mode "
    "ray_traced has no row where there is no fix.",
    column("latitude_deg", F64, "deg", "measured latitude, north positive"),
    column("longitude_deg", F64, "deg", "measured longitude, east positive"),
    column("altitude_m", F64, "m", "measured height: above the ellipsoid, reference plus z in mode carla"),
    column("latitude_true_deg", F64, "deg", "latitude of the sensor without errors"),
    column("longitude_true_deg", F64, "deg", "longitude of the sensor without errors"),
    column("altitude_true_m", F64, "m", "height of the sensor without errors"),
    column("v_east", F32, "m/s", "measured velocity along the world's x"),
    column("v_north", F32, "m/s", "measured velocity along the world's y"),
    column("v_up", F32, "m/s", "measured velocity along the world's z"),
    column("speed", F32, "m/s", "measured horizontal speed; noise of mode carla can make it negative near rest"),
    column("heading", F32, "rad", "measured heading of the sensor's x axis, clockwise from north, 0 to 2 pi"),
)

GNSS_SATELLITES = TableSpec(
    "gnss_satellites",
    "One satellite above the mask in one sample of a receiver of mode ray_traced.",
    (
        *OWNED,
        SENSOR,
        column("satellite", pa.string(), "", "slot of the nominal constellation, such as A1"),
        column("azimuth", F32, "rad", "clockwise from north, 0 to 2 pi"),
        column("elevation", F32, "rad", "above the world's horizontal plane"),
        column("cn0_db_hz", F32, "dB Hz", "carrier to noise density; null if nothing arrives", nullable=True),
        column("pseudorange", F64, "m", "measured distance, clocks without offset; null if not tracked", nullable=True),
        column("pseudorange_error", F32, "m", "what it is too long by; null if not tracked", nullable=True),
        column("multipath_error", F32, "m", "part of it by reflections and edges; null if not tracked", nullable=True),
        column("is_los", pa.bool_(), "", "true if the satellite is in sight, through foliage too"),
        column("is_tracked", pa.bool_(), "", "true if the receiver tracks it"),
    ),
    ("frame", "agent", "sensor", "satellite"),
)
