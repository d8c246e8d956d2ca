"""Move people on sidewalks: each follows the walk line of a block at a pace of their own, all in one direction.

Faster people slow down behind slower ones. Nobody crosses a street.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mmw.core.constants import FRAME_RATE_HZ
from mmw.core.errors import InputError
from mmw.traffic.demand import TrafficDemand, VehicleTrack
from mmw.traffic.polyline import arc_length, sample_polyline
from mmw.traffic.roads.sidewalk_prims import Sidewalk
from mmw.traffic.route import PATH_STEP
from mmw.traffic.smoothing import gaussian_smooth
from mmw.traffic.spawn import draw_paint, seeded
from mmw.usd.vehicle_catalog import ActorModel, load_figures

WALKING_SPEED = (0.9, 1.6)
"""Range of free walking speeds [m/s]. Source: mean 1.34, deviation 0.26 m/s, Weidmann, Transporttechnik der
Fussgaenger, ETH Zuerich 1993, section 3.1; cut at about 1.5 deviations."""

CHILD_SHARE = 0.15
"""Share of children; design value."""

SPACING = 2.0
"""Distance between two people at the start [m]."""

PERSONAL_SPACE = 0.9
"""Gap between the middles of two people at which the one behind stands still [m]; design value."""

RELAXATION = 0.5
"""Time in which a person reaches the desired speed [s]. Source: Helbing and Molnar, Phys. Rev. E 51 (1995), 4282."""

TURN_SIGMA = 0.35
"""Gaussian on the path, standard deviation [m]: no turning on the spot."""


@dataclass(frozen=True)
class _Path:
    """A walk line, smoothed and equally spaced."""

    points: np.ndarray
    """Shape [N, 3] [m]."""
    heading: np.ndarray
    """Direction of walking [rad], continuous, shape [N]."""
    length: float
    is_closed: bool

    def at(self, station: np.ndarray) -> np.ndarray:
        """Return poses at stations [m], shape [F, 7]."""
        station = station % self.length if self.is_closed else station
        along = PATH_STEP * np.arange(len(self.points))
        x, y, z = (np.interp(station, along, self.points[:, axis]) for axis in range(3))
        heading = np.interp(station, along, self.heading)
        level = np.zeros_like(x)
        return np.stack([x, y, z, level, level, np.sin(0.5 * heading), np.cos(0.5 * heading)], axis=1)


def simulate_pedestrians(demand: TrafficDemand) -> list[VehicleTrack]:
    """Return the motion of `pedestrian_count` pedestrians near `spawn_center_m`.

    Returns:
        Tracks `ped_001`, `ped_002`... of role `pedestrian`, by distance to the center; those of `vru_ranks` are called
        `vru_1`, `vru_2`... and have the role `vru`.

    Raises:
        InputError: If the town's sidewalks have fewer places than people.
    """
    count, center, seed = demand.traffic.pedestrian_count, demand.traffic.spawn_center_m, demand.seed
    if not count:
        return []
    if not demand.town.sidewalks:
        raise InputError("pedestrian_count: the town has no walk lines (prims below Walks); use 0, or a town with them")
    figures, frame_count = load_figures(), demand.frame_count
    paths = [_smooth(sidewalk) for sidewalk in demand.town.sidewalks]
    places = _places(paths, frame_count / FRAME_RATE_HZ)
    if len(places) < count:
        raise InputError(
            f"pedestrian_count = {count}: the town's sidewalks have {len(places)} places; give at most that many"
        )
    position = np.array([paths[line].at(np.array([station]))[0, :3] for line, station in places]).reshape(-1, 3)
    distance = np.linalg.norm(position - np.asarray(center, np.float64), axis=1)
    chosen = [places[index] for index in np.lexsort((np.arange(len(places)), distance))[:count]]
    speeds, models, paints = [], [], []
    for rank in range(count):
        generator = seeded(seed, rank, 2)
        speeds.append(float(generator.uniform(*WALKING_SPEED)))
        models.append(_draw_figure(figures, generator))
        paints.append(draw_paint(figures[models[-1]], generator))
    stations = _walk(chosen, paths, np.array(speeds), frame_count)
    poses = [paths[line].at(stations[:, rank]) for rank, (line, _) in enumerate(chosen)]
    names = [_name(rank, demand.traffic.vru_ranks) for rank in range(count)]
    return list(map(VehicleTrack, *zip(*names, strict=True), models, paints, poses))


def _name(rank: int, vru_ranks: Sequence[int]) -> tuple[str, str]:
    """Return name and role of a person; connected ones are `vru_1`, `vru_2`... in the order of `vru_ranks`."""
    return (f"vru_{vru_ranks.index(rank) + 1}", "vru") if rank in vru_ranks else (f"ped_{rank + 1:03d}", "pedestrian")


def _smooth(sidewalk: Sidewalk) -> _Path:
    """Return a line with rounded corners, sampled every `PATH_STEP`."""
    points = np.concatenate([sidewalk.points, sidewalk.points[:1]]) if sidewalk.is_closed else sidewalk.points
    along = arc_length(points[:, :2])
    count = max(2, int(np.floor(along[-1] / PATH_STEP)))
    station = along[-1] * np.arange(count) / count if sidewalk.is_closed else PATH_STEP * np.arange(count + 1)
    fine = sample_polyline(points, along, station)
    sigma = TURN_SIGMA / PATH_STEP
    if sidewalk.is_closed:
        reach = min(count, int(6 * sigma))
        padded = np.concatenate([fine[-reach:], fine, fine[:reach]])
        fine = gaussian_smooth(padded, sigma)[reach : reach + count]
        fine = np.concatenate([fine, fine[:1]])
    else:
        fine = gaussian_smooth(fine, sigma)
    move = np.diff(fine[:, :2], axis=0)
    direction = np.unwrap(np.arctan2(move[:, 1], move[:, 0]))
    return _Path(fine, np.append(direction, direction[-1]), PATH_STEP * (len(fine) - 1), sidewalk.is_closed)


def _places(paths: Sequence[_Path], duration: float) -> list[tuple[int, float]]:
    """Return line and station of every start position; on open lines with room to walk on."""
    places = []
    for line, path in enumerate(paths):
        room = 0.0 if path.is_closed else WALKING_SPEED[1] * duration + 1.0
        places += [(line, float(station)) for station in np.arange(0.0, path.length - SPACING - room, SPACING)]
    return places


def _draw_figure(figures: Mapping[str, ActorModel], generator: np.random.Generator) -> str:
    is_child = generator.random() < CHILD_SHARE
    adults = [name for name in figures if name != "child"]
    if "child" in figures and (is_child or not adults):
        return "child"
    return adults[int(generator.integers(len(adults)))]


def _walk(
    chosen: Sequence[tuple[int, float]], paths: Sequence[_Path], speeds: np.ndarray, frame_count: int
) -> np.ndarray:
    """Return the station of every person in every frame [m], shape [F, P].

    Source: relaxation to the desired speed, Helbing and Molnar 1995, equation 2, in one dimension; the speed desired
    behind another person falls linearly to zero over one second of distance ahead of the personal space.
    """
    line = np.array([where for where, _ in chosen])
    station = np.array([start for _, start in chosen])
    length = np.array([paths[where].length if paths[where].is_closed else np.inf for where, _ in chosen])
    speed, step = speeds.copy(), 1.0 / FRAME_RATE_HZ
    same = (line[:, None] == line[None, :]) & ~np.eye(len(line), dtype=bool)
    out = np.empty((frame_count, len(line)))
    for frame in range(frame_count):
        out[frame] = station
        ahead = station[None, :] - station[:, None]
        ahead = np.where(np.isfinite(length)[:, None], ahead % length[:, None], np.where(ahead > 0, ahead, np.inf))
        gap = np.where(same, ahead, np.inf).min(axis=1, initial=np.inf)
        desired = np.minimum(speeds, np.maximum(0.0, gap - PERSONAL_SPACE))
        speed = speed + step / RELAXATION * (desired - speed)
        station = station + step * speed
    return out
