"""Collect the tables of a dataset, with name, type, unit and meaning of each column.

A table is either *framed* (one file a shard, `TABLE/scenario=S/weather=W/part-FFFFFF.parquet`; without `weather=W` if
its rows are the same in every weather) or *static* (one file a scenario, `TABLE/scenario=S/part-000000.parquet`). A
*view* has no file: it joins tables when it is read. Key columns are stored in the files as well as in the folder names,
as `dictionary<int32, string>`: a single file explains itself and every reader agrees on the type.

Conventions of all columns: world frame x east, y north, z up; meters, seconds, radians; zenith angles from +z, azimuths
from +x counter-clockwise; a quaternion rotates from the named frame to the world (mounts: to the agent). `agent` owns
the row and is the receiver of links and paths; `peer` is the transmitter.
"""

from collections.abc import Collection, Iterator, Mapping
from functools import cache

import pyarrow as pa

from mmw.config.sensor_spec import SENSORS, SensorSpec
from mmw.core.errors import InputError
from mmw.core.registry import load_reference
from mmw.storage.table_spec import TableSpec, ViewSpec

SCHEMA_VERSION = "3.2"
"""Major number: readers must change. Minor number: columns or tables were added."""

CORE_TABLES = ("mmw.scene.tables:FRAMED_TABLES", "mmw.channel.tables:TABLES", "mmw.scene.tables:STATIC_TABLES")
"""Tables that no sensor fills; those of the sensors follow the first. Each module owns its tables."""


class _Tables(Mapping[str, TableSpec]):
    """Every table by name, in the order of the documentation: a sensor that is registered later has its tables here."""

    def __init__(self) -> None:
        self._found: dict[str, TableSpec] = {}
        self._sensors: tuple[SensorSpec, ...] = ()

    def __getitem__(self, name: str) -> TableSpec:
        return self._all()[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all())

    def __len__(self) -> int:
        return len(self._all())

    def _all(self) -> dict[str, TableSpec]:
        """Collect the tables, again where a sensor was registered since."""
        sensors = tuple(SENSORS.values())
        if not self._found or list(map(id, sensors)) != list(map(id, self._sensors)):
            self._found, self._sensors = self._collect(), sensors
        return self._found

    @staticmethod
    def _collect() -> dict[str, TableSpec]:
        framed, channel, static = (load_reference(reference) for reference in CORE_TABLES)
        found = {spec.name: spec for spec in framed}
        owners = dict.fromkeys((*found, *views()), "mmw")
        own = [(sensor, spec) for sensor, kind in SENSORS.items() for spec in kind.tables]
        core = [("mmw", spec) for spec in (*channel, *static)]
        for owner, spec in (*own, *core):
            if spec.name in views() or found.setdefault(spec.name, spec) is not spec:
                raise InputError(
                    f"table {spec.name!r}: both {owners[spec.name]} and {owner} define it; rename one of them"
                )
            owners.setdefault(spec.name, owner)
        return found


TABLES = _Tables()
"""Every table by name."""

CORE_VIEWS = ("mmw.channel.tables:VIEWS",)
"""Views; each module owns its own."""


@cache
def views() -> Mapping[str, ViewSpec]:
    """Return every view by name."""
    return {view.name: view for reference in CORE_VIEWS for view in load_reference(reference)}


def views_of(tables: Collection[str]) -> tuple[str, ...]:
    """Return the names of the views whose tables are all among some tables."""
    return tuple(name for name, view in views().items() if set(view.tables) <= set(tables))


def table_spec(name: str) -> TableSpec:
    """Return a table's specification.

    Raises:
        InputError: If no table has this name; the message lists those that exist, or those that a view joins.
    """
    if name in views():
        raise InputError(f"table {name!r} is a view of {' and '.join(views()[name].tables)}; name one of these")
    found = TABLES.get(name)
    if found is None:
        raise InputError(f"table {name!r} is not known; the tables are {', '.join(TABLES)}; name one of them")
    return found


def column_text(field: pa.Field) -> dict[str, str]:
    """Return a column's `unit` (absent where it has none) and `doc`."""
    return {key.decode(): value.decode() for key, value in (field.metadata or {}).items()}
