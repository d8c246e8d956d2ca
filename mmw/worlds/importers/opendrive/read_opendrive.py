"""OpenDRIVE (.xodr) -> World: road surfaces, junctions, ground and lanes.

Source: ASAM OpenDRIVE 1.4 to 1.8, as CARLA, RoadRunner and esmini write it.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely

from mmw.core.errors import InputError
from mmw.worlds.importers.geo.projection import read_projection
from mmw.worlds.importers.imported_scene import ImportedScene, library_material
from mmw.worlds.importers.mesh_cleanup import MAX_SIZE_M, free_name, identifier
from mmw.worlds.importers.opendrive.cross_section import RoadShape
from mmw.worlds.importers.opendrive.curbs import Sheets, close_edges
from mmw.worlds.importers.opendrive.document import Document, read_document
from mmw.worlds.importers.opendrive.ground import OVERPASS, add_deck, bridge_rows, build_ground
from mmw.worlds.importers.opendrive.junction import build_junction
from mmw.worlds.importers.opendrive.lanes import build_lanes
from mmw.worlds.importers.opendrive.limits import MAX_JUNCTION, MIN_ROAD, PLACE, check_extent, number
from mmw.worlds.importers.opendrive.overlaps import CRACK, PATCHES, carriageways, cut_overlaps, pave_gaps
from mmw.worlds.importers.opendrive.reference_line import make_line
from mmw.worlds.importers.opendrive.road_surface import YELLOW, Sheet, build_sheet
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.plan_geometry import intersect_areas, subtract_area

MAX_OFFSET = 10e3
"""A town farther than this from the origin of its file gets an origin of its own [m]: meshes are single precision."""
EXTENT_STEP = 5.0
"""Distance of the samples from which the extent of a road is told [m]; design value."""
PAINT = replace(
    library_material("road_marking"), name=YELLOW, source="yellow road mark", color=(0.62, 0.42, 0.05), coating="paint",
    attributes=("none",),
)  # fmt: skip
"""Yellow paint: the library's white paint but for its color, design value. Weathers do not wet it."""


def read_opendrive(path: str | Path, *, strict: bool = False) -> ImportedScene:
    """Read an OpenDRIVE file.

    Args:
        path: The file.
        strict: Whether roads, links and records that contradict the standard are errors; else they are mended or left
            out, with a note for each kind of fault.

    Returns:
        Roads, ground and lanes. Lanes are named `road_<id>_s<section>_<l|r><number>`; junctions `junction_<id>`.

    Raises:
        InputError: If the file is no OpenDRIVE, is broken, has nothing to build, or a fault where `strict`; the message
            names road and cure.
    """
    path = Path(path)
    document = read_document(path, is_strict=strict)
    origin, notes = _origin(document)
    notes = [*document.skipped, *notes]
    shapes = _shapes(document, origin)
    _check_extents(path, shapes)
    for key, shape in shapes.items():
        for station, gap in shape.line.jumps():
            if gap > 0.01:
                notes.append(f"road {key!r}: the reference line jumps by {gap:.3f} m at s = {station:.2f} m")
    names = _names(document)
    outside = {k: build_sheet(names[k], shape) for k, shape in shapes.items() if not shape.road.junction}
    covered = shapely.union_all([sheet.outline for sheet in outside.values()], grid_size=1e-4)
    seams = [rows for sheet in outside.values() for rows in (sheet.rows[0], sheet.rows[-1])]
    ends = np.concatenate(seams) if seams else np.zeros((0, 3))
    inside = {}
    for key in sorted({shape.road.junction for shape in shapes.values()} - {""}):
        members = [shape for shape in shapes.values() if shape.road.junction == key]
        inside[key] = build_junction(identifier(f"junction_{key}"), members, ends, covered)
    sheets = [sheet for sheet in (*outside.values(), *inside.values()) if sheet.surface.faces]
    if not sheets:
        raise InputError(f"{path}: no lane of its roads has a width; give their lanes a <width>")
    notes += _overlaps(outside)
    cut_overlaps(sheets)
    graph, more = build_lanes(document, shapes, names, carriageways(sheets))
    notes += more
    gaps = None if graph is None else pave_gaps(graph, carriageways(sheets, CRACK))
    if gaps is not None:
        sheets.append(gaps)
        cut_overlaps(sheets, gaps)
        notes.append("gaps between roads under lanes were paved")
    tops = Sheets([sheet.surface for sheet in sheets])
    ground = _close(sheets, tops, notes)
    parts = [part for sheet in sheets for part in _parts(sheet)]
    parts.append(build_ground(ground, tops))
    foreign = {YELLOW: PAINT} if any(part.material == YELLOW for part in parts) else {}
    if inside:
        notes.append(f"road marks in {len(inside)} junctions left out: the roads there overlap")
    projection = read_projection(path, origin)
    return ImportedScene(parts, foreign, graph, (*document.repairs, *notes), projection=projection)


def _shapes(document: Document, origin: np.ndarray) -> dict[str, RoadShape]:
    """Return the roads that are long enough to be built, by id; those without a reference line are left out."""
    shapes = {}
    for key, road in list(document.roads.items()):
        if key in document.welded:
            continue
        try:
            shapes[key] = RoadShape(road, make_line(road, f"{document.path}: road {key!r}", origin))
        except InputError as error:
            document.drop_road(key, error)
    if not shapes:
        raise InputError(f"{document.path}: no road is longer than {MIN_ROAD:g} m; export the whole network")
    return shapes


def _check_extents(path: Path, shapes: dict[str, RoadShape]) -> None:
    """Raise InputError for roads, junctions and files that are too large to be meshed."""
    corners: dict[str, list[np.ndarray]] = {}
    for key, shape in shapes.items():
        where = f"{path}: road {key!r}"
        count = 2 + int(shape.road.length / EXTENT_STEP)
        with np.errstate(over="ignore", invalid="ignore"):
            xy, _ = shape.line.at(np.linspace(0.0, shape.road.length, count))
        check_extent(where, xy)
        for group in ("", shape.road.junction):
            corners.setdefault(group, []).append(np.stack([xy.min(axis=0), xy.max(axis=0)]))
    for junction, found in corners.items():
        where = f"{path}: junction {junction!r}" if junction else f"{path}: the map"
        check_extent(where, np.concatenate(found), MAX_JUNCTION if junction else MAX_SIZE_M)


def _origin(document: Document) -> tuple[np.ndarray, list[str]]:
    """Return the point of the file that becomes the origin [m], shape [2], and a note if it is not (0, 0)."""
    pieces = [(f"{document.path}: road {key!r}", g) for key, road in document.roads.items() for g in road.geometry]
    xy = np.array([[number(piece, axis, where, limits=PLACE) for axis in "xy"] for where, piece in pieces])
    middle = 0.5 * (xy.min(axis=0) + xy.max(axis=0))
    if np.abs(middle).max() < MAX_OFFSET:
        return np.zeros(2), []
    origin = np.round(middle, -2)
    return origin, [f"the origin was moved to x = {origin[0]:.0f} m, y = {origin[1]:.0f} m of the file"]


def _names(document: Document) -> dict[str, str]:
    """Return road id -> identifier."""
    names: dict[str, str] = {}
    for key in document.roads:
        names[key] = free_name(identifier(f"road_{key}"), names.values())
    return names


def _overlaps(outside: dict[str, Sheet]) -> list[str]:
    """Return a note if roads outside junctions lie on each other at one height."""
    keys = list(outside)
    if len(keys) < 2:
        return []
    outlines = [outside[key].outline for key in keys]
    found = []
    for i, j in np.asarray(shapely.STRtree(outlines).query(outlines, predicate="intersects")).T:
        if i < j:
            area = intersect_areas(outlines[i], outlines[j])
            if area.area > 0.05:
                at = shapely.get_coordinates(shapely.point_on_surface(area))
                z = [Sheets([outside[keys[k]].surface]).lowest(at)[0] for k in (i, j)]
                if abs(z[0] - z[1]) < OVERPASS:
                    found.append((area.area, keys[i], keys[j]))
    if not found:
        return []
    area, first, second = max(found)
    return [
        f"{len(found)} pairs of roads outside junctions overlap, most of all {first!r} and {second!r} by {area:.1f} "
        "m2; the first one's surface is kept there"
    ]


def _close(sheets: list[Sheet], tops: Sheets, notes: list[str]) -> shapely.Geometry:
    """Give every sheet its sides, bridges their undersides, and return what lies on the ground."""
    ground, bridges = [], 0
    for sheet in sheets:
        if sheet.name == PATCHES:  # its edges meet others, but for a hand's breadth of air over the ground
            ground.append(sheet.outline)
            continue
        outline, side = sheet.outline, "soil"
        if sheet.rows:
            over = bridge_rows(sheet, tops)
            if over.any():
                bridges, side = bridges + 1, "concrete_structure"
                close_edges(sheet.surface, tops, side=side)
                outline = subtract_area(outline, add_deck(sheet, over), 1e-4)
        if side == "soil":
            close_edges(sheet.surface, tops)
        ground.append(outline)
    if bridges:
        notes.append(f"{bridges} roads cross others on bridges; a deck without piers or parapets was assumed")
    return shapely.union_all(ground, grid_size=1e-4)


def _parts(sheet: Sheet) -> list[MeshPart]:
    """Return the meshes of one sheet."""
    name = sheet.name
    return sheet.surface.parts(
        {
            "asphalt": (f"Roads/{name}/asphalt", "road"),
            "road_marking": (f"Roads/{name}/marking", "road_line"),
            YELLOW: (f"Roads/{name}/marking_yellow", "road_line"),
            "concrete_sidewalk": (f"Sidewalks/{name}/walk", "sidewalk"),
            "curb": (f"Sidewalks/{name}/curb", "sidewalk"),
            "grass": (f"Terrain/{name}/green", "terrain"),
            "soil": (f"Terrain/{name}/side", "terrain"),
            "concrete_structure": (f"Bridges/{name}/deck", "bridge"),
        }
    )
