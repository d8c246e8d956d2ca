"""Define the table of GNSS receivers."""

from mmw.storage.table_spec import F32, F64, column, sensor_table

GNSS = sensor_table(
    "gnss",
    "One sample of a satellite navigation receiver; the sensor's `params` give the reference point and the map.",
    column("latitude_deg", F64, "deg", "measured latitude, north positive"),
    column("longitude_deg", F64, "deg", "measured longitude, east positive"),
    column("altitude_m", F64, "m", "measured height: above the ellipsoid (physical), reference plus z (carla)"),
    column("latitude_true_deg", F64, "deg", "latitude of the sensor without errors"),
    column("longitude_true_deg", F64, "deg", "longitude of the sensor without errors"),
    column("altitude_true_m", F64, "m", "height of the sensor without errors"),
    column("v_east", F32, "m/s", "measured velocity along the world's x"),
    column("v_north", F32, "m/s", "measured velocity along the world's y"),
    column("v_up", F32, "m/s", "measured velocity along the world's z"),
    column("speed", F32, "m/s", "measured horizontal speed; noise of mode carla can make it negative near rest"),
    column("heading", F32, "rad", "measured heading of the sensor's x axis, clockwise from north, 0 to 2 pi"),
)
