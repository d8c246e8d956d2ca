"""Specify tables: types, columns with unit and meaning, the shared keys."""

from dataclasses import dataclass

import pyarrow as pa

from mmw.core.constants import FRAME_RATE_HZ

DEPTH_STEP_M = 0.01
"""Meters in one count of a stored depth image."""

TEXT = pa.string()
NAME = pa.dictionary(pa.int32(), pa.string())
"""Type of names; an int32 index is what pyarrow infers for partition folders."""
IMAGE = pa.struct([pa.field("bytes", pa.binary()), pa.field("path", pa.string())])
"""An encoded image, as Hugging Face datasets spell it."""
I8, I16, I64 = pa.int8(), pa.int16(), pa.int64()
I32 = pa.int32()
"""Type of whole numbers, 32 bits."""
F32 = pa.float32()
"""Type of numbers, 32 bits."""
F64 = pa.float64()
"""Type of numbers, 64 bits."""


def list_of(element: pa.DataType) -> pa.DataType:
    """Return the type of a list column whose elements are never null."""
    return pa.list_(pa.field("element", element, nullable=False))


def column(name: str, type_: pa.DataType, unit: str, doc: str, *, nullable: bool = False) -> pa.Field:
    """Return a column with its unit (empty for none) and meaning."""
    return pa.field(name, type_, nullable=nullable, metadata={"unit": unit, "doc": doc} if unit else {"doc": doc})


def frame_column(rate_hz: float | str = FRAME_RATE_HZ) -> pa.Field:
    """Return the column of frame numbers in files of a frame rate."""
    doc = f"frame number; time is frame / {rate_hz} s after the start of the scenario"
    return column("frame", I32, f"1/{rate_hz} s", doc)


def encoded_image(name: str, unit: str, doc: str) -> pa.Field:
    """Return a column of encoded images, nullable as Hugging Face's image feature, which is a dictionary otherwise."""
    return column(name, IMAGE, unit, doc, nullable=True)


def xyz(names: str, type_: pa.DataType, unit: str, doc: str) -> list[pa.Field]:
    """Return one column for each of the space-separated names; `{}` in the text becomes the axis."""
    return [column(name, type_, unit, doc.format(axis)) for name, axis in zip(names.split(), "xyz", strict=True)]


def quaternion(doc: str) -> list[pa.Field]:
    """Return the four columns of a unit quaternion."""
    return [column(f"q{axis}", F64, "-", f"{axis} part of the unit quaternion {doc}") for axis in "xyzw"]


@dataclass(frozen=True)
class TableSpec:
    """One table."""

    name: str
    doc: str
    """Meaning of one row, in one sentence."""
    columns: tuple[pa.Field, ...]
    key: tuple[str, ...]
    """Columns that together name a row; rows are sorted by them, in this order."""
    framed: bool = True
    """True: a file a shard. False: a file a scenario."""
    by_weather: bool = True
    """False: rows with frames that are the same in every weather; the shard of the first weather has the file."""
    frames_per_group: int = 0
    """Frames in one Parquet row group, which a reader must fetch for one row; 0 for groups of 65,536 rows."""
    level: int = 3
    """zstd level."""
    unique: tuple[str, ...] = ()
    """Columns besides the key that together name a row; none in most tables."""

    @property
    def of_weather(self) -> bool:
        """True if each file is of one weather, after which its folder is named."""
        return self.framed and self.by_weather

    @property
    def full_key(self) -> tuple[str, ...]:
        """The key, with the columns that the folders of its files are named after."""
        return ("scenario", *(("weather",) if self.of_weather else ()), *self.key)


@dataclass(frozen=True)
class ViewSpec:
    """A table that is stored as others and joined when it is read; it has no file."""

    name: str
    doc: str
    """Meaning of one row, in one sentence."""
    columns: tuple[pa.Field, ...]
    key: tuple[str, ...]
    """Columns that together name a row; rows are sorted by them, in this order."""
    tables: tuple[str, ...]
    """Tables that it joins; each row of it has one of the first."""

    @property
    def full_key(self) -> tuple[str, ...]:
        """The key, with scenario and weather."""
        return ("scenario", "weather", *self.key)


SCENARIO = column("scenario", NAME, "", "scenario name")
WEATHER = column(
    "weather", NAME, "", "weather name, one of `weathers`; its physical values are in `air` of the configuration"
)
FRAME = frame_column()
AGENT = column(
    "agent", NAME, "", "agent that owns the row, such as cav_1, rsu_1, vru_1, uav_1 or bs_1; `poses` has its role"
)
SENSOR = column("sensor", NAME, "", "sensor name; joins `sensors` on (scenario, agent, sensor)")
OBJECT = column("object_id", I32, "id", "object, a row of `objects`; one number for the object in every table")
FRAMED = (SCENARIO, WEATHER, FRAME)
OWNED = (*FRAMED, AGENT)


def sensor_table(name: str, doc: str, *columns: pa.Field, frames_per_group: int = 0, level: int = 3) -> TableSpec:
    """Return the table of a sensor: scenario, weather, frame, agent and sensor come before its own columns."""
    return TableSpec(
        name,
        doc,
        (*OWNED, SENSOR, *columns),
        ("frame", "agent", "sensor"),
        frames_per_group=frames_per_group,
        level=level,
    )
