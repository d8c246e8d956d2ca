"""Prepare a scenario for tracing: its USD stage, made once and stored with the data, and its arrays."""

import json
import logging
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from mmw import __version__
from mmw.config import Config, ScenarioConfig, TrafficConfig
from mmw.core.errors import InputError
from mmw.core.frame_rate import base_frames
from mmw.core.hashing import sha256
from mmw.core.transforms import pose_from_mount
from mmw.physics.weather.weather import PRESETS, choose_variant
from mmw.scene.geographic_places import place_units
from mmw.scene.reader import read_stage
from mmw.scene.roof_places import station_poses
from mmw.scene.rsu_places import draw_rsu_poses
from mmw.scene.scene_data import SceneData
from mmw.scene.sources import scenario_source, weather_variants
from mmw.scene.stage.asset_copies import asset_digests
from mmw.scene.stage.compose import compose_scenario
from mmw.scene.stage.unit_overlay import overlay_units
from mmw.scene.stage_digests import ASSETS, STAGES, Spans, parse_digests
from mmw.storage.atomic_files import write_bytes_atomically
from mmw.storage.store import Store
from mmw.traffic.demand import TrafficDemand, VehicleTrack
from mmw.traffic.drones import fly_drones
from mmw.traffic.engine import simulate_traffic
from mmw.traffic.frame_poses import sample_tracks
from mmw.traffic.roads.town_asset import open_town
from mmw.traffic.weather_driving import DriverFactors, driver_factors
from mmw.usd.vehicle_catalog import VehicleModel, load_bodies, load_catalog

LOGGER = logging.getLogger(__name__)


def cached_stage(
    config: Config,
    scenario: ScenarioConfig,
    base: Path,
    root: Store,
    inputs: Mapping[str, str] | None = None,
    report: Callable[[str], None] = LOGGER.warning,
) -> Path:
    """Return the scenario's USD stage, see `prepare_scenario`, stored with the dataset.

    If the store has the stage already, made on another machine, it is downloaded.

    Raises:
        InputError: If town, traffic or stage cannot be used.
        OutOfSpaceError: If the disk is full.
        StoreError: If the store cannot be reached or refuses.
    """
    own = f"{STAGES}/{scenario.name}"
    if scenario.stage is None:
        root.download((f"{own}.usdc", ASSETS), f"{own}.json")
    stage = prepare_scenario(config, scenario, base, root.folder, inputs, report)
    if scenario.stage is None:
        root.upload((f"{own}.usdc", ASSETS), f"{own}.json")
    elif scenario.has_units:
        root.upload((f"{own}.usda",), f"{own}.json")
    return stage


def prepare_scenario(
    config: Config,
    scenario: ScenarioConfig,
    base: Path,
    root: Path,
    inputs: Mapping[str, str] | None = None,
    report: Callable[[str], None] = LOGGER.warning,
) -> Path:
    """Return the scenario's USD stage; with generated traffic it is made on the first run and reused afterwards.

    A made stage covers the frames 0 to `frames.stop`, one more than asked for, so that velocities are central
    differences up to the last frame. Its hash is written last, into `<scenario>.json`; a stage without it is remade.
    A user's own stage is read where it is; configured roadside units and base stations go into a layer over it.

    Args:
        config: The configuration.
        scenario: One of its scenarios.
        base: Folder that relative paths start from.
        root: Folder of the dataset.
        inputs: Hashes of the scenario's input files, see `mmw.scene.input_files`. A stage of others is made again.
        report: Takes notes on the traffic; it is logged by default.

    Raises:
        InputError: If town, traffic or stage cannot be used.
        OutOfSpaceError: If the disk is full.
    """
    inputs = dict(inputs or {})
    source = scenario_source(scenario, base)
    scenario = place_units(scenario, source)
    rsus = [(rsu.name, pose_from_mount(rsu.position_m, rsu.yaw_deg)) for rsu in scenario.rsus]
    note = root / STAGES / f"{scenario.name}.json"
    if scenario.stage is not None:
        if not scenario.has_units:
            return source
        units = {"rsu": rsus, "bs": station_poses(config, scenario, source)}
        path = overlay_units(root / STAGES / f"{scenario.name}.usda", source, units)
        _write_digests(note, path, root, str(source), inputs)
        return path
    path = root / STAGES / f"{scenario.name}.usdc"
    made = parse_digests(note.read_bytes() if note.is_file() else None)
    if made is not None and path.is_file() and made["sha256"] == sha256(path) and made.get("inputs", inputs) == inputs:
        return path
    tracks = make_tracks(config, scenario, source, load_catalog(), base, report)
    return write_stage(config, scenario, base, root, tracks, inputs)


def write_stage(
    config: Config,
    scenario: ScenarioConfig,
    base: Path,
    root: Path,
    tracks: Sequence[VehicleTrack],
    inputs: Mapping[str, str] | None = None,
    meta: Mapping[str, str] | None = None,
    absent: Spans | None = None,
) -> Path:
    """Write the USD stage of a scenario in a town with these moving actors, and its hash; return its path.

    Args:
        config: The configuration.
        scenario: One of its scenarios that has a town.
        base: Folder that relative paths start from.
        root: Folder of the dataset.
        tracks: Vehicles, people and drones; `pose_stride` poses a frame.
        inputs: Hashes of the scenario's input files.
        meta: Further facts that the stage tells.
        absent: Actors that somebody took out, for `mmw verify`.

    Raises:
        InputError: If town or tracks cannot be used.
        OutOfSpaceError: If the disk is full.
    """
    source, names = scenario_source(scenario, base), config.variants[config.weathers[0]]
    rsus = [(rsu.name, pose_from_mount(rsu.position_m, rsu.yaw_deg)) for rsu in scenario.rsus]
    if config.vary is not None and config.vary.rsu is not None:
        rsus = draw_rsu_poses(config, scenario, source)
    path = root / STAGES / f"{scenario.name}.usdc"
    path.parent.mkdir(parents=True, exist_ok=True)
    compose_scenario(
        path,
        town_path=source,
        tracks=tracks,
        catalog=load_bodies(),
        rsus=rsus,
        base_stations=station_poses(config, scenario, source),
        sensors=config.sensors,
        weather=choose_variant(names, weather_variants(source)) or names[0],
        meta={"mmw": __version__, "scenario": scenario.name, "seed": config.seed, **(meta or {})},
        antennas=config.channel.antennas if config.channel.enabled else (),
        assets=root / ASSETS,
        rate_hz=config.frame_rate_of(scenario),
    )
    note = root / STAGES / f"{scenario.name}.json"
    _write_digests(note, path, root, str(scenario.town), dict(inputs or {}), absent)
    return path


def _write_digests(
    note: Path, stage: Path, root: Path, source: str, inputs: Mapping[str, str], absent: Spans | None = None
) -> None:
    """Write the hashes of a stage, of the copies that it refers to and of its inputs, which `mmw verify` checks."""
    assets = dict(sorted(asset_digests(stage, root).items()))
    content = {"sha256": sha256(stage), "source": source, "assets": assets, "inputs": dict(sorted(inputs.items()))}
    content |= {"absent": absent} if absent else {}
    write_bytes_atomically(note, json.dumps(content, indent=1).encode())


def stored_stage(root: Path, scenario: ScenarioConfig) -> Path:
    """Return the stage that a scenario of a dataset was traced from.

    Args:
        root: Dataset folder.
        scenario: The scenario as `config.yaml` of the dataset has it.

    Raises:
        InputError: If it is not there any more.
    """
    for suffix in (".usdc", ".usda"):
        path = root / STAGES / f"{scenario.name}{suffix}"
        if path.is_file():
            return path
    if scenario.stage is None:
        raise InputError(f"{root}: has no {STAGES}/{scenario.name}.usdc; run the same configuration again to make it")
    return scenario_source(scenario, root)


def make_tracks(
    config: Config,
    scenario: ScenarioConfig,
    source: Path,
    catalog: Mapping[str, VehicleModel],
    base: Path,
    report: Callable[[str], None] = LOGGER.warning,
) -> list[VehicleTrack]:
    """Return the poses of a scenario's traffic, generated or recorded, and of its drones; `pose_stride` poses a frame.

    Args:
        config: The configuration.
        scenario: One of its scenarios that has a town.
        source: The town asset.
        catalog: Vehicle models by name.
        base: Folder that the path of a trajectory file starts from.
        report: Takes notes on the traffic.

    Raises:
        InputError: If the town and the traffic do not go together, see `simulate_traffic`.
    """
    where = f"scenario {scenario.name!r}: traffic"
    demand = make_demand(config, scenario, source, catalog, base)
    try:
        result = simulate_traffic(demand)
        for text in result.notes:
            report(f"{where}: {text}")
        tracks = [*result.tracks, *fly_drones(scenario.uavs, demand.frame_count)]
        return sample_tracks(tracks, config.frames_of(scenario).stop + 1, config.frame_rate_of(scenario))
    except InputError as error:
        raise InputError(f"{where}.{error}") from error


def make_demand(
    config: Config, scenario: ScenarioConfig, source: Path, catalog: Mapping[str, VehicleModel], base: Path
) -> TrafficDemand:
    """Return the traffic that a scenario needs, up to one frame beyond its last; arguments as of `make_tracks`.

    Raises:
        InputError: If the scenario has no traffic, or the town cannot be used.
    """
    town, traffic, where = open_town(source), scenario.traffic, f"scenario {scenario.name!r}: traffic"
    if traffic is None:
        raise InputError(f"{where}: is missing; `town` needs it (vehicle_count, spawn_center_m, cav_ranks)")
    try:
        count = base_frames(config.frames_of(scenario).stop + 1, config.frame_rate_of(scenario))
        spawn = config.vary.spawn if config.vary else None
        drivers = scenario_drivers(config, traffic)
        return TrafficDemand(
            town, traffic, catalog, count, config.seed, base, spawn=spawn, drivers=drivers, scene_seed=config.scene_seed
        )
    except InputError as error:
        raise InputError(f"{where}.{error}") from error


def scenario_drivers(config: Config, traffic: TrafficConfig | None) -> DriverFactors:
    """Return the factors of the weather that people drive in, which the configuration has checked."""
    name = traffic.driving_weather if traffic else None
    if name is None:
        return DriverFactors()
    return driver_factors(config.air[name].weather(name) if name in config.air else PRESETS[name])


def read_frame(config: Config, scenario: ScenarioConfig, stage: Path, frame: int, weather: str) -> SceneData:
    """Return one frame of a scenario, with the materials of one weather of the configuration.

    Raises:
        InputError: If the stage cannot be used, or does not have the frame.
    """
    return read_stage(
        stage,
        range(frame, frame + 1),
        {weather: config.variants[weather]},
        rate_hz=config.frame_rate_of(scenario),
        roles=scenario.actor_roles,
        material_map=config.materials_of(scenario),
        physics=config.channel.physics,
        foliage=config.foliage,
    )


def margin_frames(config: Config) -> int:
    """Return the frames beyond the configured ones on which samples depend: a neighbor, and more for late readings."""
    return 1 + max((sensor.late_frames for sensor in config.sensors), default=0)


def read_scenario(config: Config, scenario: ScenarioConfig, stage: Path) -> SceneData:
    """Return a scenario's arrays for the configured frames, and `margin_frames` on each side where the stage has them.

    Raises:
        InputError: If the stage cannot be used, or does not cover the frames.
    """
    frames = config.frames_of(scenario)
    return read_stage(
        stage,
        range(frames.start, frames.stop),
        config.variants,
        margin=margin_frames(config),
        rate_hz=config.frame_rate_of(scenario),
        roles=scenario.actor_roles,
        material_map=config.materials_of(scenario),
        physics=config.channel.physics,
        foliage=config.foliage,
    )
