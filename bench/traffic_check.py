"""Check simulated traffic in several seeds: `python -m bench.traffic_check --town town03 --seeds 10`.

One line a seed: the least gap between two vehicles' boxes, the largest jerk, how far a tyre is from the ground,
vehicles that stood for more than 8 s without a cause, the longest standstill, the mean speed, how far a body is from
the nearest lane, vehicles that left their lane, the largest sideways acceleration, the hardest braking, changes of
lanes, and the wall time.

A vehicle has a cause to stand if it waits for green, for its leader, for those who cross, or for room behind a
junction, and this chain ends at a red light or at a vehicle that moves (`mmw/traffic/idm/wait_causes.py`). It has
left its
lane if its origin is farther than half a lane from the middle of every lane: in a change of lanes the body is at most
that far from the nearer one.
"""

import argparse
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from mmw.config import TrafficConfig
from mmw.core.constants import FRAME_RATE_HZ
from mmw.traffic import VehicleTrack
from mmw.traffic.ground_height import Ground
from mmw.traffic.idm.run import run_traffic
from mmw.traffic.idm.wait_causes import STANDING
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.vehicle_pose import make_shape, wheel_points

STUCK_S = 8.0
"""A vehicle that stands longer than this without a cause counts as stuck [s]."""

LANE_SLACK = 0.05
"""Beyond half a lane's width, this much is not yet off the lane [m]."""

PAIR_REACH = 25.0
"""Pairs of vehicles farther apart than this are not looked at [m]."""


@dataclass(frozen=True)
class Measures:
    """What one seed gave."""

    min_gap: float
    """Least distance between two vehicles' rectangles [m]; negative if they overlap."""
    max_jerk: float
    """Largest third difference of the body's origin on one world axis [m/s^3]."""
    max_wheel_error: float
    """Largest vertical distance between a tyre's contact point and the ground [m]."""
    stuck: int
    """Vehicles that stood for more than 8 s without a cause (count)."""
    longest_stop: float
    """Longest standstill [s]."""
    mean_speed: float
    """[m/s]."""
    max_offset: float
    """Largest distance of the body's origin from the nearest lane's centre line [m]."""
    departed: int
    """Vehicles whose origin was farther than half a lane from every lane's centre line (count)."""
    max_lateral: float
    """Largest sideways acceleration [m/s^2]."""
    max_braking: float
    """Hardest braking [m/s^2]."""


def measure(
    tracks: Sequence[VehicleTrack],
    graph: LaneGraph,
    drivable: tuple[np.ndarray, np.ndarray],
    catalog: Mapping[str, Any],
) -> Measures:
    """Return what a scenario's tracks show.

    Args:
        tracks: Vehicles; without `waits` no cause of their standing is known.
        graph: The town's lanes.
        drivable: Vertices and triangles that wheels may stand on.
        catalog: Vehicle models by name.
    """
    poses = np.stack([track.poses for track in tracks])
    position = poses[:, :, :3]
    velocity = np.diff(position, axis=1) * FRAME_RATE_HZ
    acceleration = np.diff(velocity, axis=1) * FRAME_RATE_HZ
    jerk = np.diff(acceleration, axis=1) * FRAME_RATE_HZ
    speed = np.linalg.norm(velocity, axis=2)
    ground = Ground(*drivable)
    error = 0.0
    for track in tracks:
        wheels = wheel_points(track.poses, make_shape(catalog[track.model])).reshape(-1, 3)
        height = ground.heights(wheels)
        if np.isnan(height).any():
            error = np.inf
        error = max(error, float(np.nanmax(np.abs(height - wheels[:, 2]))))
    x, y, z, w = np.moveaxis(poses[:, :, 3:], -1, 0)
    heading = np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))[:, 1:-1]
    aside = acceleration[..., 1] * np.cos(heading) - acceleration[..., 0] * np.sin(heading)
    along = acceleration[..., 0] * np.cos(heading) + acceleration[..., 1] * np.sin(heading)
    stop = max(longest_run(row < 0.05) for row in speed) / FRAME_RATE_HZ
    stands = speed < STANDING
    waits = [np.zeros(len(track.poses), bool) if track.waits is None else track.waits for track in tracks]
    idle = stands & ~np.stack(waits)[:, :-1]
    offset = lane_offset(position[:, ::10].reshape(-1, 3), graph).reshape(len(tracks), -1, 2)
    return Measures(
        min_gap=round(min_gap(tracks, catalog), 3),
        max_jerk=round(float(np.abs(jerk).max()), 2),
        max_wheel_error=round(error, 4),
        stuck=sum(longest_run(row) > STUCK_S * FRAME_RATE_HZ for row in idle),
        longest_stop=stop,
        mean_speed=round(float(speed.mean()), 2),
        max_offset=round(float(offset[..., 0].max()), 3),
        departed=int((offset[..., 0] > 0.5 * offset[..., 1] + LANE_SLACK).any(axis=1).sum()),
        max_lateral=round(float(np.abs(aside).max()), 2),
        max_braking=round(float(-along.min()), 2),
    )


def longest_run(mask: np.ndarray) -> int:
    """Return the length of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def lane_offset(points: np.ndarray, graph: LaneGraph) -> np.ndarray:
    """Return the horizontal distance of points from the nearest lane's centre line and its width [m], shape [R, 2]."""
    starts = np.concatenate([lane.points[:-1] for lane in graph.lanes.values()])
    ends = np.concatenate([lane.points[1:] for lane in graph.lanes.values()])
    width = np.concatenate([np.full(len(lane.points) - 1, lane.width) for lane in graph.lanes.values()])
    out = np.empty((len(points), 2))
    cell = np.floor(points[:, :2] / 50).astype(int)
    for key in np.unique(cell, axis=0):
        rows = np.flatnonzero((cell == key).all(axis=1))
        near = (np.abs(starts[:, :2] - 50 * (key + 0.5)) < 35).all(axis=1)
        a, step = starts[near], (ends - starts)[near]
        for part in np.array_split(rows, len(rows) // 200 + 1):
            to = points[part, None] - a
            share = np.clip((to[..., :2] * step[:, :2]).sum(-1) / (step[:, :2] ** 2).sum(-1).clip(1e-9), 0, 1)
            miss = to - share[..., None] * step
            far = np.where(np.abs(miss[..., 2]) < 2, np.hypot(miss[..., 0], miss[..., 1]), np.inf)
            best = far.argmin(axis=1)
            out[part] = np.column_stack([far[np.arange(len(part)), best], width[near][best]])
    return out


def min_gap(tracks: Sequence[VehicleTrack], catalog: Mapping[str, Any]) -> float:
    """Return the least distance between two vehicles' rectangles over all frames [m], negative for an overlap."""
    poses = np.stack([track.poses for track in tracks])
    shapes = [make_shape(catalog[track.model]) for track in tracks]
    x, y, z, w = np.moveaxis(poses[:, :, 3:], -1, 0)
    heading = np.arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))
    shift = np.array([0.5 * (shape.front - shape.rear) for shape in shapes])[:, None]
    middle = poses[:, :, :2] + shift[..., None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    half = np.array([(0.5 * shape.length, shape.half_width) for shape in shapes])
    least = np.inf
    for i in range(len(tracks)):
        apart = np.linalg.norm(middle[i + 1 :] - middle[i], axis=-1)
        level = np.abs(poses[i + 1 :, :, 2] - poses[i, :, 2]) < 3
        other, frame = np.nonzero((apart < PAIR_REACH) & level)
        if len(other):
            other += i + 1
            a = _corners(middle[i, frame], heading[i, frame], half[[i] * len(other)])
            b = _corners(middle[other, frame], heading[other, frame], half[other])
            least = min(least, float(_distance(a, b).min()))
    return least


def _corners(middle: np.ndarray, heading: np.ndarray, half: np.ndarray) -> np.ndarray:
    forward = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    left = np.stack([-forward[:, 1], forward[:, 0]], axis=-1)
    signs = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])
    along = (signs[:, 0] * half[:, :1])[..., None] * forward[:, None]
    aside = (signs[:, 1] * half[:, 1:])[..., None] * left[:, None]
    return middle[:, None] + along + aside


def _distance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return distances of convex quadrilaterals [R, 4, 2]: corner to edge both ways, or minus the overlap's depth."""
    depth = np.full(len(a), -np.inf)
    for corners in (a, b):
        edge = np.roll(corners, -1, axis=1) - corners
        normal = np.stack([edge[..., 1], -edge[..., 0]], axis=-1) / np.linalg.norm(edge, axis=-1, keepdims=True)
        pa, pb = np.einsum("rkd,rnd->rnk", a, normal), np.einsum("rkd,rnd->rnk", b, normal)
        gap = np.maximum(pb.min(-1) - pa.max(-1), pa.min(-1) - pb.max(-1))
        depth = np.maximum(depth, gap.max(axis=1))
    apart = np.full(len(a), np.inf)
    for corners, other in ((a, b), (b, a)):
        edge = np.roll(other, -1, axis=1) - other
        to = corners[:, :, None] - other[:, None]
        share = np.clip((to * edge[:, None]).sum(-1) / (edge[:, None] ** 2).sum(-1), 0, 1)
        apart = np.minimum(apart, np.linalg.norm(to - share[..., None] * edge[:, None], axis=-1).min(axis=(1, 2)))
    return np.where(depth > 0, apart, depth)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the check and print one line a seed."""
    from pxr import Usd

    from mmw.core.resources import town_path
    from mmw.traffic.roads.lane_prims import read_lanes
    from mmw.usd.vehicle_catalog import load_catalog

    parser = argparse.ArgumentParser(prog="python -m bench.traffic_check", description=__doc__)
    parser.add_argument("--town", default="town03", help="name of a shipped town")
    parser.add_argument("--seeds", type=int, default=10, help="seeds 0..N-1")
    parser.add_argument("--vehicles", type=int, default=30, help="vehicles in the scenario")
    parser.add_argument("--center", type=float, nargs=3, default=(0.0, 0.0, 0.0), help="spawn centre, x y z [m]")
    parser.add_argument("--frames", type=int, default=1000, help="frames at 100 Hz")
    parser.add_argument("--warmup", type=float, default=1.0, help="warm-up [s]")
    parser.add_argument("--signals", action="store_true", help="traffic lights work")
    parser.add_argument("--no-lane-changes", action="store_true", help="everybody stays on the lane")
    options = parser.parse_args(arguments)
    stage = Usd.Stage.Open(str(town_path(options.town)))
    root = str(stage.GetDefaultPrim().GetPath())
    graph = read_lanes(stage, f"{root}/Lanes")
    drivable = read_drivable(stage)
    catalog = load_catalog()
    traffic = TrafficConfig(
        vehicle_count=options.vehicles,
        spawn_center_m=tuple(options.center),
        cav_ranks=(),
        warmup_s=options.warmup,
        lane_changes=not options.no_lane_changes,
        signals=options.signals,
    )
    for seed in range(options.seeds):
        start = time.perf_counter()
        outcome = run_traffic(
            graph,
            drivable,
            catalog,
            traffic,
            frame_count=options.frames,
            seed=seed,
        )
        wall = time.perf_counter() - start
        row = asdict(measure(outcome.tracks, graph, drivable, catalog))
        row |= {"changes": len(outcome.changes), "wall_s": wall}
        if seed == 0:
            print("seed " + " ".join(f"{name:>15}" for name in row))
        print(f"{seed:4d} " + " ".join(f"{value:15.3f}" for value in row.values()), flush=True)


def read_drivable(stage) -> tuple[np.ndarray, np.ndarray]:
    """Return the triangles of every mesh labelled `road` or `road_line`: vertices [N, 3] and faces [M, 3]."""
    from pxr import Usd, UsdGeom, UsdSemantics

    query = UsdSemantics.LabelsQuery("class", Usd.TimeCode.Default())
    cache = UsdGeom.XformCache()
    points, faces, count = [], [], 0
    for prim in stage.Traverse(Usd.TraverseInstanceProxies()):
        if not prim.IsA(UsdGeom.Mesh):
            continue
        labels = set(query.ComputeUniqueInheritedLabels(prim))
        if not labels & {"road", "road_line"}:
            continue
        mesh = UsdGeom.Mesh(prim)
        local = np.array(mesh.GetPointsAttr().Get(), np.float64)
        matrix = np.array(cache.GetLocalToWorldTransform(prim))
        points.append(local @ matrix[:3, :3] + matrix[3, :3])
        faces.append(np.array(mesh.GetFaceVertexIndicesAttr().Get(), np.int32).reshape(-1, 3) + count)
        count += len(local)
    return np.concatenate(points), np.concatenate(faces)


if __name__ == "__main__":
    main()
