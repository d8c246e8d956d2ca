"""Define the tables of radars."""

import pyarrow as pa

from mmw.storage.table_spec import F32, F64, I32, OWNED, SENSOR, TableSpec, column, list_of, sensor_table

RADAR = sensor_table(
    "radar",
    "One radar sample: its points, detections or rays as the sensor is configured; rays that hit nothing are left out.",
    column("point_count", I32, "count", "points of the sample, the length of the lists"),
    column("range", list_of(F32), "m", "distance of each point from the sensor"),
    column(
        "azimuth", list_of(F32), "rad", "angle in the sensor's x-y plane, positive to the left; CARLA's is minus it"
    ),
    column("elevation", list_of(F32), "rad", "angle above the sensor's x-y plane, CARLA's altitude"),
    column("velocity", list_of(F32), "m/s", "radial velocity relative to the sensor, positive while receding"),
    column(
        "power_db", list_of(F32), "dBm", "received power, losses of the weather included; null in carla", nullable=True
    ),
    column("snr_db", list_of(F32), "dB", "power over the noise of a cell; null in carla", nullable=True),
    column("rcs_dbsm", list_of(F32), "dBsm", "radar cross section; null in carla", nullable=True),
    column(
        "object_id", list_of(I32), "id", "object that each point lies on, a row of `objects`; -1 for clutter and noise"
    ),
    column("label", list_of(pa.uint8()), "index", "what returned: 0 object, 1 rain clutter, 2 false alarm"),
    column(
        "path_type",
        list_of(pa.uint8()),
        "index",
        "path of the echo: 0 direct, 1 over the ground, ghosts: 2 at the angle of the object (type 1), 3 and 4 at that "
        "of the mirror (type 2, second and third order); null without multipath",
        nullable=True,
    ),
    frames_per_group=4,
    level=1,
)

RADAR_MAPS = TableSpec(
    "radar_maps",
    "One power map of a radar: the strongest resolution cell of each pixel.",
    (
        *OWNED,
        SENSOR,
        column("kind", pa.string(), "", "range_azimuth or range_doppler"),
        column("rows", I32, "count", "rows of the map; a row is a range cell"),
        column("columns", I32, "count", "columns of the map, from right to left or from approaching to receding"),
        column("row_first", F64, "m", "range of row 0"),
        column("row_step", F64, "m", "range from row to row, c / 2B"),
        column(
            "column_first",
            F64,
            "- or m/s",
            "column 0: sin(azimuth) cos(elevation), or velocity, positive while receding",
        ),
        column("column_step", F64, "- or m/s", "from column to column, 2 / antennas or wavelength / 2T"),
        column("values", list_of(F32), "dBm", "received power with noise, row by row"),
    ),
    ("frame", "agent", "sensor", "kind"),
    frames_per_group=1,
    level=1,
)

RADAR_IQ = sensor_table(
    "radar_iq",
    "One sweep as the receivers digitize it; sample n of chirp m of antenna l is number (l chirps + m) samples + n.",
    column("antennas", I32, "count", "virtual antennas, rows from below, in a row from right to left"),
    column("chirps", I32, "count", "chirps of the sweep"),
    column("samples", I32, "count", "samples of a chirp"),
    column("i", list_of(F32), "W^0.5", "in-phase part of each sample, noise included"),
    column("q", list_of(F32), "W^0.5", "quadrature part of each sample, noise included"),
    frames_per_group=1,
    level=1,
)
