"""Register importers: which function reads which files, and with which options. Nothing heavy is imported here.

To add one to mmw: a function and an `Importer` below. Other packages use the entry point group `mmw.importers`.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.parsers import expat

from mmw.core.errors import InputError
from mmw.core.registry import Registry, load_reference
from mmw.worlds.importers.imported_scene import ImportedScene

UNITS = {"mm": 0.001, "cm": 0.01, "m": 1.0, "km": 1000.0, "in": 0.0254, "ft": 0.3048}
"""Unit -> meters. Source of inch and foot: international yard and pound agreement, 1959."""


@dataclass(frozen=True)
class Importer:
    """Read files of some formats as an `ImportedScene`."""

    suffixes: tuple[str, ...]
    """Endings of file names in lower case, such as `.osm.xml`; of several that fit a file, the longest counts."""
    read: str
    """`module:function`, called with the path and the given options as keywords; imported when a file is read."""
    help: str
    """One line: formats and what is read."""
    options: Mapping[str, str]
    """Option -> its effect in one line. `up`, `unit`, `origin`, `strict`, `bbox` and `traffic` are flags of `mmw
    import` and reach the function as `up` (`y` or `z`), `unit_m` [m], `origin` [m], shape [3], `strict` and `traffic`,
    true, and `bbox`, text; others are given as `name=value` and stay text."""
    root: str = ""
    """Root element of its files, where several importers read files with one suffix, such as `.xml`."""


_PLACED = {
    "up": "axis that points up in the file, y or z",
    "unit": f"unit of the file: {', '.join(UNITS)}",
    "origin": "point of the scene, z up, in meters, that becomes the origin",
}
FLAGS = (*_PLACED, "strict", "terrain", "bbox", "traffic")
"""Options that are flags of `mmw import`."""
MITSUBA = Importer(
    (".xml",), "mmw.worlds.importers.mitsuba.read_mitsuba:read_mitsuba", "Mitsuba and Sionna RT scenes", _PLACED,
    root="scene",
)  # fmt: skip
COMMONROAD = Importer(
    (".xml",),
    "mmw.worlds.importers.commonroad:read_commonroad",
    "CommonRoad: lanelets as roads and lanes (needs the extra author)",
    {},
    root="commonRoad",
)
MESHES = Importer(
    (".glb", ".gltf", ".obj", ".ply", ".stl", ".off"), "mmw.worlds.importers.mesh_files:read_meshes",
    "meshes with their hierarchy and materials", _PLACED,
)  # fmt: skip
USD = Importer(
    (".usd", ".usda", ".usdc", ".usdz"), "mmw.worlds.importers.usd_stage:read_usd",
    "any USD stage at its start time: meshes, materials, labels, lanes",
    {name: _PLACED[name] for name in ("unit", "origin")},
)  # fmt: skip
OPENDRIVE = Importer(
    (".xodr",), "mmw.worlds.importers.opendrive.read_opendrive:read_opendrive",
    "OpenDRIVE: roads, ground and lanes (needs the extra author)",
    {"strict": "refuse what contradicts the standard; else it is mended or left out, with a note"},
)  # fmt: skip
OPENSTREETMAP = Importer(
    (".osm", ".osm.xml", ".osm.bz2", ".osm.gz", ".osm.pbf"), "mmw.worlds.importers.osm.read_osm:read_osm",
    "OpenStreetMap: buildings, streets, trees (needs the extra author, .osm.pbf and --traffic also osm)",
    {
        "terrain": "raster of heights, such as a GeoTIFF, that the ground follows (extra geo)",
        "bbox": "degrees where the extract is cut, west,south,east,north",
        "traffic": "give roads lanes, traffic lights and sidewalks",
        "driving_side": "left or right; told from the map and its place by default",
        "windows": "single, bands or none; single unless there are very many by default",
    },
)  # fmt: skip
SUMO = Importer(
    (".net.xml",), "mmw.worlds.importers.sumo.read_net:read_net",
    "SUMO networks: roads, sidewalks and lanes (needs the extra author)", {},
)  # fmt: skip
_LOD = {"lod": "highest level of detail to read, such as lod=1.2; of each object the highest by default"}
CITYJSON = Importer(
    (".json", ".city.json", ".jsonl", ".city.jsonl"), "mmw.worlds.importers.city.cityjson:read_cityjson",
    "CityJSON and CityJSONSeq: buildings, bridges, terrain (needs the extra author)", _LOD,
)  # fmt: skip
CITYGML = Importer(
    (".gml", ".citygml"), "mmw.worlds.importers.city.citygml:read_citygml",
    "CityGML: buildings, bridges, terrain (needs the extra author)", _LOD,
)  # fmt: skip
TILES = Importer(
    ("tileset.json", ".b3dm"), "mmw.worlds.importers.tiles.read_tiles:read_tiles",
    "3D Tiles: the finest meshes of a tileset's local files", {},
)  # fmt: skip
OVERTURE = Importer(
    (".parquet", ".geoparquet"), "mmw.worlds.importers.overture:read_overture",
    "Overture Maps: buildings on flat ground (needs the extra author)",
    {"parts": "file with the rows of type building_part"},
)  # fmt: skip

_NAMES = (
    "mitsuba", "meshes", "usd", "opendrive", "openstreetmap", "commonroad", "sumo", "cityjson", "citygml", "tiles",
    "overture",
)  # fmt: skip
IMPORTERS: Registry[Importer] = Registry(
    "mmw.importers",
    "importer",
    f"{__name__}:Importer",
    {name: f"{__name__}:{name.upper()}" for name in _NAMES},
)
"""Importers by name."""


def find_importer(path: Path, name: str = "") -> str:
    """Return the name of the importer of a file.

    Args:
        path: The file.
        name: Importer to use whatever the suffix; empty to choose by the suffix.

    Raises:
        InputError: If there is no importer of this name or suffix, or two have the same suffix.
    """
    if name:
        if name not in IMPORTERS:
            raise InputError(f"importer {name!r}: is not known; give one of {', '.join(IMPORTERS)}")
        return name
    ending = {
        each: max((s for s in IMPORTERS[each].suffixes if path.name.lower().endswith(s)), key=len, default="")
        for each in IMPORTERS
    }
    suffix = max(ending.values(), key=len)
    if not suffix:
        known = ", ".join(suffix for each in IMPORTERS.values() for suffix in each.suffixes)
        raise InputError(f"{path}: {path.suffix or 'a file without a suffix'} is not read; give one of {known}")
    found = [each for each, own in ending.items() if own == suffix]
    if len(found) > 1 and all(IMPORTERS[each].root for each in found):
        tag = root_tag(path)
        found = [each for each in found if IMPORTERS[each].root == tag] or found[:1]
    if len(found) > 1:
        owners = " and ".join(f"{each} of {IMPORTERS.owner(each)}" for each in found)
        raise InputError(f"{path}: {suffix} is read by {owners}; choose one with --importer, or remove the other")
    return found[0]


def root_tag(path: Path) -> str:
    """Return the name of the first element of an XML file, without its namespace; empty if there is none."""
    parser, found = expat.ParserCreate(), []
    parser.StartElementHandler = lambda tag, _: found.append(tag)
    with suppress(OSError, expat.ExpatError, ValueError, LookupError), path.open("rb") as file:
        while not found and (data := file.read(4096)):
            parser.Parse(data)
    return found[0].rpartition(":")[2] if found else ""


def read_scene(path: Path, name: str = "", **options: Any) -> ImportedScene:
    """Read a file by its importer.

    Args:
        path: The file.
        name: Importer to use; empty to choose by the suffix.
        options: Options of the importer, by the names of `Importer.options`; false ones count as not given.

    Raises:
        InputError: If no importer fits, an option does not go with it, or the file cannot be used.
    """
    importer = IMPORTERS[find_importer(path, name)]
    given = {option: value for option, value in options.items() if value}
    refused = [option for option in given if option not in importer.options]
    if refused:
        flags = ", ".join(f"--{option}" if option in FLAGS else option for option in refused)
        known = f"options are: {', '.join(importer.options)}" if importer.options else "their files say this themselves"
        raise InputError(f"{path}: {flags}: no option of {', '.join(importer.suffixes)} files; {known}; remove {flags}")
    if "unit" in given:
        given["unit_m"] = UNITS[given.pop("unit")]
    return load_reference(importer.read)(path, **given)
