"""Buildings of Overture Maps (GeoParquet) -> scene: solids with roofs on flat ground, as those of OpenStreetMap.

Source: Overture Maps schema, buildings theme: `building`, `building_part`; GeoParquet 1.1.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import shapely

from mmw.core.errors import InputError
from mmw.core.geodesy import world_from_wgs84
from mmw.core.georeference import Georeference
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.importers.osm.buildings import find_bodies
from mmw.worlds.importers.osm.feature import Extract, Feature, polygonal
from mmw.worlds.importers.osm.ground import build_ground, plan_ground
from mmw.worlds.importers.osm.materials import Palette
from mmw.worlds.importers.osm.quarter import build_quarter
from mmw.worlds.importers.osm.xml import MAX_EXTENT, check_tags

TAGS = {
    "class": "building", "height": "height", "min_height": "min_height", "num_floors": "building:levels",
    "min_floor": "building:min_level", "roof_shape": "roof:shape", "roof_height": "roof:height",
    "roof_material": "roof:material", "roof_color": "roof:colour", "facade_material": "building:facade:material",
    "facade_color": "building:colour",
}  # fmt: skip
"""Column of Overture -> tag of OpenStreetMap, from which most of its values come."""
MAX_ROWS = 1_000_000
"""Largest number of rows; a city has fewer."""
NOTICE = (
    "contains information from Overture Maps Foundation, overturemaps.org, and (c) OpenStreetMap contributors, which "
    "is made available under the Open Database License (ODbL) 1.0: https://docs.overturemaps.org/attribution"
)
"""Text that has to be named with the data: the buildings theme is under ODbL."""
CURE = "download the buildings again (overturemaps download --type building -f geoparquet)"


def read_overture(path: str | Path, *, parts: str = "") -> ImportedScene:
    """Read buildings of Overture Maps.

    Args:
        path: GeoParquet file with rows of type `building`, longitudes and latitudes.
        parts: File with rows of type `building_part`; outlines that contain parts are left out. None if empty.

    Returns:
        Buildings as closed solids that reach 0.5 m into flat ground at z = 0. No lanes.

    Raises:
        InputError: If a file is no GeoParquet, is larger than 20 km, or holds no building.
    """
    path = Path(path)
    rows = _rows(path, "building") + (_rows(Path(parts), "building:part") if parts else [])
    rows = [row for row in rows if row[2] is not None and not row[2].is_empty]
    if not rows:
        raise InputError(f"{path}: holds no building; choose another area")
    low, high = np.swapaxes([np.reshape(area.bounds, (2, 2)) for _, _, area in rows], 0, 1)
    west, south, east, north = *low.min(axis=0), *high.max(axis=0)
    if not (-90 <= south <= north <= 90 and -180 <= west <= east <= 180):
        raise InputError(
            f"{path}: geometry reaches from {west}, {south} to {east}, {north}; degrees are needed; {CURE}"
        )
    latitude, longitude = np.round([0.5 * (south + north), 0.5 * (west + east)], 6).tolist()
    extract = Extract(path, (latitude, longitude))

    def place(degrees: np.ndarray) -> np.ndarray:
        lat_lon = np.column_stack([degrees[:, 1], degrees[:, 0], np.zeros(len(degrees))])
        return world_from_wgs84(lat_lon, (latitude, longitude, 0.0))[:, :2]

    corners = place(np.array([[west, south], [east, south], [west, north], [east, north]]))
    if np.abs(corners).max() > 0.5 * MAX_EXTENT:
        size = np.ptp(corners, axis=0).max() / 1e3
        raise InputError(f"{path}: {size:.1f} km wide; {MAX_EXTENT / 1e3:.0f} km or less are needed; cut out an area")
    for name, tags, area in rows:
        plan = polygonal(shapely.transform(shapely.force_2d(area), place))
        if plan is not None:
            building = Feature(name, tags, np.zeros((0, 2)), plan)
            check_tags(building, path)
            extract.ways.append(building)
    return _build(extract)


def _build(extract: Extract) -> ImportedScene:
    """Return the buildings of an extract on flat ground."""
    palette = Palette()
    bodies, notes = find_bodies(extract, palette)
    bodies, parts, apart = build_quarter(bodies)
    plan, more = plan_ground(extract, [body.plan for body in bodies])
    latitude, longitude = extract.origin
    notes = [f"origin: latitude {latitude:.6f}, longitude {longitude:.6f} deg", *notes, *apart, *more]
    if palette.unknown:
        notes.append(f"materials and colors not understood: {', '.join(sorted(palette.unknown))}")
    parts = [*build_ground(plan), *parts]
    place = Georeference(latitude, longitude)
    return ImportedScene(parts, palette.foreign, None, tuple(notes), georeference=place, notice=NOTICE)


def _unreadable(path: Path, error: Exception) -> InputError:
    reason = " ".join(str(error).split())[:120]
    return InputError(f"{path}: cannot be read as GeoParquet ({reason}); {CURE}")


def _rows(path: Path, key: str) -> list[tuple[str, dict[str, str], Any]]:
    """Return name, tags and area [deg] of each row.

    Args:
        path: The file.
        key: Tag that says building or part of one.
    """
    try:
        file = pyarrow.parquet.ParquetFile(path)
        names, count = file.schema_arrow.names, file.metadata.num_rows
    except (pa.ArrowException, OSError) as error:
        raise _unreadable(path, error) from None
    column = _geometry_column(path, file.schema_arrow, names)
    if count > MAX_ROWS:
        raise InputError(f"{path}: {count:,} rows; at most {MAX_ROWS:,} are read; cut out a smaller area")
    wanted = [column, *(name for name in ("id", "is_underground", *TAGS) if name in names)]
    try:
        table = file.read(columns=wanted)
        areas = shapely.from_wkb(table.column(column).to_pylist())
        values = {name: table.column(name).to_pylist() for name in wanted if name != column}
    except (pa.ArrowException, OSError, shapely.GEOSException, TypeError, UnicodeDecodeError) as error:
        raise _unreadable(path, error) from None
    rows = []
    for number, area in enumerate(areas):
        row = {name: column[number] for name, column in values.items()}
        if row.get("is_underground") is True:
            continue
        tags = {TAGS[name]: str(value) for name, value in row.items() if name in TAGS and value is not None}
        tags[key] = tags.pop("building", "yes")
        rows.append((f"o{row.get('id') or number}", tags, area))
    return rows


def _geometry_column(path: Path, schema: pa.Schema, names: list[str]) -> str:
    """Return the name of the column with polygons.

    Raises:
        InputError: If there is none, or its coordinates are no longitudes and latitudes.
    """
    text = (schema.metadata or {}).get(b"geo")
    try:
        geo = json.loads(text) if text else {}
        column = geo.get("primary_column", "geometry")
        about = geo.get("columns", {}).get(column, {})
        encoding, crs = about.get("encoding", "WKB"), about.get("crs")
        code = f"{crs['id']['authority']}:{crs['id']['code']}" if crs else "OGC:CRS84"
    except (ValueError, AttributeError, TypeError, KeyError, RecursionError):
        raise InputError(f"{path}: its metadata `geo` is no GeoParquet's; {CURE}") from None
    if column not in names:
        raise InputError(f"{path}: no column {str(column)[:40]!r}; the file has {', '.join(names)[:200]}; {CURE}")
    if encoding != "WKB" or code not in ("OGC:CRS84", "EPSG:4326"):
        raise InputError(
            f"{path}: column {column}: encoding {encoding!r} in {code}; WKB in OGC:CRS84 (longitude, latitude) is "
            "needed; convert it (ogr2ogr -t_srs OGC:CRS84)"
        )
    return column
