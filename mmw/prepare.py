"""Before tracing: a scenario's USD stage, made once and kept with the data, and its arrays."""

import hashlib
import json
import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from mmw import __version__
from mmw.compute.device import device_name
from mmw.config import Config, ScenarioConfig
from mmw.plan import scenario_source
from mmw.poses import pose_from_mount
from mmw.scene_arrays import MODEL_NONE, SceneArrays
from mmw.scene_reader import read_stage
from mmw.stage.compose import compose_scenario
from mmw.tables.publish import publish_bytes
from mmw.town.asset import open_town
from mmw.traffic import simulate
from mmw.vehicles.catalog import load_catalog

STAGES = "stages"
"""Folder of the scenario stages in a dataset."""


def prepare_scenario(config: Config, scenario: ScenarioConfig, base: Path, root: Path) -> Path:
    """Return the scenario's USD stage; with generated traffic it is made on the first run and reused afterwards.

    A made stage covers the frames 0 to `frames.stop`, one more than asked for, so that velocities are central
    differences up to the last frame. Its hash is written last, into `<scenario>.json`; a stage without it is remade.

    Raises:
        ValueError: If town, traffic or stage cannot be used.
        OutOfSpaceError: If the disk is full.
    """
    source = scenario_source(scenario, base)
    if scenario.stage is not None:
        return source
    path, note = root / STAGES / f"{scenario.name}.usdc", root / STAGES / f"{scenario.name}.json"
    if note.is_file() and path.is_file() and json.loads(note.read_text())["sha256"] == sha256(path):
        return path
    town, catalog, traffic = open_town(source), load_catalog(), scenario.traffic
    if traffic is None:
        raise ValueError(f"scenario {scenario.name!r}: `town` needs `traffic`")
    tracks = simulate(
        town.lanes,
        (town.points, town.faces),
        catalog,
        frame_count=config.frames.stop + 1,
        vehicle_count=traffic.vehicle_count,
        spawn_center=traffic.spawn_center_m,
        cav_ranks=traffic.cav_ranks,
        warmup_s=traffic.warmup_s,
        seed=config.seed,
    )
    rsus = [(rsu.name, pose_from_mount(rsu.position_m, rsu.yaw_deg)) for rsu in scenario.rsus]
    path.parent.mkdir(parents=True, exist_ok=True)
    compose_scenario(
        path,
        town_path=source,
        tracks=tracks,
        catalog=catalog,
        rsus=rsus,
        sensors=config.sensors,
        weather=config.weathers[0],
        meta={"mmw": __version__, "scenario": scenario.name, "seed": config.seed},
        antenna_position_m=config.channel.antenna_position_m if config.channel.enabled else None,
        assets=root / "assets",
    )
    publish_bytes(note, json.dumps({"sha256": sha256(path), "town": str(scenario.town)}).encode())
    return path


def read_scenario(config: Config, scenario: ScenarioConfig, stage: Path) -> SceneArrays:
    """Return a scenario's arrays for the configured frames, and one frame on each side where the stage has it.

    Raises:
        ValueError: If the stage cannot be used, or does not cover the frames.
    """
    return read_stage(
        stage,
        range(config.frames.start, config.frames.stop),
        config.weathers,
        margin=1,
        roles=scenario.actor_roles,
        material_map=scenario.material_map,
    )


def buried_mounts(arrays: SceneArrays, config: Config) -> list[str]:
    """Return one line for each sensor or antenna that sits inside the box of its own agent, where it sees nothing else.

    Inertial sensors belong there and are left out.
    """
    lines = []
    for actor in arrays.actors:
        places = {s.name: s.mount_on("cav").position_m for s in config.sensors if "cav" in s.on and s.type != "imu"}
        if config.channel.enabled:
            places["antenna"] = config.channel.antenna_position_m.get("cav", (0.0, 0.0, 0.0))
        if actor.role == "cav" and actor.model != MODEL_NONE:
            half, center = np.array(actor.size) / 2.0, np.array(actor.center)
            lines += [
                f"{actor.name} ({actor.size[2]:.1f} m high): {name} at {position} m is inside its body; raise the mount"
                for name, position in places.items()
                if (np.abs(np.array(position) - center) < half).all()
            ]
    return lines


def versions(config: Config, base: Path, device: str) -> dict[str, Any]:
    """Return what makes the data: versions, revision, device, and the hashes of towns and stages."""
    packages = {}
    for name in ("warp-lang", "numpy", "usd-core", "pyarrow", "pydantic", "trimesh", "pillow"):
        try:
            packages[name] = version(name)
        except PackageNotFoundError:
            packages[name] = "unknown"
    sources = {}
    for scenario in config.scenarios:
        source = scenario_source(scenario, base)
        payload = source.parent / "geometry.usdc"
        sources[scenario.name] = {path.name: sha256(path) for path in (source, payload) if path.is_file()}
    return {
        "mmw": __version__,
        "git": git_revision(),
        "python": platform.python_version(),
        "packages": packages,
        "device": device_name(device),
        "sources": sources,
    }


def git_revision() -> str:
    """Return the checkout's commit, with `+` if files differ from it; empty outside a checkout."""
    root = Path(__file__).resolve().parent.parent
    if not (root / ".git").exists():
        return ""

    def git(*arguments: str) -> str:
        result = subprocess.run(["git", "-C", str(root), *arguments], capture_output=True, text=True, check=False)
        return result.stdout.strip() if result.returncode == 0 else ""

    return git("rev-parse", "--short=12", "HEAD") + (
        "+" if git("status", "--porcelain", "--untracked-files=no") else ""
    )


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
