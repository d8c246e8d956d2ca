"""Give radio maps as Arrow tables."""

from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from mmw.storage.table_spec import F64, I32, NAME, TableSpec, column, xyz

if TYPE_CHECKING:
    from mmw.channel.radio_map.radio_map import RadioMap

_NOTHING = "; null where nothing of it arrives"

RADIO_MAP = TableSpec(
    "radio_map",
    "one transmitter and cell",
    (
        column("transmitter", NAME, "-", "transmitter, an agent's name"),
        column("cell", I32, "id", "number of the cell; the same for every transmitter"),
        *xyz("x y z", F64, "m", "{} of the cell's middle, world frame"),
        column("area_m2", F64, "m^2", "area of the cell"),
        column(
            "path_gain_db", F64, "dB",
            "mean path gain to an ideal isotropic receiver, transmit antenna included" + _NOTHING, nullable=True,
        ),
        column("rss_dbm", F64, "dBm", "mean received signal strength" + _NOTHING, nullable=True),
        column(
            "sinr_db", F64, "dB",
            "signal of this transmitter over thermal noise and all other transmitters" + _NOTHING, nullable=True,
        ),
    ),
    ("transmitter", "cell"),
    framed=False,
)  # fmt: skip
"""Table of a radio map."""


def radio_map_table(result: "RadioMap") -> pa.Table:
    """Return a map as the table `RADIO_MAP`, transmitter by transmitter and cell by cell."""
    count, cells = result.path_gain.shape
    names = pa.DictionaryArray.from_arrays(np.repeat(np.arange(count, dtype=np.int32), cells), result.tx_names)
    columns: list[Any] = [names, np.tile(np.arange(cells, dtype=np.int32), count)]
    columns += [np.tile(values, count) for values in (*result.cell_centers.T, result.cell_areas)]
    for values in (result.path_gain_db, result.rss_dbm, result.sinr_db):
        columns.append(pa.array(values.ravel(), mask=~np.isfinite(values.ravel())))
    return pa.Table.from_arrays([pa.array(values) for values in columns], schema=pa.schema(RADIO_MAP.columns))
