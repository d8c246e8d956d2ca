"""Read tables of vehicle positions over time: Parquet, CSV and SUMO's floating-car data."""

import gzip
import io
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet

from mmw.core.errors import InputError

REFERENCES = ("front_bumper", "front_axle", "center", "rear_axle")
"""Points of a vehicle that a table may give: `center` is the middle of the body."""

ALIASES: Mapping[str, tuple[str, ...]] = {
    "t": ("t", "time", "timestep_time"),
    "id": ("id", "vehicle_id"),
    "x": ("x", "vehicle_x"),
    "y": ("y", "vehicle_y"),
    "z": ("z", "vehicle_z"),
    "heading": ("heading", "yaw"),
    "heading_deg": ("heading_deg", "yaw_deg"),
    "angle": ("vehicle_angle",),
    "type": ("type", "vehicle_type"),
    "length": ("length",),
    "reference": ("reference",),
}
"""Our name of a column -> the names that files use. Those with `vehicle_` are what SUMO writes."""

NEEDED = ("t", "id", "x", "y")


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
    reference: str = "center"
    """One of `REFERENCES`."""


def read_trajectories(path: Path) -> list[Trajectory]:
    """Return the vehicles of a file, sorted by id.

    Args:
        path: `.parquet`, `.csv` (comma or semicolon), or `.xml` as SUMO's option `--fcd-output` writes it; `.csv` and
            `.xml` may be compressed (`.gz`).

    Raises:
        InputError: If the file cannot be read, lacks a column, or holds a value that cannot be used.
    """
    suffixes = [suffix.lower() for suffix in path.suffixes]
    kind = suffixes[-2] if suffixes[-1:] == [".gz"] and len(suffixes) > 1 else "".join(suffixes[-1:])
    try:
        if kind == ".parquet":
            table = pyarrow.parquet.read_table(path)
        elif kind == ".csv":
            table = _read_csv(path)
        elif kind == ".xml":
            table = _read_fcd(path)
        else:
            raise InputError(f"{path}: is no .parquet, .csv or .xml file; give one of them")
    except (pa.ArrowException, OSError, EOFError, ElementTree.ParseError) as error:
        raise InputError(f"{path}: cannot be read ({str(error).splitlines()[0]}); give an intact file") from None
    return _split(_columns(table, path), path)


def _read_csv(path: Path) -> pa.Table:
    with _open(path) as file:
        delimiter = ";" if b";" in file.readline() else ","
    text = {name: pa.string() for key in ("id", "type", "reference") for name in ALIASES[key]}
    return pyarrow.csv.read_csv(
        path,
        parse_options=pyarrow.csv.ParseOptions(delimiter=delimiter),
        convert_options=pyarrow.csv.ConvertOptions(column_types=text),
    )


def _open(path: Path) -> gzip.GzipFile | io.BufferedReader:
    return gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb")


def _read_fcd(path: Path) -> pa.Table:
    """Return SUMO's floating-car data as its own columns; people and containers are left out."""
    names = ("id", "x", "y", "z", "angle", "type")
    rows: dict[str, list] = {name: [] for name in ("timestep_time", *(f"vehicle_{name}" for name in names))}
    with _open(path) as file:
        now = None
        for event, element in ElementTree.iterparse(file, events=("start", "end")):
            if event == "start" and element.tag == "timestep":
                now = element.get("time")
            elif event == "end" and element.tag == "vehicle":
                rows["timestep_time"].append(now)
                for name in names:
                    rows[f"vehicle_{name}"].append(element.get(name))
            elif event == "end" and element.tag == "timestep":
                element.clear()
    return pa.table({name: pa.array(values, pa.string()) for name, values in rows.items()})


def _columns(table: pa.Table, path: Path) -> dict[str, np.ndarray]:
    """Return the columns by our names: numbers as float64, texts as objects; those that are not there are left out."""
    names = {name.strip().lower(): name for name in table.column_names}
    found = {key: next((names[a] for a in aliases if a in names), None) for key, aliases in ALIASES.items()}
    missing = [key for key in NEEDED if found[key] is None]
    if missing:
        raise InputError(
            f"{path}: no column {' or '.join(ALIASES[missing[0]])}; t, id, x and y are needed; the file has "
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
            values = pc.cast(column, pa.float64()).to_numpy(zero_copy_only=False)
        except pa.ArrowException as error:
            raise InputError(f"{path}: column {name}: {error}; numbers are needed; correct them") from None
        bad = np.flatnonzero(~np.isfinite(values))
        if len(bad) and key in NEEDED:
            raise InputError(f"{path}: column {name}: row {bad[0] + 1} holds no number; a value is needed; remove it")
        if len(bad) < len(values):
            out[key] = values
    if "angle" in out:  # SUMO counts clockwise from north
        out["heading"] = np.pi / 2 - np.radians(out["angle"])
    elif "heading_deg" in out:
        out["heading"] = np.radians(out["heading_deg"])
    if found["x"] == names.get("vehicle_x") and "reference" not in out:
        out["reference"] = np.full(len(out["t"]), "front_bumper", dtype=object)
    return out


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
        length = columns["length"][rows[0]] if "length" in columns else 0.0
        out.append(
            Trajectory(
                id=name,
                time=time[rows],
                points=np.column_stack([columns["x"][rows], columns["y"][rows]]),
                height=height if height is not None and np.isfinite(height).all() else None,
                heading=np.unwrap(heading) if heading is not None and np.isfinite(heading).all() else None,
                type=str(columns["type"][rows[0]]) if "type" in columns else "",
                length=float(length) if np.isfinite(length) else 0.0,
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
