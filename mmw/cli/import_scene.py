"""`mmw import`: a world of another tool becomes a town asset."""

import argparse
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from mmw.cli.command import add_log_options, run_command
from mmw.core.errors import InputError
from mmw.physics.materials.permittivity import RADIO_ROWS
from mmw.worlds.importers import mesh_files, usd_stage
from mmw.worlds.importers.imported_scene import World
from mmw.worlds.importers.material_map import apply_material_map, load_material_map
from mmw.worlds.importers.mesh_cleanup import UNITS, bounds, check_world, identifier
from mmw.worlds.importers.mitsuba.reader import read_mitsuba
from mmw.worlds.importers.write_asset import asset_files, write_world

NO_OPTIONS = (".xodr", ".osm", ".osm.xml")
"""Formats that define their axes and units."""

KNOWN = (".xml (Mitsuba, Sionna)", *mesh_files.SUFFIXES, *usd_stage.SUFFIXES, *NO_OPTIONS)

TALLEST_M = 500.0
"""A world that is higher is noted, for it may be one in centimetres [m]; design value, over most skyscrapers."""


def main(argv: Sequence[str], prog: str = "mmw import") -> int:
    """Run `mmw import` and return its exit code."""
    parser = argparse.ArgumentParser(
        prog=prog,
        description="Make a town asset, a USD file, of a world from another tool, and say what came out and what to do "
        "next.",
        epilog="OpenDRIVE and OpenStreetMap need the extra author; their files say axes and units themselves. "
        "Exit codes: 0 done, 2 a file or an option that cannot be used, 1 failure while running.",
    )
    parser.add_argument("file", type=Path, help=f"world to import: {', '.join(KNOWN)}")
    parser.add_argument("--out", type=Path, required=True, help="folder for the asset, or its .usda file")
    parser.add_argument(
        "--materials", type=Path, metavar="MAP", help="material map, a YAML file (docs/guides/import.md)"
    )
    parser.add_argument("--up", choices=("y", "z"), default="", help="axis that points up; the format's by default")
    parser.add_argument("--unit", choices=tuple(UNITS), default="", help="unit of the file; the format's by default")
    parser.add_argument(
        "--origin", type=float, nargs=3, default=(0.0, 0.0, 0.0), metavar=("X", "Y", "Z"),
        help="point of the world, z up, in metres, that becomes the origin",
    )  # fmt: skip
    parser.add_argument("--overwrite", action="store_true", help="replace an asset that is there")
    arguments = add_log_options(parser).parse_args(argv)

    def work() -> int:
        print("\n".join(import_world(arguments)))
        return 0

    return run_command(work, prog, debug=arguments.debug)


def import_world(arguments: argparse.Namespace) -> list[str]:
    """Import a file and return what came out, for people.

    Args:
        arguments: `file`, `out`, `materials`, `up`, `unit`, `origin` and `overwrite` of the command.

    Raises:
        InputError: If the file or the material map cannot be used, or a file would be replaced.
    """
    source = arguments.file
    name = identifier(source.name.split(".")[0])
    files = asset_files(arguments.out, name)
    if source.resolve() in files:
        raise InputError(f"{source}: --out would replace the file that is imported; give another --out")
    entries = load_material_map(arguments.materials, RADIO_ROWS) if arguments.materials else {}
    world = read_world(source, arguments.up, arguments.unit, arguments.origin)
    check_world(str(source), world)
    world = apply_material_map(str(source), world, entries, RADIO_ROWS)
    path = write_world(world, arguments.out, name, overwrite=arguments.overwrite)
    return [*describe(world), *next_step(world, path)]


def read_world(path: Path, up: str = "", unit: str = "", origin: Sequence[float] = (0.0, 0.0, 0.0)) -> World:
    """Return the world that a file holds, by its suffix.

    Args:
        path: The file.
        up: Axis that points up in the file, `y` or `z`; the format's own if empty.
        unit: Unit of the file, a key of `UNITS`; the format's own if empty.
        origin: Point of the world [m] that becomes (0, 0, 0).

    Raises:
        InputError: If the format is unknown, an option does not go with it, or the file cannot be used.
    """
    suffix = ".osm.xml" if path.name.lower().endswith(".osm.xml") else path.suffix.lower()
    given = [option for option, value in (("--up", up), ("--unit", unit), ("--origin", any(origin))) if value]
    refused = given if suffix in NO_OPTIONS else ["--up"] if suffix in usd_stage.SUFFIXES and up else []
    if refused:
        raise InputError(f"{path}: {suffix} files say this themselves; remove {', '.join(refused)}")
    unit_m = UNITS.get(unit, 0.0)
    if suffix == ".xml":
        return read_mitsuba(path, up=up or "z", unit_m=unit_m or 1.0, origin=origin)
    if suffix in mesh_files.SUFFIXES:
        return mesh_files.read_meshes(path, up=up, unit_m=unit_m, origin=origin)
    if suffix in usd_stage.SUFFIXES:
        return usd_stage.read_usd(path, unit_m=unit_m, origin=origin)
    if suffix == ".xodr":
        from mmw.worlds.importers.opendrive.reader import read_opendrive

        return read_opendrive(path)
    if suffix in NO_OPTIONS:
        from mmw.worlds.importers.osm.reader import read_osm

        return read_osm(path)
    raise InputError(f"{path}: {suffix or 'a file without a suffix'} is not read; give one of {', '.join(KNOWN)}")


def describe(world: World) -> list[str]:
    """Return bounds, triangles, materials, labels, lanes and notes of a world, one line each."""
    low, high = bounds(world)
    faces = sum(len(part.faces) for part in world.parts)
    ends = " to ".join("({:.2f}, {:.2f}, {:.2f})".format(*corner) for corner in (low, high))
    size = " x ".join(f"{length:.2f}" for length in high - low)
    lines = [f"bounds: {ends} m, {size} m", f"{faces:,} triangles in {len(world.parts):,} meshes"]
    triangles: Counter[str] = Counter()
    for part in world.parts:
        triangles[part.material] += len(part.faces)
    for name, count in triangles.most_common():
        lines.append(f"material {name}: {count:,} triangles, {_radio_text(world, name)}")
    labels = Counter(part.label for part in world.parts)
    lines.append("labels: " + ", ".join(f"{label} {count:,}" for label, count in labels.most_common()))
    if labels["unlabeled"]:
        lines.append(
            f"note: {labels['unlabeled']:,} meshes have no semantic class; `label` in a material map gives one"
        )
    lines.append(f"lanes: {len(world.lanes.lanes):,}" if world.lanes else "lanes: none")
    if (high - low)[2] > TALLEST_M:
        lines.append(
            f"note: {(high - low)[2]:.0f} m high; if its unit is no metre, say so with --unit (cm, mm, in, ft)"
        )
    return lines + [f"note: {note}" for note in world.notes]


def _radio_text(world: World, name: str) -> str:
    if name not in world.materials:
        return "of the library"
    radio = world.materials[name].radio
    if radio is None:
        return "no radio material"
    constant = f"relative permittivity {radio.relative_permittivity:g}, conductivity {radio.conductivity:g} S/m"
    slab = f"slab of {radio.thickness:g} m" if radio.thickness else "half-space"
    return f"{radio.itu or constant}, {slab}"


def next_step(world: World, path: Path) -> list[str]:
    """Return what to do with an imported world, with the lines of a configuration."""
    low, high = bounds(world)
    centre = ", ".join(f"{value:.0f}" for value in (*(0.5 * (low + high))[:2], low[2]))
    lines = [f"wrote {path}", f"next: mmw town check {path}"]
    if world.lanes is None:
        return [
            *lines,
            "no lanes, so nothing drives by itself: refer to it from an animated stage (docs/guides/import.md), or",
            "  scenarios:",
            f"    - name: {path.stem}",
            f"      town: {path}",
            f"      traffic: {{engine: file, trajectories: drives.csv, spawn_center_m: [{centre}]}}",
        ]
    start = next(iter(world.lanes.lanes.values())).points[0]
    centre = ", ".join(f"{value:.0f}" for value in start)
    return [
        *lines,
        "  scenarios:",
        f"    - name: {path.stem}",
        f"      town: {path}",
        f"      traffic: {{vehicle_count: 20, spawn_center_m: [{centre}]}}",
        f"      rsus: [{{name: rsu_1, position_m: [{centre}]}}]  # beside the road",
    ]
