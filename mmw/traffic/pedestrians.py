"""People on the sidewalks: each follows the walk line of a block, at a pace of their own, behind whoever is ahead.

Everybody on one line goes the same way round, so two people meet only on different sides of a street, and who is faster
slows down behind who is slower. Nobody crosses a street.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mmw.core.constants import FRAME_RATE_HZ
from mmw.core.errors import InputError
from mmw.traffic.idm.run import VehicleTrack
from mmw.traffic.roads.sidewalk_prims import Walk
from mmw.traffic.smoothing import gaussian_smooth
from mmw.traffic.spawn import seeded
from mmw.usd.vehicle_catalog import ActorModel

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
"""Time in which a person takes up the wanted speed [s]. Source: Helbing and Molnar, Phys. Rev. E 51 (1995), 4282."""

TURN_SIGMA = 0.35
"""Gaussian on the path, standard deviation [m]: nobody turns on the spot."""

PATH_STEP = 0.1
"""Spacing of path samples [m]."""


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


def walk_people(
    walks: Sequence[Walk],
    figures: Mapping[str, ActorModel],
    *,
    frame_count: int,
    count: int,
    center: Sequence[float],
    seed: int,
) -> list[VehicleTrack]:
    """Return the motion of pedestrians near a place.

    Args:
        walks: The town's walk lines.
        figures: Models by name; one called `child` is drawn with its own share.
        frame_count: F, frames at 100 Hz.
        count: People in all; they start at the places nearest to `center`, at least 2 m apart on a line.
        center: World frame [m], shape [3].
        seed: Same seed, same motion.

    Returns:
        Tracks `ped_001`, `ped_002`... of role `pedestrian`, by distance to `center`.

    Raises:
        InputError: If the walks have fewer places than people.
    """
    duration = frame_count / FRAME_RATE_HZ
    paths = [_smooth(walk) for walk in walks]
    places = _places(paths, duration)
    if not walks:
        raise InputError("pedestrian_count: the town has no walk lines (prims below Walks); use 0, or a town with them")
    if len(places) < count:
        raise InputError(
            f"pedestrian_count = {count}: the town's sidewalks have {len(places)} places; ask for at most that many"
        )
    position = np.array([paths[line].at(np.array([station]))[0, :3] for line, station in places]).reshape(-1, 3)
    distance = np.linalg.norm(position - np.asarray(center, np.float64), axis=1)
    chosen = [places[index] for index in np.lexsort((np.arange(len(places)), distance))[:count]]
    speeds, models, paints = [], [], []
    for rank in range(count):
        generator = seeded(seed, rank, 2)
        speeds.append(float(generator.uniform(*WALKING_SPEED)))
        models.append(_draw_figure(figures, generator))
        paints.append(figures[models[-1]].paints[int(generator.integers(len(figures[models[-1]].paints)))])
    stations = _walk(chosen, paths, np.array(speeds), frame_count)
    return [
        VehicleTrack(
            f"ped_{rank + 1:03d}",
            "pedestrian",
            models[rank],
            paints[rank],
            paths[chosen[rank][0]].at(stations[:, rank]),
        )
        for rank in range(count)
    ]


def _smooth(walk: Walk) -> _Path:
    """Return a line with rounded corners, sampled every `PATH_STEP`."""
    points = np.concatenate([walk.points, walk.points[:1]]) if walk.is_closed else walk.points
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points[:, :2], axis=0), axis=1))])
    step = PATH_STEP
    count = max(2, int(np.floor(along[-1] / step)))
    station = along[-1] * np.arange(count) / count if walk.is_closed else step * np.arange(count + 1)
    fine = np.stack([np.interp(station, along, points[:, axis]) for axis in range(3)], axis=1)
    sigma = TURN_SIGMA / step
    if walk.is_closed:
        reach = min(count, int(6 * sigma))
        padded = np.concatenate([fine[-reach:], fine, fine[:reach]])
        fine = gaussian_smooth(padded, sigma)[reach : reach + count]
        fine = np.concatenate([fine, fine[:1]])
    else:
        fine = gaussian_smooth(fine, sigma)
    move = np.diff(fine[:, :2], axis=0)
    way = np.unwrap(np.arctan2(move[:, 1], move[:, 0]))
    return _Path(fine, np.append(way, way[-1]), step * (len(fine) - 1), walk.is_closed)


def _places(paths: Sequence[_Path], duration: float) -> list[tuple[int, float]]:
    """Return line and station of every place where somebody may start; on open lines with room to walk on."""
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
    """Return the station of everybody at every frame [m], shape [F, P].

    Source: relaxation to the wanted speed, Helbing and Molnar 1995, equation 2, in one dimension; the speed wanted
    behind somebody falls linearly to zero over one second of distance ahead of the personal space.
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
        wanted = np.minimum(speeds, np.maximum(0.0, gap - PERSONAL_SPACE))
        speed = speed + step / RELAXATION * (wanted - speed)
        station = station + step * speed
    return out
