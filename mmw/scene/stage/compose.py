"""Compose the stage of a scenario. It is all that the tracer reads, and any USD viewer opens it.

/World                  assembly
  Town                  references the town; its weather variant is selected here
  Actors/<name>         animated Xform, mmw:actor:*
    Model               instanceable reference to the vehicle, paint variant selected here
    Sensors             of CAVs, VRUs and drones
  RSU/<name>            Xform, mmw:actor:role = rsu
    Sensors
  BS/<name>             the same for base stations, role bs; only if there are any
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf

from mmw.config import SensorConfig
from mmw.config.agent_keys import AGENT_ROLES, AgentIdentity, Body
from mmw.config.antennas import AntennaConfig
from mmw.core.constants import FRAME_RATE_HZ
from mmw.core.errors import InputError
from mmw.core.frame_rate import pose_stride
from mmw.scene.stage.asset_copies import collect_assets
from mmw.scene.stage.layer import animate, define, new_layer, place
from mmw.scene.stage.sensor_prims import write_sensors
from mmw.traffic.demand import VehicleTrack
from mmw.usd.atomic_layers import save_layers
from mmw.usd.prim_specs import set_label, set_value
from mmw.usd.vehicle_catalog import ActorModel
from mmw.worlds.vehicles.actor_prims import describe_actor

ROLES = ("cav", "vehicle", "pedestrian", "vru", "uav")
"""Roles of what moves."""

UNITS = {"rsu": "RSU", "bs": "BS"}
"""Role of what stands -> name of the group of its prims."""


def compose_scenario(
    path: str | Path,
    *,
    town_path: str | Path,
    tracks: Sequence[VehicleTrack],
    catalog: Mapping[str, ActorModel],
    rsus: Sequence[tuple[str, np.ndarray]],
    sensors: Sequence[SensorConfig],
    weather: str,
    meta: Mapping[str, Any],
    antennas: Sequence[AntennaConfig] = (),
    base_stations: Sequence[tuple[str, np.ndarray]] = (),
    assets: str | Path | None = None,
    rate_hz: int = FRAME_RATE_HZ,
) -> Path:
    """Write the USD stage of a scenario; equal input gives an equal file.

    The town and the vehicles are copied into `assets` and referenced by relative paths, so that stage and assets can be
    moved together. The file appears only once it is complete.

    Args:
        path: Stage to write, a `.usdc` or `.usda` file; one that is there is replaced.
        town_path: Interface layer of the town.
        tracks: Vehicles and people; all with the same number of poses. A NaN pose means that the vehicle is not there.
        catalog: Models of vehicles and people by name.
        rsus: Names of roadside units and their poses in the world, shape [7].
        sensors: Sensors that agents carry.
        weather: Variant of the town that is selected in the file.
        meta: What is written into the layer's custom data, such as version, scenario and seed.
        antennas: Antennas that agents carry.
        base_stations: Names of base stations and their poses in the world, shape [7].
        assets: Folder of the copies; `assets` beside the stage if absent.
        rate_hz: Frames a second. The stage has a time code for each pose, `pose_stride(rate_hz)` a frame.

    Returns:
        The stage's path.

    Raises:
        InputError: If there is no track, a model, role or name cannot be used, or a file of an asset is missing.
        OSError: If a file cannot be written.
    """
    path = Path(path).resolve()
    models = {name: _model(catalog, name) for name in sorted({track.model for track in tracks})}
    pose_count = _frame_count(tracks)
    sources = [Path(town_path), *(model.asset for model in models.values())]
    copies = collect_assets(sources, Path(assets).resolve() if assets else path.parent / "assets")
    town, *shapes = (_reference(path, source.resolve(), copies[source.resolve()]) for source in sources)
    shape_of = dict(zip(models, shapes, strict=True))
    layer = new_layer(path.name, meta, rate_hz * pose_stride(rate_hz), pose_count)
    with Sdf.ChangeBlock():
        define(layer, "/World", kind="assembly")
        prim = define(layer, "/World/Town")
        prim.referenceList.Prepend(Sdf.Reference(town))
        prim.variantSelections["weather"] = weather
        define(layer, "/World/Actors", kind="group")
        for track in tracks:
            _write_actor(layer, track, models[track.model], shape_of[track.model])
            if track.role in AGENT_ROLES:
                model = models[track.model]
                body = Body.of_box((model.length, model.width, model.height), model.center)
                agent = AgentIdentity(track.role, track.name, track.model, model.label, body)
                path_of = f"/World/Actors/{track.name}"
                write_sensors(layer, path_of, agent, sensors, antennas, rate_hz)
        for role, units in (("rsu", rsus), ("bs", base_stations)):
            if units or role == "rsu":
                define(layer, f"/World/{UNITS[role]}", kind="group")
            for name, pose in units:
                prim = define(layer, f"/World/{UNITS[role]}/{name}", kind="component")
                place(prim, np.asarray(pose, dtype=np.float64))
                set_value(prim, "mmw:actor:role", Sdf.ValueTypeNames.Token, role)
                set_label(prim, "static")
                agent = AgentIdentity(role, name, name, "static")
                write_sensors(layer, str(prim.path), agent, sensors, antennas, rate_hz)
    save_layers({path: layer})
    return path


def _write_actor(layer: Sdf.Layer, track: VehicleTrack, model: ActorModel, asset: str) -> None:
    if track.role not in ROLES:
        raise InputError(f"actor {track.name!r}: role = {track.role!r}; one of {', '.join(ROLES)} is needed")
    if track.paint not in model.paints:
        raise InputError(f"actor {track.name!r}: paint = {track.paint!r}; {model.name} has {', '.join(model.paints)}")
    prim = define(layer, f"/World/Actors/{track.name}", kind="group")
    animate(prim, track.poses)
    describe_actor(prim, track.role, model, asset, track.paint)


def _model(catalog: Mapping[str, ActorModel], name: str) -> ActorModel:
    if name not in catalog:
        raise InputError(f"model {name!r} is not known; the models are {', '.join(catalog)}; name one of them")
    return catalog[name]


def _frame_count(tracks: Sequence[VehicleTrack]) -> int:
    counts = sorted({len(track.poses) for track in tracks})
    if len(counts) != 1 or counts[0] == 0:
        raise InputError(
            f"tracks have {counts or 'no'} poses; every vehicle needs one pose a frame, all of the same number"
        )
    for track in tracks:
        if np.shape(track.poses) != (counts[0], 7) or not np.isfinite(track.poses).all(axis=1).any():
            raise InputError(
                f"actor {track.name!r}: poses have shape {np.shape(track.poses)}; [F, 7], not all NaN, is needed"
            )
    return counts[0]


def _reference(stage: Path, source: Path, copy: Path) -> str:
    """Return the path of an asset as the stage writes it: relative to the stage, absolute if it could not be copied."""
    if copy == source:
        return source.as_posix()
    relative = os.path.relpath(copy, stage.parent).replace(os.sep, "/")
    return relative if relative.startswith("..") else f"./{relative}"
