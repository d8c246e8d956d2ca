"""Read tables of positions over time: Parquet and CSV, also of datasets, SUMO's floating-car data and CommonRoad."""

import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet

from mmw.core.errors import InputError
from mmw.core.georeference import Georeference, locate
from mmw.traffic.replay.object_classes import vehicle_class
from mmw.traffic.replay.xml_tables import open_packed, read_xml_table

REFERENCES = ("front_bumper", "front_axle", "center", "rear_axle")
"""Points of a vehicle that a table may give: `center` is the middle of the body."""

ALIASES: Mapping[str, tuple[str, ...]] = {
    "t": ("t", "time", "timestep_time", "timestamp", "timestamp_s", "timestamp_ms", "timestamp_us", "timestamp_micros",
          "timestamp_ns", "timestep"),
    "id": ("id", "vehicle_id", "track_id", "object_id", "instance_token"),
    "x": ("x", "vehicle_x", "position_x", "center_x"),
    "y": ("y", "vehicle_y", "position_y", "center_y"),
    "z": ("z", "vehicle_z"),
    "latitude": ("latitude", "lat", "latitude_deg"),
    "longitude": ("longitude", "lon", "longitude_deg"),
    "heading": ("heading", "yaw", "psi_rad"),
    "heading_deg": ("heading_deg", "yaw_deg"),
    "angle": ("vehicle_angle",),
    "type": ("type", "vehicle_type", "class", "category", "object_type", "agent_type", "category_name"),
    "length": ("length",),
    "width": ("width",),
    "reference": ("reference",),
}  # fmt: skip
"""Our name of a column -> the names that files use. Those with `vehicle_` are what SUMO writes; others are those of
Argoverse 1 and 2, INTERACTION, Waymo and nuScenes. `center_z` is no road height."""

SECONDS = {
    "timestamp_ms": 1e-3, "timestamp_us": 1e-6, "timestamp_micros": 1e-6, "timestamp_ns": 1e-9, "timestep": 0.1,
}  # fmt: skip
"""Name of a column of times -> its unit [s]; a `timestep` is that of Argoverse 2, which has ten in a second."""

EPOCHS = ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3))
"""A `timestamp` of at least this many units since 1970 has this unit [s]: in seconds 1e11 is the year 5138, in
milliseconds it is 1973. nuScenes has microseconds."""

NEEDED = ("t", "id", "x", "y")
GEOGRAPHIC = ("t", "id", "latitude", "longitude")
"""Columns that are needed instead where a table has neither x nor y."""


@dataclass(frozen=True)
class Trajectory:
    """The samples of one vehicle, sorted by time."""

    id: str
    time: np.ndarray
    """Time from the earliest sample of the file [s], shape [N], rising."""
    points: np.ndarray
    """Reference point, x east and y north [m], shape [N, 2]."""
    height: np.ndarray | None
    """Height of the road there, to within a meter [m], shape [N]; None if the table does not say."""
    heading: np.ndarray | None
    """Heading of the body, counter-clockwise from east [rad], shape [N]; None if the table does not say."""
    type: str = ""
    """Type of the vehicle in the table; empty if it has none."""
    length: float = 0.0
    """Bumper to bumper [m]; 0 if the table does not say."""
    width: float = 0.0
    """From side to side [m]; 0 if the table does not say."""
    reference: str = "center"
    """One of `REFERENCES`."""


@dataclass(frozen=True)
class Recording:
    """Vehicles of a file."""

    vehicles: list[Trajectory]
    """Sorted by id."""
    notes: tuple[str, ...] = ()
    """Omissions, one line each."""


def read_trajectories(path: Path, georeference: Georeference | None = None) -> Recording:
    """Return the vehicles of a file; people, cyclists and all else without a vehicle model are left out.

    Args:
        path: `.parquet`, `.csv` (comma or semicolon), or `.xml`: what SUMO's option `--fcd-output` writes, or a
            CommonRoad scenario; `.csv` and `.xml` may be compressed (`.gz`).
        georeference: Place of the town, for tables with latitude and longitude instead of x and y.

    Raises:
        InputError: If the file cannot be read, lacks a column, or holds a value that cannot be used.
    """
    suffixes = [suffix.lower() for suffix in path.suffixes]
    kind = suffixes[-2] if suffixes[-1:] == [".gz"] and len(suffixes) > 1 else "".join(suffixes[-1:])
    notes: list[str] = []
    try:
        if kind == ".parquet":
            table = pyarrow.parquet.read_table(path)
        elif kind == ".csv":
            table = _read_csv(path)
        elif kind == ".xml":
            table, notes = read_xml_table(path)
        else:
            raise InputError(f"{path}: is no .parquet, .csv or .xml file; give one of them")
        _ = table.column_names  # decodes them
    except (pa.ArrowException, OSError, EOFError, UnicodeDecodeError, ElementTree.ParseError) as error:
        raise InputError(f"{path}: cannot be read ({str(error).splitlines()[0]}); give an intact file") from None
    vehicles, left_out = [], Counter()
    for each in _split(_columns(table, path, georeference), path):
        name = vehicle_class(each.type)
        if name is None:
            left_out[each.type] += 1
        else:
            vehicles.append(replace(each, type=name))
    named = ", ".join(f"{count} {name}" for name, count in sorted(left_out.items()))
    if named:
        notes.append(f"{path.name}: left out, for they are no vehicles with a model: {named}")
    return Recording(vehicles, tuple(notes))


def _read_csv(path: Path) -> pa.Table:
    with open_packed(path) as file:
        delimiter = ";" if b";" in file.readline() else ","
    text = {name: pa.string() for key in ("id", "type", "reference") for name in ALIASES[key]}
    return pyarrow.csv.read_csv(
        path,
        parse_options=pyarrow.csv.ParseOptions(delimiter=delimiter),
        convert_options=pyarrow.csv.ConvertOptions(column_types=text),
    )


def _columns(table: pa.Table, path: Path, georeference: Georeference | None) -> dict[str, np.ndarray]:
    """Return the columns by our names: numbers as float64, texts as objects; those that are not there are left out."""
    names = {name.strip().lower(): name for name in table.column_names}
    if len(names) < len(table.column_names):
        (twice, _), *_ = Counter(name.strip().lower() for name in table.column_names).most_common(1)
        raise InputError(f"{path}: column {twice[:40]} is there twice; names of columns must differ; remove one")
    found = {key: next((names[a] for a in aliases if a in names), None) for key, aliases in ALIASES.items()}
    needed = NEEDED if found["x"] or found["y"] or not found["latitude"] else GEOGRAPHIC
    missing = [key for key in needed if found[key] is None]
    if missing:
        raise InputError(
            f"{path}: no column {', '.join(ALIASES[missing[0]])}; one each for t, id, x and y (or latitude "
            "and longitude) is needed; the file has "
            f"{', '.join(table.column_names) or 'none'}"
        )
    if not table.num_rows:
        raise InputError(f"{path}: holds no row; at least one vehicle is needed; give its samples")
    out: dict[str, np.ndarray] = {}
    for key, name in found.items():
        if name is None:
            continue
        column = table.column(name).combine_chunks()
        if key in ("id", "type", "reference"):
            out[key] = np.array(pc.fill_null(pc.cast(column, pa.string()), "").to_pylist(), dtype=object)
            continue
        try:
            values = _seconds(column, name) if key == "t" else _numbers(column)
        except pa.ArrowException as error:
            reason = " ".join(str(error).split())[:100]
            raise InputError(f"{path}: column {name}: {reason}; numbers are needed; correct them") from None
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad) and key in needed:
            raise InputError(f"{path}: column {name}: row {bad[0] + 1} holds no number; a value is needed; remove it")
        if len(bad) < len(values):
            out[key] = values
    if "angle" in out:  # SUMO counts clockwise from north
        out["heading"] = np.pi / 2 - np.radians(out["angle"])
    elif "heading_deg" in out:
        out["heading"] = np.radians(out["heading_deg"])
    if needed is GEOGRAPHIC:
        degrees = np.column_stack([out["latitude"], out["longitude"]])
        out["x"], out["y"] = locate(georeference, degrees, str(path)).T
        if georeference is not None and "heading" in out:
            out["heading"] = out["heading"] + georeference.heading  # from true east to the world's x axis
    if found["x"] == names.get("vehicle_x") and "reference" not in out:
        out["reference"] = np.full(len(out["t"]), "front_bumper", dtype=object)
    return out


def _numbers(column: pa.Array) -> np.ndarray:
    return pc.cast(column, pa.float64()).to_numpy(zero_copy_only=False)


def _seconds(column: pa.Array, name: str) -> np.ndarray:
    """Return a column of times [s], those of whole numbers from its smallest one: nanoseconds need all their digits."""
    name, unit = name.strip().lower(), 1.0
    if pa.types.is_timestamp(column.type):
        column, unit = pc.cast(pc.cast(column, pa.timestamp("ns", column.type.tz)), pa.int64()), 1e-9
    elif name in SECONDS:
        unit = SECONDS[name]
    elif name == "timestamp":
        first = pc.min(pc.cast(column, pa.float64())).as_py() or 0.0
        unit = next((size for least, size in EPOCHS if first >= least), 1.0)
    if pa.types.is_integer(column.type):
        column = pc.subtract(column, pc.min(column))
    return unit * _numbers(column)


def _split(columns: dict[str, np.ndarray], path: Path) -> list[Trajectory]:
    """Return one trajectory for each id."""
    time = columns["t"]
    time = time - time.min()
    ids, owner = np.unique(columns["id"].astype(str), return_inverse=True)
    order = np.lexsort((time, owner))
    out = []
    for rows in np.split(order, np.flatnonzero(np.diff(owner[order])) + 1):
        name = str(ids[owner[rows[0]]])
        if not name:
            raise InputError(f"{path}: row {rows[0] + 1} has no id; every row needs one")
        rows = rows[_distinct(time[rows], columns, rows, name, path)]
        height, heading = (columns[key][rows] if key in columns else None for key in ("z", "heading"))
        reference = str(columns["reference"][rows[0]]) if "reference" in columns else "center"
        if reference not in REFERENCES:
            raise InputError(
                f"{path}: vehicle {name!r}: reference = {reference!r}; one of {', '.join(REFERENCES)} is needed"
            )
        length, width = (columns[key][rows[0]] if key in columns else np.nan for key in ("length", "width"))
        out.append(
            Trajectory(
                id=name,
                time=time[rows],
                points=np.column_stack([columns["x"][rows], columns["y"][rows]]),
                height=height if height is not None and np.isfinite(height).all() else None,
                heading=np.unwrap(heading) if heading is not None and np.isfinite(heading).all() else None,
                type=str(columns["type"][rows[0]]) if "type" in columns else "",
                length=float(length) if np.isfinite(length) else 0.0,
                width=float(width) if np.isfinite(width) else 0.0,
                reference=reference,
            )
        )
    return out


SAME_PLACE = 0.2
"""Two samples of one vehicle at one time are the same if they are not farther apart than this [m]."""


def _distinct(time: np.ndarray, columns: dict[str, np.ndarray], rows: np.ndarray, name: str, path: Path) -> np.ndarray:
    """Return a mask of a vehicle's rows: the first one of each time stamp."""
    twice = np.flatnonzero(np.diff(time) <= 0)
    step = np.hypot(np.diff(columns["x"][rows]), np.diff(columns["y"][rows]))
    far = twice[step[twice] > SAME_PLACE]
    if len(far):
        raise InputError(
            f"{path}: vehicle {name!r} is at two places {step[far[0]]:.1f} m apart at t = {time[far[0]]:.2f} s; one "
            "place at a time is needed; give every vehicle an id of its own"
        )
    is_first = np.ones(len(time), bool)
    is_first[twice + 1] = False
    return is_first
