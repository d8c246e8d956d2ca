"""Make a district, its traffic, a roadside unit, a configuration and pictures in one command: `mmw twin`."""

import argparse
from collections.abc import Sequence
from pathlib import Path

import yaml

from mmw.cli.command import run_command
from mmw.cli.first_scenario import FirstScenario, first_scenario
from mmw.cli.import_scene import asset_name, describe, import_parser, read_world
from mmw.config.yaml_file import read_yaml
from mmw.core.errors import InputError
from mmw.core.resources import shipped_configs
from mmw.storage.atomic_files import write_bytes_atomically
from mmw.worlds.importers.formats import IMPORTERS
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.importers.write_asset import asset_files, write_scene

START = "quickstart"
"""Shipped configuration whose weathers, frames, sensors, carriers and compute settings a twin starts with."""

RSU_CAMERA = "front"
"""Its camera that draws the view from the roadside unit."""


def main(argv: Sequence[str], prog: str = "mmw twin") -> int:
    """Run `mmw twin` and return its exit code."""
    parser = argparse.ArgumentParser(
        prog=prog,
        description="Make a world that runs from an OpenStreetMap extract: town, lanes, roadside unit, configuration, "
        "pictures (docs/guides/twin.md). Needs the extras author, osm and plot.",
        epilog="Exit codes: 0 done, 2 a file or an option that cannot be used, 1 failure while running.",
    )
    parser.add_argument("file", type=Path, help="the extract: .osm, .osm.bz2, .osm.gz or .osm.pbf")
    parser.add_argument(
        "values", nargs="*", metavar="name=value", help="options of the importer; mmw import --list prints them"
    )
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder for the files")
    parser.add_argument("--bbox", default="", metavar="WEST,SOUTH,EAST,NORTH", help="degrees where the extract is cut")
    parser.add_argument(
        "--terrain", default="", metavar="RASTER", help="heights that the ground follows, a GeoTIFF (extra geo)"
    )
    parser.add_argument("--samples", type=int, default=4, choices=(1, 4, 9), help="rays in a pixel on an edge")
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda:N, for the pictures")
    parser.add_argument("--overwrite", action="store_true", help="replace files that are there")
    return run_command(parser, _twin, argv, intermixed=True)


def _twin(arguments: argparse.Namespace) -> None:
    print(*make_twin(arguments), sep="\n")


def make_twin(arguments: argparse.Namespace) -> list[str]:
    """Write town, configuration and pictures, and return a description of them and the next steps, one line each.

    Args:
        arguments: Arguments of the command.

    Raises:
        InputError: If the extract or an option cannot be used, no vehicle has a place on its roads, or a file exists.
        MissingPackageError: If an extra is not installed.
    """
    from mmw.viz.stills.image_files import save_jpeg
    from mmw.viz.stills.still import Viewpoint, draw_scenario
    from mmw.viz.stills.town_gallery import MAX_BYTES, draw_town

    source, out, name = arguments.file, arguments.out, asset_name(arguments.file)
    suffixes = IMPORTERS["openstreetmap"].suffixes
    if not source.name.lower().endswith(tuple(suffixes)):
        raise InputError(f"{source}: is no OpenStreetMap extract ({', '.join(suffixes)}); use mmw import for others")
    if (out.exists() and not out.is_dir()) or asset_files(out, name)[0].parent != out.resolve():
        raise InputError(f"{out}: is no folder; give another --out")
    config = out / f"{name}.yaml"
    for file in (*asset_files(out, name), config):
        if file.exists() and not arguments.overwrite:
            raise InputError(f"{file}: is there already; give --overwrite to replace it, or another --out")
    given = [str(source), *arguments.values, f"--out={out}", "--traffic"]
    given += [f"--{key}={value}" for key in ("bbox", "terrain") if (value := getattr(arguments, key))]
    scene, _ = read_world(import_parser("mmw twin").parse_intermixed_args(given))
    first = first_scenario(scene)
    if first is None:
        raise InputError(
            f"{source}: no lane is long enough for a vehicle (21 m are needed); choose another area, or a larger one"
        )
    town = write_scene(scene, out, name, overwrite=arguments.overwrite)
    write_bytes_atomically(config, config_text(scene, first, town, name).encode())
    pictures = draw_town(town, out / "pictures", samples=arguments.samples, device=arguments.device)
    if first.mast is not None:
        view, size = Viewpoint(agent="rsu_1", camera=RSU_CAMERA), {"samples": arguments.samples}
        pictures.append(out / "pictures" / f"{name}_rsu.jpg")
        save_jpeg(draw_scenario(config, view, size, device=arguments.device)[0], pictures[-1], MAX_BYTES)
    return [
        *describe(scene),
        f"traffic: {first.vehicles} vehicles, {first.cavs} of them CAVs, around {first.center}",
        f"roadside unit: {first.mast or 'no place beside the road near there; give `rsus` one'}",
        *(f"wrote {file}" for file in (out / town.name, config, *pictures)),
        f"next: mmw run --config {config} frames.count=2",
        f"      mmw view --still street.png --config {config}",
        f"      mmw town check {out / town.name}",
    ]


def config_text(scene: ImportedScene, first: FirstScenario, town: Path, name: str) -> str:
    """Return the configuration of a twin: that of `START` with the twin's scenario, its place on the earth and folder.

    Args:
        scene: The world.
        first: Places of its first scenario.
        town: Its asset, beside the configuration.
        name: Name of the twin.
    """
    content = read_yaml(shipped_configs()[START], "a configuration")
    content["scenarios"], content["output"] = [first.entry(name, town.name)], {"dir": f"out/{name}"}
    place = scene.georeference
    if place is not None:
        for sensor in content["sensors"]:
            if sensor["type"] == "gnss":
                sensor["reference_latitude_deg"] = round(place.latitude, 7)
                sensor["reference_longitude_deg"] = round(place.longitude, 7)
    lines = [
        f"# {name}: a few frames on a laptop without a GPU. Docs: docs/guides/twin.md, docs/guides/configure.md.",
        *([f"# The town {scene.notice}."] if scene.notice else []),
    ]
    text = yaml.safe_dump(content, default_flow_style=None, sort_keys=False, allow_unicode=True, width=120)
    return "\n".join(lines) + "\n" + text
