"""What a configuration asks for, before anything is traced: inputs that must exist, frames, rays and bytes."""

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from pxr import Usd

from mmw.config import (
    ChannelConfig,
    Config,
    ConfigError,
    DepthCamera,
    Gnss,
    Imu,
    Lidar,
    Radar,
    RgbCamera,
    ScenarioConfig,
)
from mmw.config.scenario import TOWN_SUFFIXES
from mmw.core.errors import InputError
from mmw.core.resources import town_path
from mmw.generation.progress import si
from mmw.physics.materials.permittivity import RADIO_ROWS
from mmw.physics.weather.weather import choose_variant
from mmw.sensors.radar.simulate import ray_count
from mmw.storage.schemas import TABLES
from mmw.traffic.sumo.engine import check_sumo
from mmw.usd.actors import find_actors
from mmw.usd.material_map import unknown_names
from mmw.usd.open_stage import open_stage

FRAMED_TABLES = sum(table.framed for table in TABLES.values())

LIDAR_BYTES_PER_RAY = 4.65
"""Bytes of one LiDAR ray in the tables, misses included: 29.16 GB for 209,400 sweeps of 30,016 rays of `full.yaml`;
dual returns take up to 1.6 times as much."""

DEPTH_BYTES_PER_PIXEL = 0.1
"""Bytes of one depth pixel as 16-bit PNG: 28 to 32 kB for an image of 640 x 480 on town03."""

DEPTH_FLOAT_BYTES_PER_PIXEL = 0.9
"""Bytes of one depth pixel before rounding, `format: float32`: 275 kB for an image of 640 x 480 on town03."""

RGB_BYTES_PER_PIXEL = {"jpeg": 0.22, "png": 0.95}
"""Bytes of one RGB pixel, at the default quality: 46.31 GB for 685,500 images of 640 x 480 of `full.yaml`; PNG takes
4.3 times as much (648 images of eight scenarios in four towns)."""

NORMALS_BYTES_PER_PIXEL, FLOW_BYTES_PER_PIXEL = 0.1, 0.6
"""Bytes of one pixel of normals and of flow."""

SEGMENTATION_BYTES_PER_PIXEL = 0.06
"""Bytes of one pixel in both segmentation images: 17 to 20 kB for 640 x 480 on town03."""

RADAR_BYTES_PER_RAY = {"compat": 8.8, "dense": 24.0}
"""Bytes of one radar ray where rays are stored, misses included, measured on town03."""

MAP_PIXEL_BYTES, IQ_SAMPLE_BYTES = 4.0, 8.0
"""Bytes of a pixel of a radar map, float32, and of a sample, complex64."""

BOXES_2D_PER_VIEW = 0.2
"""Share of the boxed actors that one camera frames, measured on town03."""

PATH_BYTES = 134.0
"""Bytes of one radio path at one carrier, measured on town03."""

PATHS_PER_LINK = 2.5
"""Paths of a link at first order, measured on town03; a link without any counts too. Every order more adds one."""

BENT_PATHS_PER_LINK = 118.0
"""Diffracted paths of a link at first order, measured on town03; every order more makes 3.3 times as many."""

PATCHES_PER_RAY = 0.4
"""Diffuse paths of a link for each of `channel.diffuse_rays` and order; rough ground below a mast gives 0.38."""

ROW_BYTES = {"poses": 80.0, "boxes": 60.0, "imu": 70.0, "gnss": 48.0, "links": 25.0, "boxes_2d": 20.0, "radar": 3_000.0}
"""Bytes of one row of the small tables, measured on town03; of `radar`, which holds detections, on eight scenarios."""

FILE_BYTES = 12_000.0
"""Bytes of a Parquet file without rows: schema with units and meanings, and statistics; 6 to 27 kB by table."""


def scenario_source(scenario: ScenarioConfig, base: Path) -> Path:
    """Return the USD file that a scenario starts from: its town asset or the user's own stage.

    A town is a shipped name, or a path relative to `base`, the configuration file's folder.

    Raises:
        InputError: If the file does not exist.
    """
    if scenario.stage is not None:
        path = base / scenario.stage
        if not path.is_file():
            raise InputError(
                f"scenario {scenario.name!r}: stage = {scenario.stage!r}: no such file ({path}); give a USD file"
            )
        return path
    town = scenario.town or ""
    if is_town_file(scenario):
        path = base / town
        if not path.is_file():
            raise InputError(
                f"scenario {scenario.name!r}: town = {town!r}: no such file ({path}); give an existing town asset"
            )
        return path
    try:
        return town_path(town)
    except InputError as error:
        raise InputError(f"scenario {scenario.name!r}: {error}") from None


def is_town_file(scenario: ScenarioConfig) -> bool:
    """Return whether a scenario's town is a file of the user's rather than a shipped town's name."""
    return scenario.town is not None and scenario.town.endswith(TOWN_SUFFIXES)


def trajectory_file(scenario: ScenarioConfig, base: Path) -> Path | None:
    """Return the table of a scenario's recorded vehicles; None if its traffic is generated.

    Raises:
        InputError: If the file does not exist.
    """
    if scenario.traffic is None or scenario.traffic.trajectories is None:
        return None
    path = base / scenario.traffic.trajectories
    if not path.is_file():
        raise InputError(
            f"scenario {scenario.name!r}: traffic.trajectories = {scenario.traffic.trajectories!r}: no such file "
            f"({path}); give a .parquet, .csv or .xml table"
        )
    return path


def check_inputs(config: Config, base: Path) -> None:
    """Check everything that can be checked before traffic runs: files, weathers of towns, names of materials.

    Raises:
        ConfigError: With one line for each problem.
    """
    problems = []
    variants_of = functools.cache(weather_variants)  # scenarios share towns
    for scenario in config.scenarios:
        where = f"scenario {scenario.name!r}"
        try:
            _check_source(scenario, scenario_source(scenario, base), config.variants, variants_of)
        except InputError as error:
            problems.append(str(error))
        try:
            trajectory_file(scenario, base)
        except InputError as error:
            problems.append(str(error))
        if scenario.traffic is not None and scenario.traffic.engine == "sumo":
            try:
                check_sumo()
            except InputError as error:
                problems.append(f"{where}: traffic.{error}")
        for pattern, entry in scenario.material_map.items():
            problems += unknown_names(f"{where}: material_map[{pattern!r}]", entry, RADIO_ROWS)
        if config.channel.enabled and "v2i" in config.channel.links and scenario.town and not scenario.rsus:
            problems.append(
                f"{where}: channel.links = {list(config.channel.links)} has v2i but there are no rsus; add one, or use "
                "channel.links: [v2v]"
            )
    if problems:
        raise ConfigError(problems)


def _check_source(
    scenario: ScenarioConfig,
    source: Path,
    variants: Mapping[str, Sequence[str]],
    variants_of: Callable[[Path], list[str]],
) -> None:
    """Open a stage or town without its payloads, and look for a variant of a town for each weather.

    Raises:
        InputError: If USD cannot read the file, or the town has no variant for a weather.
    """
    key, value = ("stage", scenario.stage) if scenario.stage is not None else ("town", scenario.town)
    try:
        known = variants_of(source)
    except InputError as error:
        raise InputError(f"scenario {scenario.name!r}: {key} = {value!r}: {error}") from None
    for weather, names in variants.items() if scenario.town is not None and known else ():
        if choose_variant(names, known) is None:
            raise InputError(
                f"weathers holds {weather!r}: {value} has the variants {', '.join(known)}, none of {', '.join(names)}; "
                f"set air.{weather}.variant to one that it has"
            )


def weather_variants(source: Path) -> list[str]:
    """Return the weather variants of a town or stage; none if its default prim has no such variant set.

    Raises:
        InputError: If USD cannot read the file.
    """
    stage = open_stage(source, Usd.Stage.LoadNone)  # its prims live as long as it does
    root = stage.GetDefaultPrim()
    return root.GetVariantSet("weather").GetVariantNames() if root else []


def agent_counts(scenario: ScenarioConfig, base: Path) -> dict[str, int]:
    """Return how many CAVs, roadside units, vehicles (CAVs included) and boxes a scenario has.

    Raises:
        InputError: If a stage of the user's own cannot be read, or `actor_roles` does not fit it.
    """
    if scenario.traffic is not None:
        parked = find_actors(Usd.Stage.Open(str(scenario_source(scenario, base))), {})  # they belong to the town
        boxed = scenario.traffic.vehicle_count + scenario.traffic.pedestrian_count + len(parked)
        counts = {
            "cav": len(scenario.traffic.cav_ids or scenario.traffic.cav_ranks),
            "rsu": 0,
            "vehicles": scenario.traffic.vehicle_count,
            "boxes": boxed,
        }
    else:
        found = find_actors(Usd.Stage.Open(str(scenario_source(scenario, base))), scenario.actor_roles)
        roles = [actor.role for actor in found]
        boxed = len(roles) - roles.count("rsu")
        counts = {
            "cav": roles.count("cav"),
            "rsu": roles.count("rsu"),
            "vehicles": boxed - roles.count("pedestrian"),
            "boxes": boxed,
        }
    return {**counts, "rsu": counts["rsu"] + len(scenario.rsus)}


def describe_plan(config: Config, base: Path, device: str) -> str:
    """Return the text of `--dry-run`: frames, rays and bytes of every scenario, and where they would go.

    Raises:
        InputError: If a stage of the user's own cannot be read.
    """
    lines = [
        f"{len(config.scenarios)} scenario(s) x {len(config.weathers)} weather(s), "
        f"{config.frame_total} frames in all on {device}"
    ]
    total_rays = total_bytes = 0.0
    for scenario in config.scenarios:
        counts = agent_counts(scenario, base)
        rays, size = frame_cost(config, counts)
        frame_rays = sum(rays.values())
        frame_count = config.frames_of(scenario).count
        shards = -(-frame_count // config.output.shard_frames)
        total_rays += frame_rays * frame_count
        total_bytes += (size * frame_count + shards * FRAMED_TABLES * FILE_BYTES) * len(config.weathers)
        each = ", ".join(f"{name} {si(count).strip()}" for name, count in rays.items())
        lines.append(
            f"  {scenario.name}: {scenario_source(scenario, base).name}, {counts['cav']} CAV + {counts['rsu']} RSU "
            f"among {counts['vehicles']} vehicles, {si(frame_rays)}rays a frame" + (f" ({each})" if each else "")
        )
    if config.channel.enabled and config.channel.candidates == "exhaustive":
        lines.append("  channel: no rays; every surface is tried for every link")
    lines.append(
        f"total: {si(total_rays)}rays traced once for all weathers, tables of about {si(total_bytes)}B "
        f"in {config.output.dir}"
    )
    return "\n".join(lines)


def frame_cost(config: Config, counts: Mapping[str, int]) -> tuple[dict[str, int], float]:
    """Return the rays of each sensor and of the channel in one frame, and the bytes of its rows in one weather.

    Args:
        config: The configuration.
        counts: What `agent_counts` returns.
    """
    rays: dict[str, int] = {}
    size = (counts["cav"] + counts["rsu"]) * ROW_BYTES["poses"] + counts["boxes"] * ROW_BYTES["boxes"]
    for sensor in config.sensors:
        agents = sum(counts[role] for role in sensor.on)
        if isinstance(sensor, Lidar):
            rays[sensor.name] = agents * sensor.channels * sensor.points_per_channel
            size += rays[sensor.name] * LIDAR_BYTES_PER_RAY
        elif isinstance(sensor, DepthCamera | RgbCamera):
            views = agents / (sensor.every_frames if isinstance(sensor, RgbCamera) else 1)
            rays[sensor.name] = round(views * sensor.width_px * sensor.height_px)
            size += rays[sensor.name] * _bytes_per_pixel(sensor)
            if sensor.boxes_2d:
                size += views * BOXES_2D_PER_VIEW * counts["boxes"] * ROW_BYTES["boxes_2d"]
        elif isinstance(sensor, Radar):
            rays[sensor.name] = agents * ray_count(sensor)
            stored = "compat" if sensor.mode == "compat" else sensor.output
            if stored in RADAR_BYTES_PER_RAY:
                size += rays[sensor.name] * RADAR_BYTES_PER_RAY[stored]
            else:
                size += agents * ROW_BYTES["radar"]
            size += agents * _radar_extra_bytes(sensor)
        elif isinstance(sensor, Imu):
            size += agents * ROW_BYTES["imu"]
        elif isinstance(sensor, Gnss):
            size += agents * ROW_BYTES["gnss"] / sensor.period_frames
    if config.channel.enabled:
        channel = config.channel
        half = 0.5 if channel.is_reciprocal else 1.0  # the ends of a pair share the rays
        senders, links = 0.0, 0
        if "v2i" in channel.links:
            senders, links = float(counts["rsu"]), counts["rsu"] * counts["cav"]
        if "v2v" in channel.links and counts["cav"] > 1:
            senders, links = senders + half * counts["cav"], links + counts["cav"] * (counts["cav"] - 1)
        if channel.candidates == "launch":
            rays["channel"] = int(senders * channel.rays)
        size += links * len(config.channel.carriers_hz) * (ROW_BYTES["links"] + _paths(config.channel) * PATH_BYTES)
    return rays, size


def _bytes_per_pixel(sensor: DepthCamera | RgbCamera) -> float:
    """Return the bytes of one pixel of a camera in all its images."""
    if isinstance(sensor, RgbCamera):
        size = RGB_BYTES_PER_PIXEL[sensor.format]
        size += sensor.normals * NORMALS_BYTES_PER_PIXEL + sensor.flow * FLOW_BYTES_PER_PIXEL
    else:
        size = DEPTH_BYTES_PER_PIXEL + (sensor.format == "float32") * DEPTH_FLOAT_BYTES_PER_PIXEL
    if sensor.segmentation:
        size += SEGMENTATION_BYTES_PER_PIXEL
    return size


def _radar_extra_bytes(sensor: Radar) -> float:
    """Return the bytes of the maps and samples of one view of a radar; noise does not compress."""
    columns = {"range_azimuth": sensor.azimuth_antennas, "range_doppler": sensor.chirps}
    pixels = sum(columns[kind] for kind in sensor.maps) * (sensor.range_cells + 1)
    return pixels * MAP_PIXEL_BYTES + (math.prod(sensor.iq_shape) * IQ_SAMPLE_BYTES if sensor.iq else 0.0)


def _paths(channel: ChannelConfig) -> float:
    """Return how many paths a link has, about."""
    order = channel.max_depth
    count = PATHS_PER_LINK + max(order - 1, 0)
    if channel.diffraction and order:
        count += BENT_PATHS_PER_LINK * 3.3 ** (order - 1)
    if channel.diffuse:
        count += PATCHES_PER_RAY * channel.diffuse_rays * order
    return count
