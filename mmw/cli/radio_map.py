"""Trace path gain, RSS and SINR of a scenario's roadside units, as a table and a picture: `mmw radiomap`.

Exit codes: 0 done, 2 bad configuration or input (one line a problem), 1 failure while running.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from mmw import __version__
from mmw.channel.radio_map.radio_map import RadioMap, RadioMapConfig
from mmw.channel.radio_map.scene_surface import PLANE, ROADS, scene_surface
from mmw.channel.radio_map.solver import solve_radio_map
from mmw.channel.radio_map.table import RADIO_MAP
from mmw.channel.radio_map.transmitters import actor_transmitters
from mmw.cli.command import run_command
from mmw.config import Config, ScenarioConfig, config_path, load_config
from mmw.config.sampling import Sampling
from mmw.config.shipped import CONFIG_HELP
from mmw.core.bvh_kind import select_bvh
from mmw.core.device import choose_device, device_name
from mmw.core.errors import InputError
from mmw.core.extras import needed_by
from mmw.generation.estimate import check_inputs
from mmw.generation.progress import si
from mmw.scene.device_scene import DeviceScene
from mmw.scene.prepare import prepare_scenario, read_frame, stored_stage
from mmw.scene.scene_data import SceneData
from mmw.storage.atomic_files import write_bytes_atomically
from mmw.storage.manifest import DATASET
from mmw.storage.parquet_schema import arrow_schema, write_options

CHANNEL_LEFT_OUT = {"enabled", "links", "antennas", "carriers_hz", *Sampling.model_fields}
"""Keys of `channel` that say nothing about the paths of a map: they are not in its metadata."""


def parser(prog: str = "mmw radiomap") -> argparse.ArgumentParser:
    """Return the command line's parser."""
    result = argparse.ArgumentParser(
        prog=prog,
        description="Trace a radio map: path gain, RSS and SINR of a scenario's roadside units over its roads or over "
        "a plane, at one moment, vehicles included.",
        epilog="Paths are those of `channel` of the configuration: interactions, materials and air of its links. "
        "Writes SCENARIO_radio_map.parquet and SCENARIO_radio_map.png (the picture needs the extra plot).",
    )
    result.add_argument("--config", required=True, metavar="FILE", help=CONFIG_HELP)
    result.add_argument("overrides", nargs="*", metavar="key=value", help="replace values of the configuration")
    result.add_argument("--scenario", default="", metavar="NAME", help="scenario; the first by default")
    result.add_argument("--weather", default="", metavar="NAME", help="weather; the configuration's first by default")
    result.add_argument("--frame", type=int, metavar="K", help="frame; the configuration's first by default")
    result.add_argument(
        "--carrier", type=float, metavar="HZ", help="carrier frequency [Hz]; the first of the configuration by default"
    )
    where = result.add_mutually_exclusive_group()
    where.add_argument("--roads", action="store_true", help="measure over the roads, at a height above them (default)")
    where.add_argument("--plane", action="store_true", help="measure on a level plane, its height counted from z = 0")
    result.add_argument("--cell", type=float, default=2.0, metavar="M", help="side of a cell [m]")
    result.add_argument("--height", type=float, default=1.5, metavar="M", help="height of the measuring surface [m]")
    result.add_argument(
        "--size", type=float, metavar="M", help="side of the square about the transmitters [m]; the town by default"
    )
    result.add_argument(
        "--points-per-cell",
        type=_count,
        default=1,
        metavar="N",
        help="points of a cell that the mean is taken over: 1, its middle (default), 4, 9, ...",
    )
    result.add_argument(
        "--depth", type=int, metavar="N", help="most interactions on a path; channel.max_depth by default"
    )
    result.add_argument(
        "--samples-per-tx", type=_count, metavar="N", help="rays of a transmitter; channel.samples_per_tx by default"
    )
    result.add_argument(
        "--refraction",
        action=argparse.BooleanOptionalAction,
        help="follow what passes through slabs; channel.refraction by default",
    )
    result.add_argument(
        "--power", type=float, metavar="DBM", help="power of each transmitter [dBm]; its antenna's by default"
    )
    result.add_argument("--bandwidth", type=float, default=1e6, metavar="HZ", help="bandwidth of the noise [Hz]")
    result.add_argument("--temperature", type=float, default=293.0, metavar="K", help="temperature of the noise [K]")
    result.add_argument("--device", metavar="NAME", help="auto, cpu or cuda:N; compute.device by default")
    result.add_argument("--out", type=Path, default=Path("radio_map"), metavar="DIR", help="folder for the files")
    result.add_argument("--table-only", action="store_true", help="write no picture")
    return result


def _count(text: str) -> int:
    """Return a whole number that may be written as `1e7`."""
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not value.is_integer():
        raise argparse.ArgumentTypeError(f"{text!r}: a whole number is needed, such as 1000000 or 1e6")
    return int(value)


def main(argv: Sequence[str] | None = None, prog: str = "mmw radiomap") -> int:
    """Run the command line and return its exit code."""
    return run_command(parser(prog), run, argv, intermixed=True)


def run(arguments: argparse.Namespace) -> None:
    """Trace and write the radio map of a command line, and print the speed and the files.

    Raises:
        ConfigError: If the configuration cannot be used.
        InputError: If the scenario has no such weather or frame, or no transmitter, or the map is impossible.
        OutOfSpaceError: If the disk is full.
    """
    path = config_path(arguments.config)
    options = {
        "carriers_hz": None if arguments.carrier is None else [arguments.carrier],
        "max_depth": arguments.depth,
        "samples_per_tx": arguments.samples_per_tx,
        "refraction": arguments.refraction,
    }
    patch: dict[str, Any] = {f"channel.{name}": value for name, value in options.items() if value is not None}
    if arguments.weather:
        patch["weathers"] = [arguments.weather]
    config = load_config(path, arguments.overrides, patch)
    config.check_single("a radio map")
    channel = config.channel
    map_config = RadioMapConfig(channel, arguments.points_per_cell, arguments.bandwidth, arguments.temperature)
    map_config.check()
    select_bvh(config.compute.bvh)
    device = choose_device(arguments.device or config.compute.device)
    scenario = config.scenario(arguments.scenario)
    check_inputs(config.model_copy(update={"scenarios": (scenario,)}), path.parent)
    frame = config.frames_of(scenario).start if arguments.frame is None else arguments.frame
    arrays = _arrays(config, scenario, frame, path.parent)
    weather = config.weathers[0]
    transmitters = actor_transmitters(
        arrays,
        frame,
        antennas=channel.antennas,
        power_dbm=arguments.power,
    )
    if arguments.size is not None and not arguments.size > 0.0:
        raise InputError(
            f"--size {arguments.size:g}: it must be above 0 m; give the side of the square, or leave it out"
        )
    surface = scene_surface(
        arrays,
        frame,
        PLANE if arguments.plane else ROADS,
        transmitters.position,
        cell_size_m=arguments.cell,
        height_m=arguments.height,
        size_m=None if arguments.size is None else (arguments.size, arguments.size),
    )
    scene = DeviceScene(arrays, device, 1)
    scene.load_batch([frame])
    began = time.perf_counter()
    result = solve_radio_map(
        scene, 0, transmitters, surface, map_config, arrays.materials[weather], config.air[weather].weather(weather)
    )
    seconds = time.perf_counter() - began
    stem = arguments.out / f"{scenario.name}_radio_map"
    meta = {
        "scenario": scenario.name,
        "weather": weather,
        "frame": frame,
        "surface": PLANE if arguments.plane else ROADS,
        "cell_m": arguments.cell,
        "height_m": arguments.height,
        "power_dbm": transmitters.power_dbm.tolist(),
        "carrier_hz": map_config.carrier_hz,
        "points_per_cell": map_config.points_per_cell,
        "bandwidth_hz": map_config.bandwidth_hz,
        "temperature_k": map_config.temperature_k,
        "channel": channel.model_dump(mode="json", exclude=CHANNEL_LEFT_OUT),
        "config_sha256": config.sha256(),
        "mmw_version": __version__,
        "device": device_name(device),
    }
    power = ", ".join(f"{value:g}" for value in np.unique(transmitters.power_dbm))
    count = len(transmitters) * len(surface)
    print(
        f"{scenario.name}, {weather}, frame {frame}: {len(transmitters)} transmitter(s), "
        f"{len(surface):,} cells in {seconds:.1f} s ({si(count / seconds)}cells/s), {meta['device']}"
    )
    print(write_radio_map(result, stem.with_suffix(".parquet"), meta))
    if not arguments.table_only:
        with needed_by("the picture of a radio map (--table-only leaves it out)"):
            from mmw.viz.plots.radio_map_plot import plot_radio_map

        over = "plane at" if arguments.plane else "roads +"
        plot_radio_map(
            result,
            arrays,
            frame,
            stem.with_suffix(".png"),
            f"{scenario.name}, {weather}, frame {frame}: {map_config.carrier_hz / 1e9:g} GHz, {power} dBm, "
            f"{over} {arguments.height:g} m, depth {channel.max_depth}",
        )
        print(stem.with_suffix(".png"))


def write_radio_map(result: RadioMap, path: Path, meta: dict[str, Any]) -> Path:
    """Write a map as a Parquet file and return its path.

    Raises:
        OutOfSpaceError: If the disk is full.
    """
    schema = arrow_schema(RADIO_MAP, {"mmw.radio_map": json.dumps(meta)})
    table = result.to_table().replace_schema_metadata(schema.metadata)
    sink = pa.BufferOutputStream()
    pq.write_table(table, sink, **write_options(RADIO_MAP))
    write_bytes_atomically(path, memoryview(sink.getvalue()))
    return path


def _arrays(config: Config, scenario: ScenarioConfig, frame: int, base: Path) -> SceneData:
    """Read one frame of the stage of a scenario: a dataset's own, or a temporary one."""
    frames = config.frames_of(scenario)
    if not frames.start <= frame < frames.stop:
        raise InputError(
            f"--frame {frame}: the configuration has frames {frames.start} to {frames.stop - 1}; "
            "give one of them, or frames.count=..."
        )
    with tempfile.TemporaryDirectory(prefix="mmw_radio_map_") as folder:
        is_dataset = (base / DATASET).is_file()
        stage = stored_stage(base, scenario) if is_dataset else prepare_scenario(config, scenario, base, Path(folder))
        return read_frame(config, scenario, stage, frame, config.weathers[0])
