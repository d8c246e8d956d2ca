"""Radar scenes built in code, and what radars see of them."""

from pathlib import Path

import numpy as np
import trimesh
from pxr import Usd, UsdGeom

from mmw.config import MountConfig, RadarConfig
from mmw.kernels.radar import RadarHits
from mmw.kinematics import differentiate
from mmw.paths import assets_dir
from mmw.scene import Scene
from mmw.scene_arrays import SceneArrays
from mmw.scene_reader import read_stage
from mmw.sensors.radar import dense_points, shade_radar, trace_radar
from mmw.sensors.radar_batch import RadarBatch
from mmw.sensors.sweep import view_twists
from mmw.town.parts import MeshPart
from mmw.views import Views, make_views, view_keys
from mmw.weather import Weather
from tests.scenes import arrays_from_parts, quad_part

AT_ORIGIN = {"rsu": MountConfig(), "cav": MountConfig()}
COMPAT = RadarConfig(mode="compat", mount=AT_ORIGIN)
CLEAR = Weather()


def traced(
    arrays: SceneArrays, device: str, config: RadarConfig, frames=None, seed: int = 0
) -> tuple[Views, RadarHits]:
    """Return views and hits of a sensor in some frames, all of them if left out."""
    frames = list(arrays.frames) if frames is None else frames
    scene = Scene(arrays, device, len(frames))
    scene.load_batch(frames)
    views = make_views(arrays, frames, config)
    velocity, _ = view_twists(arrays, differentiate(arrays.poses), views)
    keys = view_keys(arrays, views, seed, "test", config.name)
    return views, trace_radar(scene, views, velocity, config, keys)


def dense(
    arrays: SceneArrays, device: str, config: RadarConfig, frames=None, weather=CLEAR, seed: int = 0
) -> RadarBatch:
    _, hits = traced(arrays, device, config, frames, seed)
    return dense_points(shade_radar(hits, next(iter(arrays.materials.values())), weather, config), config)


def xyz(batch: RadarBatch) -> np.ndarray:
    """Return the points in the sensor frame, shape [N, 3]."""
    level = np.cos(batch.elevation)
    direction = np.stack([level * np.cos(batch.azimuth), level * np.sin(batch.azimuth), np.sin(batch.elevation)], -1)
    return batch.range[:, None].astype(float) * direction


def watched(parts, models=(), actors=(), poses=None, mount=(0.0, 0.0, 0.0), **rest) -> SceneArrays:
    """Return a scene with `rsu_1` at `mount`, looking along x, behind the given actors."""
    frames = 1 if poses is None else len(poses)
    stand = np.broadcast_to(np.array([*mount, 0.0, 0.0, 0.0, 1.0]), (frames, 1, 7))
    poses = stand if poses is None else np.concatenate([np.asarray(poses, dtype=float), stand], axis=1)
    return arrays_from_parts(parts, models, [*actors, ("rsu_1", "rsu", -1)], poses, **rest)


def wall_ahead(x: float, half: float, name: str = "metal_pole", yaw: float = 0.0) -> MeshPart:
    """Return a square plate about the x axis that faces the radar, turned about z by yaw [rad]."""
    side, up = np.array([-np.sin(yaw), np.cos(yaw), 0.0]), np.array([0.0, 0.0, 1.0])
    middle = np.array([x, 0.0, 0.0])
    corners = [middle + half * (a * side + b * up) for a, b in ((-1, -1), (-1, 1), (1, 1), (1, -1))]
    return quad_part("Props/plate", corners, name, "static")


def sphere(radius: float, x: float, name: str = "metal_pole") -> MeshPart:
    mesh = trimesh.creation.icosphere(subdivisions=6, radius=radius)
    points = np.array(mesh.vertices, dtype=float) + np.array([x, 0.0, 0.0])
    return MeshPart("Props/sphere", points, np.array(mesh.faces, dtype=np.int32), name, "static")


def turntable(asset: str, distance: float, headings_deg: np.ndarray, folder: Path) -> SceneArrays:
    """Return a shipped body `distance` ahead of `rsu_1`, which is 1 m above its ground, turned in each frame."""
    path = folder / "turntable.usda"
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(100)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(len(headings_deg) - 1)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    body = UsdGeom.Xform.Define(stage, "/World/body")
    body.GetPrim().GetReferences().AddReference(str(assets_dir() / asset))
    body.AddTranslateOp(opSuffix="place").Set((distance, 0.0, -1.0))
    turn = body.AddRotateZOp(opSuffix="turn")
    for frame, heading in enumerate(headings_deg):
        turn.Set(float(heading), frame)
    UsdGeom.Xform.Define(stage, "/World/rsu_1")
    stage.Save()
    roles = {"/World/body": "vehicle", "/World/rsu_1": "rsu"}
    return read_stage(path, range(len(headings_deg)), ["sunny"], roles=roles)
