"""Every table of a dataset; `mmw.storage` holds the name, type, unit and meaning of each column.

A table is either *framed* (one file a shard, `TABLE/scenario=S/weather=W/part-FFFFFF.parquet`) or *static* (one file a
scenario, `TABLE/scenario=S/part-000000.parquet`). Key columns are stored in the files as well as in the folder names,
as `dictionary<int32, string>`: a single file explains itself and every reader agrees on the type.

Conventions of all columns: world frame x east, y north, z up; metres, seconds, radians; zenith angles from +z, azimuths
from +x counter-clockwise; a quaternion rotates from the named frame to the world (mounts: to the agent). `agent` owns
the row and is the receiver of `links` and `paths`; `peer` is the transmitter.
"""

import pyarrow as pa

from mmw.channel import tables as radio
from mmw.core.errors import InputError
from mmw.scene import tables as world
from mmw.sensors.camera_group import tables as images
from mmw.sensors.imu import tables as inertial
from mmw.sensors.lidar import tables as lidar
from mmw.sensors.radar import map_tables as radar_maps
from mmw.sensors.radar import tables as radar
from mmw.storage.table_spec import TableSpec

SCHEMA_VERSION = "2.1"
"""Major number: readers must change. Minor number: columns or tables were added."""

TABLES: dict[str, TableSpec] = {
    spec.name: spec
    for spec in (
        world.FRAMES,
        world.POSES,
        world.BOXES,
        world.BOX_VISIBILITY,
        inertial.IMU,
        inertial.GNSS,
        lidar.LIDAR,
        images.RGB,
        images.DEPTH,
        radar.RADAR,
        radar_maps.RADAR_MAPS,
        radar_maps.RADAR_IQ,
        images.SEGMENTATION,
        images.NORMALS,
        images.FLOW,
        images.BOXES_2D,
        radio.LINKS,
        radio.PATHS,
        world.OBJECTS,
        world.SENSORS,
        world.MATERIALS,
    )
}
"""Every table by name, in the order of the documentation."""


def table_spec(name: str) -> TableSpec:
    """Return a table's specification.

    Raises:
        InputError: If no table has this name; the message lists those that exist.
    """
    if name not in TABLES:
        raise InputError(f"table {name!r} is not known; the tables are {', '.join(TABLES)}; name one of them")
    return TABLES[name]


def column_text(field: pa.Field) -> dict[str, str]:
    """Return a column's `unit` (absent where it has none) and `doc`."""
    return {key.decode(): value.decode() for key, value in (field.metadata or {}).items()}
