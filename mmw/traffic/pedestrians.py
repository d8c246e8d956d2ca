"""Move people on sidewalks: each follows the walk line of a block at a pace of their own, all in one direction.

Faster people slow down behind slower ones. Nobody crosses a street.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from mmw.core.constants import FRAME_RATE_HZ
from mmw.core.errors import InputError
from mmw.traffic.demand import TrafficDemand, VehicleTrack
from mmw.traffic.followed_line import follow_lines, nearest_places, smooth_line, start_places
from mmw.traffic.model_choice import draw_paint
from mmw.traffic.spawn import seeded
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

TURN_SIGMA = 0.35
"""Gaussian on the path, standard deviation [m]: no turning on the spot."""


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
    paths = [smooth_line(sidewalk.points, sidewalk.is_closed, TURN_SIGMA) for sidewalk in demand.town.sidewalks]
    places = start_places(paths, WALKING_SPEED[1] * (frame_count / FRAME_RATE_HZ), SPACING)
    if len(places) < count:
        raise InputError(
            f"pedestrian_count = {count}: the town's sidewalks have {len(places)} places; give at most that many"
        )
    chosen = nearest_places(paths, places, center, count)
    speeds, models, paints = [], [], []
    for rank in range(count):
        generator = seeded(seed, rank, 2)
        speeds.append(float(generator.uniform(*WALKING_SPEED)))
        generator = seeded(demand.seed_of_scene, rank, 2)
        generator.uniform(*WALKING_SPEED)  # looks come after the speed, so that both seeds may be one
        models.append(_draw_figure(figures, generator))
        paints.append(draw_paint(figures[models[-1]], generator))
    stations = follow_lines(chosen, paths, np.array(speeds), frame_count, PERSONAL_SPACE)
    names = [_name(rank, demand.traffic.vru_ranks) for rank in range(count)]
    poses = [
        paths[line].smooth_at(stations[:, rank]) if names[rank][1] == "vru" else paths[line].at(stations[:, rank])
        for rank, (line, _) in enumerate(chosen)
    ]
    return list(map(VehicleTrack, *zip(*names, strict=True), models, paints, poses))


def _name(rank: int, vru_ranks: Sequence[int]) -> tuple[str, str]:
    """Return name and role of a person; connected ones are `vru_1`, `vru_2`... in the order of `vru_ranks`."""
    return (f"vru_{vru_ranks.index(rank) + 1}", "vru") if rank in vru_ranks else (f"ped_{rank + 1:03d}", "pedestrian")


def _draw_figure(figures: Mapping[str, ActorModel], generator: np.random.Generator) -> str:
    is_child = generator.random() < CHILD_SHARE
    adults = [name for name in figures if name != "child"]
    if "child" in figures and (is_child or not adults):
        return "child"
    return adults[int(generator.integers(len(adults)))]
