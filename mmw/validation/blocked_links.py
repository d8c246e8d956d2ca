"""Trace links from roadside units to receivers along streets, whose line of sight buildings block."""

from functools import cache

import numpy as np

from mmw.channel import PathSolver, PlanarArray
from mmw.channel import statistics as st
from mmw.config import load_config
from mmw.core.resources import town_path
from mmw.scene import Receiver, Transmitter, load_scene
from mmw.traffic.roads.town_asset import open_town

MAST_M, RECEIVER_M = 4.0, 1.5
"""Heights of the antennas above the foot of the mast and above the road [m]."""

STEP_M = 15.0
"""Distance of receivers along a lane [m]."""

REACH_M = (30.0, 120.0)
"""Nearest and farthest receiver, in plan [m]."""

RAYS = 20_000


@cache
def blocked_links(scenario: str, carrier_hz: float, device: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return distance [m], loss [dB] and the share of power of mirror reflections alone, shape [L] each.

    The town has no traffic. Every link has its first obstacle, seen from the mast, in a building; one without any path
    has an infinite loss and no share.

    Args:
        scenario: A scenario of `configs/full.yaml` with a roadside unit.
        carrier_hz: Carrier frequency [Hz].
        device: Warp device.
    """
    own = next(row for row in load_config("full").scenarios if row.name == scenario)
    assert own.town is not None
    mast = np.add(own.rsus[0].position_m, (0.0, 0.0, MAST_M))
    scene = load_scene(own.town, physics="standard", device=device)
    places = _places(own.town, mast)
    away = places - mast
    distance = np.linalg.norm(away, axis=1)
    start = mast + 0.5 * away / distance[:, None]  # outside of the mast
    hit = scene.cast_rays(start, away)
    labels = np.array([row.label for row in scene.arrays.objects])
    is_blocked = (hit.distance < distance - 1.0) & (labels[np.maximum(hit.object_id, 0)] == "building")
    chosen = np.flatnonzero(is_blocked)
    array = PlanarArray(pattern="iso")
    scene.add(Transmitter("mast", position=tuple(mast), array=array))
    for row in chosen:
        scene.add(Receiver(f"place_{row}", position=tuple(places[row]), array=array))
    solver = PathSolver.preset("standard", samples_per_tx=RAYS, check_places=False)
    paths = solver(scene, carriers_hz=carrier_hz)
    rows = paths.at_carrier(carrier_hz)
    power = np.abs(rows.a) ** 2
    is_mirror = paths.kind[rows.row] == "specular"
    mirrored, total = (np.bincount(rows.link, weights, rows.link_count) for weights in (power * is_mirror, power))
    share = mirrored / np.where(total > 0.0, total, np.nan)
    loss = np.where(total > 0.0, st.path_loss_db(rows), np.inf)
    return distance[chosen], loss, share


def _places(town: str, mast: np.ndarray) -> np.ndarray:
    """Return points above the lanes of a town around a mast [m], shape [n, 3]."""
    lanes, found = open_town(town_path(town)).lanes.lanes, []
    for name in sorted(lanes):
        lane = lanes[name]
        if not lane.junction:
            rows = np.searchsorted(lane.plan_station, np.arange(5.0, lane.plan_length, STEP_M))
            found.append(lane.points[np.minimum(rows, len(lane.points) - 1)] + [0.0, 0.0, RECEIVER_M])
    places = np.concatenate(found)
    away = np.linalg.norm(places[:, :2] - mast[:2], axis=1)
    return places[(away > REACH_M[0]) & (away < REACH_M[1])]
