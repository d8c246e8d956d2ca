"""Convert a scene of another tool to a town asset: `mmw import`."""

import argparse
import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import yaml

from mmw.cli.command import run_command
from mmw.cli.first_scenario import first_scenario
from mmw.core.errors import InputError
from mmw.core.registry import load_reference
from mmw.worlds.importers.blocks.mixes import MIXES, load_mix
from mmw.worlds.importers.formats import IMPORTERS, UNITS, find_importer, read_scene
from mmw.worlds.importers.geo.placing import place_scene
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.importers.material_map import apply_material_map, load_material_map
from mmw.worlds.importers.mesh_cleanup import bounds, check_scene, identifier
from mmw.worlds.importers.write_asset import asset_files, write_scene

MAX_HEIGHT_M = 500.0
"""A scene that is higher is noted, for its unit may be centimeters [m]; design value, over most skyscrapers."""


def main(argv: Sequence[str], prog: str = "mmw import") -> int:
    """Run `mmw import` and return its exit code."""
    return run_command(import_parser(prog), _import, argv, intermixed=True)


def import_parser(prog: str) -> argparse.ArgumentParser:
    """Return the parser of the command's options."""
    parser = argparse.ArgumentParser(
        prog=prog,
        description="Convert a scene of another tool to a USD town asset, and print its contents and the next step.",
        epilog="docs/guides/import.md describes every format. Exit codes: 0 done, 2 a file or an option that cannot be "
        "used, 1 failure while running.",
    )
    parser.add_argument("file", type=Path, nargs="?", help="file to import; --list prints the formats")
    parser.add_argument(
        "values", nargs="*", metavar="file or name=value",
        help="an .osm file that is merged around the roads of an .xodr file; options of the importer",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, help="folder for the asset, or its .usda file; needed")
    parser.add_argument("--importer", default="", metavar="NAME", help="importer; chosen by the suffix by default")
    parser.add_argument("--list", action="store_true", help="print the importers, their suffixes and their options")
    parser.add_argument(
        "--materials", type=Path, metavar="MAP", help="material map, a YAML file (docs/guides/import.md)"
    )
    parser.add_argument("--up", choices=("y", "z"), default="", help="axis that points up; the format's by default")
    parser.add_argument("--unit", choices=tuple(UNITS), default="", help="unit of the file; the format's by default")
    parser.add_argument(
        "--origin", type=float, nargs=3, metavar=("X", "Y", "Z"),
        help="point of the scene, z up, in meters, that becomes the origin",
    )  # fmt: skip
    parser.add_argument(
        "--terrain", default="", metavar="RASTER", help="heights that the ground follows, a GeoTIFF (.osm, extra geo)"
    )
    parser.add_argument(
        "--buildings", default="", metavar="MIX",
        help=f"fill the land along the roads with sidewalks, buildings and trees: {', '.join(MIXES)} or a YAML file",
    )  # fmt: skip
    parser.add_argument("--seed", type=int, help="seed of --buildings; 1 by default")
    parser.add_argument(
        "--geo-origin", type=float, nargs=2, metavar=("LATITUDE", "LONGITUDE"),
        help="place of (0, 0) on the earth, x east and y north there; that of the file by default",
    )  # fmt: skip
    parser.add_argument("--strict", action="store_true", help="refuse faults of the file that would be mended (.xodr)")
    parser.add_argument(
        "--bbox", default="", metavar="WEST,SOUTH,EAST,NORTH", help="degrees where an OpenStreetMap extract is cut"
    )
    parser.add_argument("--traffic", action="store_true", help="give the roads of an OpenStreetMap extract lanes")
    parser.add_argument("--overwrite", action="store_true", help="replace an asset that is there")
    return parser


def _import(arguments: argparse.Namespace) -> None:
    print("\n".join(list_importers() if arguments.list else import_file(arguments)))


def list_importers() -> list[str]:
    """Return the importers with their suffixes and options, one line each."""
    lines = []
    for name, importer in IMPORTERS.items():
        owner = IMPORTERS.owner(name)
        source = "" if owner == "mmw" else f" (from {owner})"
        lines.append(f"{name}: {', '.join(importer.suffixes)}: {importer.help}{source}")
        lines += [f"  {option}: {effect}" for option, effect in importer.options.items()]
    return lines


def import_file(arguments: argparse.Namespace) -> list[str]:
    """Import a file and return a description of the asset and of the next steps, one line each.

    Args:
        arguments: Arguments of the command.

    Raises:
        InputError: If the file, an option or the material map cannot be used, or a file would be replaced.
    """
    scene, name = read_world(arguments)
    path = write_scene(scene, arguments.out, name, overwrite=arguments.overwrite)
    return [*describe(scene), *next_step(scene, path)]


def asset_name(source: Path) -> str:
    """Return the name of the asset that a file becomes."""
    return identifier(source.name.split(".")[0])


def read_world(arguments: argparse.Namespace) -> tuple[ImportedScene, str]:
    """Return the world that the arguments of the command ask for, ready to be written, and the name of its asset.

    Raises:
        InputError: If a file, an option or the material map cannot be used, or a file would be replaced.
    """
    source = arguments.file
    if source is None or arguments.out is None:
        raise InputError("import: FILE and --out are needed; give both, or --list")
    sources = _sources([source, *(Path(text) for text in arguments.values if "=" not in text)])
    source = sources[0]
    pairs = [text.partition("=") for text in arguments.values if "=" in text]
    if wrong := [name for name, equals, value in pairs if not equals or not value]:
        raise InputError(f"import: {wrong[0]!r}: name=value is needed; write OPTION=VALUE")
    if arguments.origin and not all(map(math.isfinite, arguments.origin)):
        raise InputError(
            f"import: --origin {' '.join(map(str, arguments.origin))}: finite numbers are needed; give three"
        )
    if arguments.seed is not None and not (arguments.buildings and arguments.seed >= 0):
        raise InputError(f"import: --seed {arguments.seed}: goes with --buildings and is 0 or more; correct it")
    mix = load_mix(arguments.buildings, arguments.seed) if arguments.buildings else None
    name = asset_name(source)
    if {path.resolve() for path in sources} & set(asset_files(arguments.out, name)):
        raise InputError(f"{source}: --out would replace the file that is imported; give another --out")
    entries = load_material_map(arguments.materials) if arguments.materials else {}
    names = ("up", "unit", "origin", "strict", "terrain", "bbox", "traffic")
    options = {option: getattr(arguments, option) for option in names}
    scene = read_scene(source, arguments.importer, **options, **{option: value for option, _, value in pairs})
    check_scene(str(source), scene)
    scene = place_scene(scene, arguments.geo_origin)
    for extract in sources[1:]:
        scene = load_reference("mmw.worlds.importers.geo.merge:merge_extract")(scene, extract)
    scene = apply_material_map(str(source), scene, entries)
    if mix is not None:
        scene = load_reference("mmw.worlds.importers.blocks.fill_blocks:fill_blocks")(str(source), scene, mix)
    return scene, name


def _sources(paths: list[Path]) -> list[Path]:
    """Return the files to import, roads before what is merged around them.

    Raises:
        InputError: If several files are not one OpenDRIVE file and OpenStreetMap extracts.
    """
    if len(paths) == 1:
        return paths
    kinds = {path: find_importer(path) for path in paths}
    if [*kinds.values()].count("opendrive") != 1 or set(kinds.values()) != {"opendrive", "openstreetmap"}:
        raise InputError(
            f"import: {', '.join(path.name for path in paths)}: of several files one is OpenDRIVE (.xodr), the "
            "others are OpenStreetMap (.osm); import others one by one"
        )
    return sorted(kinds, key=lambda path: kinds[path] != "opendrive")


def describe(scene: ImportedScene) -> list[str]:
    """Return bounds, triangles, materials, labels, lanes and notes of a scene, one line each."""
    low, high = bounds(scene)
    faces = sum(len(part.faces) for part in scene.parts)
    ends = " to ".join("({:.2f}, {:.2f}, {:.2f})".format(*corner) for corner in (low, high))
    size = " x ".join(f"{length:.2f}" for length in high - low)
    lines = [f"bounds: {ends} m, {size} m", f"{faces:,} triangles in {len(scene.parts):,} meshes"]
    triangles: Counter[str] = Counter()
    for part in scene.parts:
        triangles[part.material] += len(part.faces)
    for name, count in triangles.most_common():
        lines.append(f"material {name}: {count:,} triangles, {_radio_text(scene, name)}")
    labels = Counter(part.label for part in scene.parts)
    lines.append("labels: " + ", ".join(f"{label} {count:,}" for label, count in labels.most_common()))
    if labels["unlabeled"]:
        lines.append(
            f"note: {labels['unlabeled']:,} meshes have no semantic class; `label` in a material map gives one"
        )
    lines.append(f"lanes: {len(scene.lanes.lanes):,}" if scene.lanes else "lanes: none")
    if (high - low)[2] > MAX_HEIGHT_M:
        lines.append(
            f"note: {(high - low)[2]:.0f} m high; if its unit is no meter, say so with --unit (cm, mm, in, ft)"
        )
    return lines + [f"note: {note}" for note in scene.notes]


def _radio_text(scene: ImportedScene, name: str) -> str:
    if name not in scene.materials:
        return "of the library"
    radio = scene.materials[name].radio
    if radio is None:
        return "no radio material"
    constant = f"relative permittivity {radio.relative_permittivity:g}, conductivity {radio.conductivity:g} S/m"
    slab = f"slab of {radio.thickness:g} m" if radio.thickness else "half-space"
    return f"{radio.itu or constant}, {slab}"


def next_step(scene: ImportedScene, path: Path) -> list[str]:
    """Return what to do with an imported scene, with the lines of a configuration."""
    low, high = bounds(scene)
    lines = [f"wrote {path}", f"next: mmw town check {path}"]
    first = first_scenario(scene)
    if first is not None:
        entry = yaml.safe_dump([first.entry(path.stem, str(path))], default_flow_style=None, sort_keys=False)
        lines += ["  scenarios:", *(f"    {line}" for line in entry.splitlines())]
        if first.mast is None:
            lines += ["note: no place for a roadside unit was found (needs the extra author); give `rsus` one"]
        return lines
    start, traffic = (*(0.5 * (low + high))[:2], low[2]), "engine: replay, trajectories: drives.csv"
    if scene.lanes is None:
        lines += ["no lanes, so no simulated traffic: refer to it from an animated stage (docs/guides/import.md), or"]
    else:
        lines += ["no lane is long enough for simulated traffic (21 m are needed); trajectories can be replayed:"]
    center = ", ".join(f"{round(value)}" for value in start)
    lines += ["  scenarios:", f"    - name: {path.stem}", f"      town: {path}"]
    return [*lines, f"      traffic: {{{traffic}, spawn_center_m: [{center}]}}"]
