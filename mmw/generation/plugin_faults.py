"""Attribute the faults of sensors of other packages to them: what they raise, and rows that do not fit their tables."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from mmw.config import SensorConfig
from mmw.config.sensor_spec import SENSORS
from mmw.core.errors import Error, PluginError, is_out_of_memory
from mmw.scene.table_rows import resolved
from mmw.storage.arrow_tables import check_columns


@contextmanager
def plugin_faults(sensor: SensorConfig) -> Iterator[None]:
    """Name the sensor and its package in errors of the block; those of mmw's own sensors pass.

    Raises:
        PluginError: If the code of another package fails.
    """
    owner = SENSORS.owner(sensor.type)
    try:
        yield
    except Exception as error:
        if owner == "mmw" or isinstance(error, Error) or is_out_of_memory(error):
            raise
        text = " ".join(str(error).split())
        raise PluginError(
            f"sensor {sensor.name!r}: {type(error).__name__} in the package that provides its type {sensor.type!r} "
            f"({owner}): {text}; report it there, with the trace"
        ) from error


def checked_columns(sensor: SensorConfig, table: str, columns: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the columns of a sensor; those of another package's after the checks of `unsorted_table`.

    Raises:
        PluginError: If they do not fit the table; the message names sensor, package, table and column.
    """
    owner = SENSORS.owner(sensor.type)
    if owner == "mmw":
        return columns
    own = {spec.name for spec in SENSORS[sensor.type].tables}
    shared = set(SENSORS[sensor.type].shared_tables)
    where = f"sensor {sensor.name!r} of {owner}"
    if table not in own | shared:
        raise PluginError(f"{where}: gives table {table!r}; its SensorSpec lists {', '.join(sorted(own | shared))}")
    try:
        check_columns(table, resolved(dict(columns)))
    except ValueError as error:
        raise PluginError(f"{where}: {error}") from error
    return columns
