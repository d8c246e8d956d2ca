"""The tables of radar maps and of radar samples."""

import pyarrow as pa

from mmw.storage.table_spec import F32, F64, I32, OWNED, SENSOR, TableSpec, column, list_of

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

RADAR_IQ = TableSpec(
    "radar_iq",
    "One sweep as the receivers digitise it; sample n of chirp m of antenna l is number (l chirps + m) samples + n.",
    (
        *OWNED,
        SENSOR,
        column("antennas", I32, "count", "virtual antennas, rows from below, in a row from right to left"),
        column("chirps", I32, "count", "chirps of the sweep"),
        column("samples", I32, "count", "samples of a chirp"),
        column("i", list_of(F32), "W^0.5", "in-phase part of each sample, noise included"),
        column("q", list_of(F32), "W^0.5", "quadrature part of each sample, noise included"),
    ),
    ("frame", "agent", "sensor"),
    frames_per_group=1,
    level=1,
)
