"""Pictures of a town alone: from above, three streets, and the map of its lanes."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mmw.core.errors import InputError
from mmw.physics.weather.weather import PRESETS, Weather
from mmw.scene.device_scene import DeviceScene
from mmw.scene.ray_casting import cast_rays
from mmw.scene.reader import WEATHER, read_stage
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.usd.open_stage import open_stage, reads_usd
from mmw.viz.plots.lane_map import plot_lanes
from mmw.viz.stills.image_files import save_jpeg
from mmw.viz.stills.renderer import load_renderer, map_frame, street_camera
from mmw.worlds.checks.stage_model import open_stage_model

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

GRID = (64, 36)
"""Rays that count what a view sees, columns and rows."""

MAX_CANDIDATES = 240
"""Views that are compared."""

FOV_DEG = 75.0

MAX_BYTES = 190_000
"""Size of a JPEG file at most [bytes], so that documents stay small. Design value."""

View = tuple[float, float, float, float]
"""Eye x, y, z [m], and the direction of view, counter-clockwise from east [deg]."""


def draw_town(
    path: Path, out: Path, *, views: Sequence[View] = (), samples: int = 4, device: str = "auto"
) -> list[Path]:
    """Write the pictures of a town, or of any other stage at its start, as the RGB camera sees it.

    The files are `<name>_above.jpg`, `<name>_street1.jpg` to `3`, and, for a stage with lanes, `<name>_lanes.png`.
    Equal stages give equal pictures. Without given views, those that see most distinct objects are chosen. The stage's
    selected weather is drawn, with the values of the preset of its name.

    Args:
        path: USD file.
        out: Folder for the files.
        views: Street views instead of the chosen ones, at most three.
        samples: Rays in a pixel on an edge: 1, 4 or 9.
        device: Warp device that renders: `auto`, `cpu` or `cuda:N`.

    Returns:
        The files written.

    Raises:
        InputError: If the stage cannot be read, a mesh has no radio material, or there are more than three views.
    """
    if len(views) > STREETS:
        raise InputError(f"{len(views)} views are given; a town has {STREETS}; leave some out")
    weather = selected_weather(path)
    arrays = read_stage(path, range(1), [weather])
    pictures = load_renderer(arrays, 0, {weather: PRESETS.get(weather, Weather())}, device=device)
    lanes = open_stage_model(path).lanes
    out.mkdir(parents=True, exist_ok=True)
    files = [out / f"{path.stem}_above.jpg"]
    above = pictures.map_view(weather, *map_frame(pictures.scene), width=WIDTH_PX, samples=samples)
    save_jpeg(above, files[0], MAX_BYTES)
    camera = street_camera(WIDTH_PX, HEIGHT_PX, samples, FOV_DEG)
    for number, view in enumerate(views or choose_views(pictures.scene, lanes), start=1):
        eye, direction = np.array(view[:3]), view_direction(view[3])
        files.append(out / f"{path.stem}_street{number}.jpg")
        save_jpeg(pictures.look(weather, eye, eye + direction, camera), files[-1], MAX_BYTES)
    if lanes is not None:
        files.append(out / f"{path.stem}_lanes.png")
        plot_lanes(lanes, arrays, path.stem, files[-1])
    return files


@reads_usd
def selected_weather(path: Path) -> str:
    """Return the weather that a stage has selected, `sunny` for a stage without weathers.

    Raises:
        InputError: If USD cannot read the file.
    """
    stage = open_stage(path)
    for prim in stage.Traverse():
        if prim.HasVariantSets() and prim.GetVariantSets().HasVariantSet(WEATHER):
            return prim.GetVariantSet(WEATHER).GetVariantSelection() or prim.GetVariantSet(WEATHER).GetVariantNames()[0]
    return "sunny"


def choose_views(scene: DeviceScene, lanes: LaneGraph | None) -> list[View]:
    """Return the street views that see most, far from each other, best first.

    A view looks along a lane at the junction ahead; without lanes, from a ring about the middle to the middle.
    """
    candidates = _along_lanes(lanes) if lanes is not None else _ring(scene)
    candidates = candidates[:: max(len(candidates) // MAX_CANDIDATES, 1)]
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
    """Return the views at the junctions ahead of lanes, shape [N, 4], see `View`."""
    views = []
    for name in sorted(lanes.lanes):
        lane = lanes.lanes[name]
        if not lane.junction:
            station = max(lane.length - BEFORE_M, 0.5 * lane.length)
            x, y, z = (np.interp(station, lane.station, lane.points[:, k]) for k in range(3))
            segment = min(int(np.searchsorted(lane.station, station, "right")) - 1, len(lane.headings) - 1)
            views.append((x, y, z + EYE_M, np.degrees(lane.headings[segment])))
    return np.array(views)


def _ring(scene: DeviceScene) -> np.ndarray:
    """Return the views from a ring about the middle to it, shape [24, 4], see `View`."""
    points = scene.arrays.points
    middle, radius = points[:, :2].mean(axis=0), 0.35 * float(np.ptp(points[:, :2], axis=0).max())
    turns = np.linspace(0.0, 360.0, 24, endpoint=False)
    ring = middle + radius * np.stack([np.cos(np.radians(turns)), np.sin(np.radians(turns))], axis=1)
    top = float(points[:, 2].max()) + 1.0
    start = np.column_stack([ring, np.full(len(ring), top)])
    down = np.broadcast_to([0.0, 0.0, -1.0], start.shape)
    fall = cast_rays(scene, start, down, max_distance=1.0e4).distance.astype(np.float64)
    z = np.where(np.isfinite(fall), top - fall, float(points[:, 2].min())) + EYE_M
    return np.column_stack([ring, z, turns + 180.0])


def _score(scene: DeviceScene, view: np.ndarray) -> float:
    """Return how many objects a view sees, and three for every semantic class; less where something is close by."""
    u, v = np.meshgrid(np.linspace(-1.0, 1.0, GRID[0]), np.linspace(-1.0, 1.0, GRID[1]))
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
