"""Draw places of roadside units: beside the road, on the ground, in nothing solid, with a free view of the road."""

import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mmw.config import Config, RsuConfig, ScenarioConfig, VaryRsuConfig
from mmw.core.transforms import pose_from_mount
from mmw.scene.device_scene import DeviceScene
from mmw.scene.ray_casting import cast_rays
from mmw.scene.reader import read_stage
from mmw.traffic.ground_height import Ground
from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.traffic.roads.town_asset import open_town
from mmw.traffic.spawn import seeded

SPACING_M = 4.0
"""Distance between places along a lane. Design value, as all below."""
SETBACKS_M = (1.5, 3.0, 5.0)
"""From the edge of the outermost lane to the unit."""
VERGE_M = 1.0
"""From the edge of any lane to a unit, at least; half of it from anything drivable."""
LEVEL_M = 5.0
"""A place is at most this much above or below the unit's own: on the same level of the roads."""
MAX_STEP_M = 0.6
"""Ground beside the road is at most this much above or below the lane."""
FREE_M = 0.8
"""Nothing solid is nearer to a unit than this, from its foot to above its antenna."""
VIEW_M = 60.0
"""Lanes within this distance have to be in view."""
VIEW_SHARE = 0.7
"""Share of their points that the antenna sees, at least."""
EYE_M = 1.5
"""Height above the lane of the points that have to be in view."""
UNIT_DISTANCE_M = 10.0
"""Between two units, at least."""


@dataclass(frozen=True)
class Places:
    """Places beside the lanes."""

    feet: np.ndarray
    """On the ground, world frame [m], shape [N, 3]."""
    toward: np.ndarray
    """Point of the lane that each place belongs to [m], shape [N, 3]."""


def draw_rsu_poses(config: Config, scenario: ScenarioConfig, source: Path) -> list[tuple[str, np.ndarray]]:
    """Return names and poses of a scenario's roadside units, each drawn by seed from its own place and those near it.

    At a place beside a lane a unit looks at that lane.

    Args:
        config: The configuration, with `vary.rsu`.
        scenario: One of its scenarios that has a town.
        source: The town asset.

    Raises:
        InputError: If the town cannot be read.
    """
    vary = config.vary.rsu if config.vary and config.vary.rsu else VaryRsuConfig()
    town = open_town(source)
    ground = Ground(town.points, town.faces)
    variants = {weather: config.variants[weather] for weather in config.weathers[:1]}
    scene = DeviceScene(read_stage(source, range(1), variants), "cpu", max_batch_frames=1)
    scene.load_batch([scene.arrays.frames[0]])
    road = np.concatenate([lane.points[::3] for lane in town.lanes.lanes.values()]) + _up(EYE_M)
    poses: list[tuple[str, np.ndarray]] = []
    for rsu in scenario.rsus:
        own = [one for one in config.channel.antennas if one.is_on("rsu", rsu.name)]
        antenna = max((one.mount_on("rsu", rsu.name).position_m[2] for one in own), default=EYE_M)
        places = _off_the_road(ground, _places_near(town.lanes, rsu, vary.radius_m))
        places = _free_around(scene, _on_the_ground(scene, places), antenna)
        for _, other in poses:
            places = _chosen(places, np.linalg.norm(places.feet - other[:3], axis=1) >= UNIT_DISTANCE_M)
        generator = seeded(config.seed_of_scene, zlib.crc32(f"{scenario.name}.{rsu.name}".encode()))
        # The first in random order that has a view is each of those with one, equally likely.
        for index in generator.permutation(len(places.feet) + 1):
            if index == len(places.feet):
                poses.append((rsu.name, pose_from_mount(rsu.position_m, rsu.yaw_deg)))
                break
            foot, toward = places.feet[index], places.toward[index]
            if _has_view(scene, road, foot + _up(antenna)):
                yaw_deg = float(np.degrees(np.arctan2(toward[1] - foot[1], toward[0] - foot[0])))
                poses.append((rsu.name, pose_from_mount(tuple(foot), yaw_deg)))
                break
    return poses


def _places_near(lanes: LaneGraph, rsu: RsuConfig, radius: float) -> Places:
    """Return places to the right of the outermost lanes, at the height of the lane and off every carriageway."""
    feet, toward = [], []
    for lane in (lanes.lanes[name] for name in sorted(lanes.lanes)):
        if lane.junction or lane.right:
            continue
        stations = np.arange(0.5 * SPACING_M, lane.plan_length, SPACING_M)
        points = np.stack([np.interp(stations, lane.plan_station, lane.points[:, axis]) for axis in range(3)], axis=1)
        ahead = np.interp(stations + 0.5, lane.plan_station, lane.points[:, 0]) - points[:, 0]
        aside = np.interp(stations + 0.5, lane.plan_station, lane.points[:, 1]) - points[:, 1]
        right = np.stack([aside, -ahead, np.zeros_like(ahead)], axis=1)
        right /= np.maximum(np.linalg.norm(right, axis=1, keepdims=True), 1e-9)
        for setback in SETBACKS_M:
            feet.append(points + right * (0.5 * lane.width + setback))
            toward.append(points)
    places = Places(np.concatenate(feet), np.concatenate(toward))
    offset = places.feet - np.asarray(rsu.position_m)
    places = _chosen(places, (np.linalg.norm(offset[:, :2], axis=1) <= radius) & (np.abs(offset[:, 2]) <= LEVEL_M))
    if not len(places.feet):
        return places
    gaps = [_gap(places.feet, lane) for lane in lanes.lanes.values()]
    return _chosen(places, np.min(gaps, axis=0) >= VERGE_M)


def _gap(points: np.ndarray, lane: Lane) -> np.ndarray:
    """Return the distance of points from the edge of a lane in plan [m], shape [N]; lane points are 2 m apart."""
    away = np.linalg.norm(points[:, None, :2] - lane.points[None, :, :2], axis=2).min(axis=1)
    return np.sqrt(np.maximum(away**2 - 1.0, 0.0)) - 0.5 * lane.width


def _off_the_road(ground: Ground, places: Places) -> Places:
    """Return places that are off everything drivable, such as shoulders and the middle of junctions."""
    is_road = np.full(len(places.feet), False)
    for x, y in ((0, 0), (VERGE_M, 0), (-VERGE_M, 0), (0, VERGE_M), (0, -VERGE_M)):
        is_road |= np.isfinite(ground.heights(places.feet + np.array([0.5 * x, 0.5 * y, 0.0])))
    return _chosen(places, ~is_road)


def _on_the_ground(scene: DeviceScene, places: Places) -> Places:
    """Return places on the ground below the first surface that is about as high as the lane."""
    above = places.feet + _up(MAX_STEP_M)
    hits = cast_rays(scene, above, np.tile(_up(-1.0), (len(above), 1)), max_distance=2 * MAX_STEP_M)
    drop = hits.distance.astype(np.float64)
    feet = above - np.stack([np.zeros_like(drop), np.zeros_like(drop), np.where(np.isfinite(drop), drop, 0.0)], axis=1)
    return _chosen(Places(feet, places.toward), np.isfinite(drop) & (drop > 0.0) & (hits.normal[:, 2] > 0.9))


def _free_around(scene: DeviceScene, places: Places, antenna: float) -> Places:
    """Return places around and above which nothing solid is."""
    free = np.full(len(places.feet), True)
    turns = np.radians(np.arange(0, 360, 30))
    around = np.stack([np.cos(turns), np.sin(turns), np.zeros_like(turns)], axis=1)
    for height in (0.5, 1.5, 0.5 * antenna, antenna, antenna + FREE_M):
        for direction in around:
            hits = cast_rays(scene, places.feet + _up(height), np.tile(direction, (len(free), 1)), max_distance=FREE_M)
            free &= ~np.isfinite(hits.distance)
    up = cast_rays(scene, places.feet + _up(0.1), np.tile(_up(1.0), (len(free), 1)), max_distance=antenna + FREE_M)
    return _chosen(places, free & ~np.isfinite(up.distance))


def _has_view(scene: DeviceScene, road: np.ndarray, eye: np.ndarray) -> bool:
    """Return whether an antenna [m], shape [3], sees most points of the lanes nearby, of those of shape [N, 3]."""
    offset = road - eye
    length = np.linalg.norm(offset, axis=1)
    near = (length <= VIEW_M) & (length > 1.0)
    hits = cast_rays(scene, np.tile(eye, (near.sum(), 1)), offset[near] / length[near, None])
    return bool(near.any() and np.mean(hits.distance > length[near] - 0.1) >= VIEW_SHARE)


def _up(height: float) -> np.ndarray:
    return np.array([0.0, 0.0, height])


def _chosen(places: Places, kept: np.ndarray) -> Places:
    return Places(places.feet[kept], places.toward[kept])
