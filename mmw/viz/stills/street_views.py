"""Choose street views of a town: eyes on streets, or on the ground of worlds without lanes, that see most."""

import numpy as np

from mmw.core.errors import InputError
from mmw.scene.device_scene import DeviceScene
from mmw.scene.ray_casting import cast_rays
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.roads.town_asset import DRIVABLE_LABELS

STREETS = 3
"""Street views of a town."""

WIDTH_PX, HEIGHT_PX = 1200, 675
"""Size of a street view; the map is as wide, and square."""

EYE_M = 2.4
"""Height of the eye over the road [m]: over the roofs of cars."""

BEFORE_M = 24.0
"""Distance of the eye from the junction that it looks at [m]."""

SIGHT_M = 150.0
"""Distance beyond which objects do not count for the choice of a view [m]."""

SCORED_RAYS = (64, 36)
"""Rays that count what a view sees, columns and rows."""

MAX_CANDIDATES = 240
"""Views that are compared."""

FOV_DEG = 75.0

PLACES = 96
"""Places along each side of a world without lanes at which its ground is looked for."""

DIRECTIONS = 8
"""Directions that are compared at such a place."""

GROUND = (DRIVABLE_LABELS, ("sidewalk", "terrain", "ground"))
"""Semantic classes of the ground below an eye, better ones first."""

ROUND_ABOUT = 2
"""Places to each side whose heights tell the ground of a world without these classes."""

STEP_M = 1.0
"""Ground lies at most this high over the lowest surface round about in such a world [m]; design value, no storey."""

LEVEL = 0.7
"""Upward part of the normal of ground, at least [-]; steeper is a slope of 45 deg; design value."""

View = tuple[float, float, float, float]
"""Eye x, y, z [m], and the direction of view, counter-clockwise from east [deg]."""


def choose_views(scene: DeviceScene, lanes: LaneGraph | None) -> list[View]:
    """Return the street views that see most, far from each other, best first.

    A view looks along a lane at the junction ahead, and is not below a building. Without such a lane, eyes stand on
    what is labeled as road, else on other ground, seen from above; without these labels, on the lowest level surfaces.

    Raises:
        InputError: If there is no ground.
    """
    candidates = _along_lanes(lanes) if lanes is not None else np.zeros((0, 4))
    candidates = candidates[:: max(len(candidates) // MAX_CANDIDATES, 1)]
    candidates = candidates[~_below_building(scene, candidates)]
    if not len(candidates):
        candidates = _on_ground(scene)
    score = np.array([_score(scene, candidate) for candidate in candidates])
    span = scene.arrays.points[:, :2].max(axis=0) - scene.arrays.points[:, :2].min(axis=0)
    chosen: list[np.ndarray] = []
    for apart in (0.25 * float(span.max()), 0.0):
        for k in np.argsort(-score, kind="stable"):
            view = candidates[k]
            if len(chosen) < STREETS and all(np.linalg.norm(view[:2] - other[:2]) > apart for other in chosen):
                chosen.append(view)
    return [(float(x), float(y), float(z), float(yaw)) for x, y, z, yaw in chosen]


def _along_lanes(lanes: LaneGraph) -> np.ndarray:
    """Return the views at the junctions ahead of lanes, shape [N, 4], see `View`; lanes that end have none ahead."""
    views = []
    for name in sorted(lanes.lanes):
        lane = lanes.lanes[name]
        if lane.successors and not lane.junction:
            station = max(lane.length - BEFORE_M, 0.5 * lane.length)
            x, y, z = (np.interp(station, lane.station, lane.points[:, k]) for k in range(3))
            segment = min(int(np.searchsorted(lane.station, station, "right")) - 1, len(lane.headings) - 1)
            views.append((x, y, z + EYE_M, np.degrees(lane.headings[segment])))
    return np.array(views).reshape(-1, 4)


def _below_building(scene: DeviceScene, views: np.ndarray) -> np.ndarray:
    """Return which eyes have a building above them, shape [N]."""
    up = np.broadcast_to([0.0, 0.0, 1.0], (len(views), 3))
    labels = np.array([*(thing.label for thing in scene.arrays.objects), ""])  # the last one for misses
    return labels[cast_rays(scene, views[:, :3], up).object_id] == "building" if len(views) else np.zeros(0, bool)


def _on_ground(scene: DeviceScene) -> np.ndarray:
    """Return the views from places on the ground, in all directions, shape [N, 4], see `View`."""
    points = scene.arrays.points
    low, high = points.min(axis=0).astype(np.float64), points.max(axis=0).astype(np.float64)
    shares = (np.arange(PLACES) + 0.5) / PLACES
    plan = np.stack(np.meshgrid(*(low[:2, None] + shares * (high - low)[:2, None])), axis=-1).reshape(-1, 2)
    start = np.column_stack([plan, np.full(len(plan), high[2] + 1.0)])
    hits = cast_rays(scene, start, np.broadcast_to([0.0, 0.0, -1.0], start.shape))
    feet = np.column_stack([plan, start[:, 2] - hits.distance.astype(np.float64)])
    is_level = hits.normal[:, 2] > LEVEL
    labels = np.array([*(thing.label for thing in scene.arrays.objects), ""])[hits.object_id]
    chosen = next((found for names in GROUND if (found := is_level & np.isin(labels, names)).any()), None)
    if chosen is None:
        heights = np.where(is_level, feet[:, 2], np.inf).reshape(PLACES, PLACES)
        chosen = is_level & (feet[:, 2] <= _lowest_round_about(heights).ravel() + STEP_M)
    eyes = feet[chosen] + np.array([0.0, 0.0, EYE_M])
    if not len(eyes):
        raise InputError(
            "no level surface to stand on is seen from above; give the eye of a view: --at X Y Z YAW of mmw town "
            "render, --eye X Y Z --look-at X Y Z of mmw view"
        )
    eyes = eyes[:: -(-len(eyes) * DIRECTIONS // MAX_CANDIDATES)]
    turns = np.arange(DIRECTIONS) * 360.0 / DIRECTIONS
    return np.column_stack([np.repeat(eyes, DIRECTIONS, axis=0), np.tile(turns, len(eyes))])


def _lowest_round_about(heights: np.ndarray) -> np.ndarray:
    """Return the least of each height and those of the places around it, shape [N, N]."""
    windows = np.lib.stride_tricks.sliding_window_view(
        np.pad(heights, ROUND_ABOUT, constant_values=np.inf), (2 * ROUND_ABOUT + 1, 2 * ROUND_ABOUT + 1)
    )
    return windows.min(axis=(2, 3))


def _score(scene: DeviceScene, view: np.ndarray) -> float:
    """Return how many objects a view sees, and three for every semantic class; less where something is close by."""
    u, v = np.meshgrid(np.linspace(-1.0, 1.0, SCORED_RAYS[0]), np.linspace(-1.0, 1.0, SCORED_RAYS[1]))
    forward, half = view_direction(view[3]), np.tan(np.radians(FOV_DEG) / 2.0)
    right = np.array([forward[1], -forward[0], 0.0]) / np.hypot(*forward[:2])
    up = np.cross(right, forward)
    rays = forward + half * (u[..., None] * right + HEIGHT_PX / WIDTH_PX * v[..., None] * up)
    rays = (rays / np.linalg.norm(rays, axis=2, keepdims=True)).reshape(-1, 3)
    hits = cast_rays(scene, np.broadcast_to(view[:3], rays.shape), rays, max_distance=SIGHT_M)
    seen, count = np.unique(hits.object_id[hits.object_id >= 0], return_counts=True)
    seen = seen[count >= 3]
    labels = {scene.arrays.objects[k].label for k in seen}
    return float(len(seen) + 3 * len(labels) - 200.0 * np.mean((hits.distance < 8.0) & (rays[:, 2] > -0.1)))


def view_direction(yaw_deg: float) -> np.ndarray:
    """Return a unit direction that falls a little, so that the road fills half of the picture and more."""
    yaw, rise = np.radians(yaw_deg), -0.03
    direction = np.array([np.cos(yaw), np.sin(yaw), rise])
    return direction / np.linalg.norm(direction)
