"""Move cyclists along the edge of the road: each goes around a block, the curb to the right, and crosses no street.

They keep their distance from each other, slow down in curves and lean into them. Like pedestrians they do not see
vehicles, and vehicles do not see them.
"""

from collections.abc import Sequence

import numpy as np

from mmw.core.constants import FRAME_RATE_HZ, GRAVITY
from mmw.core.errors import InputError
from mmw.core.transforms import compose, make_pose
from mmw.traffic.demand import TrafficDemand, VehicleTrack
from mmw.traffic.followed_line import FollowedLine, follow_lines, nearest_places, smooth_line, start_places
from mmw.traffic.ground_height import Ground
from mmw.traffic.model_choice import draw_paint
from mmw.traffic.roads.sidewalk_prims import Sidewalk
from mmw.traffic.route import PATH_STEP
from mmw.traffic.smoothing import gaussian_smooth
from mmw.traffic.spawn import seeded
from mmw.usd.vehicle_catalog import load_cyclists

CYCLING_SPEED = (4.2, 7.2)
"""Range of free speeds [m/s]. Source: adult bicyclists on shared paths, mean 12.8 mph, deviation 3.4 mph, J. Hummer et
al., Evaluation of Safety, Design, and Operation of Shared-Use Paths, FHWA-HRT-05-137, 2006; cut at one deviation."""

SPACING = 6.0
"""Distance between two cyclists at the start [m]; design value, as all below."""

PERSONAL_SPACE = 2.6
"""Gap between the middles of two cyclists at which the one behind stands still [m]."""

CURB_OFFSET = 0.45
"""From the edge of the road to the middle of a cyclist [m]."""

REACH = 6.0
"""The edge of the road is at most this far from the walk line [m]."""

SEARCH_STEP = 0.1
"""Of the search for the edge of the road [m]."""

TURN_SIGMA = 1.2
"""Gaussian on the path, standard deviation [m]."""

LATERAL_ACCELERATION = 2.0
"""Largest in curves [m/s^2]."""

ACCELERATION = 1.0
"""At which cyclists slow down before a curve and speed up after it [m/s^2]."""

LEAN_SIGMA = 0.2
"""Gaussian on the lean, standard deviation [s]."""

MIN_LENGTH = 40.0
"""Shorter stretches of road edge have no cyclists [m]."""


def simulate_cyclists(demand: TrafficDemand) -> list[VehicleTrack]:
    """Return the motion of `cyclist_count` cyclists near `spawn_center_m`.

    Returns:
        Tracks `cyc_001`, `cyc_002`... of role `vehicle`, by distance to the center; those of `vru_cyclist_ranks` have
        the role `vru`, and names after those of the connected pedestrians.

    Raises:
        InputError: If the town's road edges have fewer places than cyclists.
    """
    traffic, frame_count = demand.traffic, demand.frame_count
    count = traffic.cyclist_count
    if not count:
        return []
    lines = [line for walk in demand.town.sidewalks for line in road_edges(walk, demand.ground)]
    places = start_places(lines, CYCLING_SPEED[1] * frame_count / FRAME_RATE_HZ, SPACING)
    if len(places) < count:
        raise InputError(
            f"cyclist_count = {count}: the town's road edges beside walk lines have {len(places)} places; give at most "
            "that many"
        )
    (model,) = load_cyclists().values()
    chosen = nearest_places(lines, places, traffic.spawn_center_m, count)
    generators = [seeded(demand.seed, rank, 5) for rank in range(count)]
    speeds = np.array([float(generator.uniform(*CYCLING_SPEED)) for generator in generators])
    looks = [seeded(demand.seed_of_scene, rank, 5) for rank in range(count)]
    for generator in looks:
        generator.uniform(*CYCLING_SPEED)  # looks come after the speed, so that both seeds may be one
    limits = [curve_speeds(line) for line in lines]
    speeds_at = [float(lines[line].sample(limits[line], np.array([at]))[0]) for line, at in chosen]
    stations = follow_lines(chosen, lines, speeds, frame_count, PERSONAL_SPACE, limits, np.minimum(speeds, speeds_at))
    return [
        VehicleTrack(
            *_name(rank, traffic.vru_cyclist_ranks, len(traffic.vru_ranks)),
            model.name,
            draw_paint(model, looks[rank]),
            _lean(lines[line], stations[:, rank]),
        )
        for rank, (line, _) in enumerate(chosen)
    ]


def _name(rank: int, vru_ranks: Sequence[int], before: int) -> tuple[str, str]:
    if rank in vru_ranks:
        return f"vru_{before + vru_ranks.index(rank) + 1}", "vru"
    return f"cyc_{rank + 1:03d}", "vehicle"


def road_edges(walk: Sidewalk, ground: Ground) -> list[FollowedLine]:
    """Return the stretches of road edge beside a walk line, in the direction that has the curb on its right.

    Args:
        walk: The walk line.
        ground: The drivable surface.
    """
    line = smooth_line(walk.points, walk.is_closed, TURN_SIGMA)
    points, heading = line.points[:-1] if line.is_closed else line.points, line.heading[: len(line.points)]
    left = np.stack([-np.sin(heading), np.cos(heading)], axis=1)[: len(points)]
    sides = {sign: _edge(points, sign * left, ground) for sign in (1.0, -1.0)}
    sign = max(sides, key=lambda side: np.isfinite(sides[side][0]).sum())
    offset, height = sides[sign]
    riding = np.column_stack([points[:, :2] + (offset + CURB_OFFSET)[:, None] * (sign * left), height])
    parts = _stretches(riding, keeps_direction=sign > 0.0)
    return [smooth_line(part, is_whole and line.is_closed, TURN_SIGMA) for part, is_whole in parts]


def _edge(points: np.ndarray, aside: np.ndarray, ground: Ground) -> tuple[np.ndarray, np.ndarray]:
    """Return how far the road is from points to a side, and its height there [m], shape [N] each; NaN where it is not
    within `REACH`."""
    offset, height = np.full(len(points), np.nan), np.full(len(points), np.nan)
    for distance in np.arange(SEARCH_STEP, REACH, SEARCH_STEP):
        open_ = np.flatnonzero(np.isnan(offset))
        if not len(open_):
            break
        place = np.column_stack([points[open_, :2] + distance * aside[open_], points[open_, 2]])
        found = ground.heights(place)
        hit = np.isfinite(found)
        offset[open_[hit]], height[open_[hit]] = distance, found[hit]
    return offset, height


def _stretches(points: np.ndarray, keeps_direction: bool) -> list[tuple[np.ndarray, bool]]:
    """Return the runs of points that are there and long enough, each in its direction, and whether it is all points."""
    is_there = np.isfinite(points).all(axis=1)
    if is_there.all():
        parts = [(points, True)]
    else:
        first = int(np.argmin(is_there))  # a gap, so that no run of a closed line is cut at its seam
        points, is_there = np.roll(points, -first, axis=0), np.roll(is_there, -first)
        ends = np.flatnonzero(np.diff(np.concatenate([[False], is_there, [False]]).astype(int))).reshape(-1, 2)
        parts = [(points[start:stop], False) for start, stop in ends if (stop - start) * PATH_STEP >= MIN_LENGTH]
    return [(part if keeps_direction else part[::-1], is_whole) for part, is_whole in parts]


def curve_speeds(line: FollowedLine) -> np.ndarray:
    """Return the largest speed at each point of a line [m/s], shape [N]: what keeps the lateral acceleration in curves,
    and what reaches it with `ACCELERATION` before and after them."""
    curvature = np.abs(np.gradient(gaussian_smooth(line.heading, 0.5 * TURN_SIGMA / PATH_STEP), PATH_STEP))
    square = LATERAL_ACCELERATION / np.maximum(curvature, 1e-3)
    count = len(square)
    for _ in range(2):  # toward the front, then toward the back
        wide = np.tile(square, 3) if line.is_closed else square
        rise = 2.0 * ACCELERATION * PATH_STEP * np.arange(len(wide))
        square = (np.minimum.accumulate(wide - rise) + rise)[-2 * count :][:count][::-1]
    return np.sqrt(square)


def _lean(line: FollowedLine, stations: np.ndarray) -> np.ndarray:
    """Return poses at stations [m] of shape [F], leaning so that weight and centrifugal force are along the body."""
    poses = line.smooth_at(stations)
    heading = np.unwrap(2.0 * np.arctan2(poses[:, 5], poses[:, 6]))
    rate = gaussian_smooth(np.gradient(heading, 1.0 / FRAME_RATE_HZ), LEAN_SIGMA * FRAME_RATE_HZ)
    speed = np.gradient(stations, 1.0 / FRAME_RATE_HZ)
    roll = -np.arctan(speed * rate / GRAVITY)
    zero = np.zeros_like(roll)
    turn = np.stack([np.sin(0.5 * roll), zero, zero, np.cos(0.5 * roll)], axis=1)
    return compose(poses, make_pose(np.zeros((len(roll), 3)), turn))
