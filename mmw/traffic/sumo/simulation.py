"""Drive vehicles with SUMO on the lanes of a town, and place their bodies on the road."""

import numpy as np

from mmw.core.errors import InputError
from mmw.traffic.demand import TrafficDemand, TrafficResult
from mmw.traffic.idm.driver import STEP
from mmw.traffic.replay.recorded_vehicles import place_vehicles
from mmw.traffic.replay.trajectory_table import Trajectory
from mmw.traffic.spawn import vehicle_order
from mmw.traffic.sumo.fleet import SumoFleet, start_sumo

COMFORT = 2.4
"""Lines are made rounder for this acceleration [m/s^2]: SUMO begins and ends a change of lanes with a kink."""


def simulate_sumo(demand: TrafficDemand) -> TrafficResult:
    """Return the motion of all vehicles of a scenario, driven by SUMO.

    Raises:
        InputError: If SUMO fails, there is no room for the vehicles, or a vehicle that SUMO moved cannot stand on the
            road.
        MissingPackageError: If `libsumo` cannot be loaded, because a system library is missing.
    """
    fleet = start_sumo(demand)
    vehicles, cav_ranks = fleet.vehicles, fleet.cav_ranks
    states = _record(fleet)
    try:
        moves = [
            _trajectory(str(rank), states[:, rank], fleet.first, vehicle.shape.name)
            for rank, vehicle in enumerate(vehicles)
        ]
        ordered = [moves[rank] for rank in vehicle_order(cav_ranks, len(moves))]
        return TrafficResult(place_vehicles(demand, ordered, len(cav_ranks), comfort=COMFORT), notes=fleet.notes)
    except InputError as error:
        raise InputError(f"engine = 'sumo': {error}; another seed may do") from None


def _record(fleet: SumoFleet) -> np.ndarray:
    """Return x, y, z and angle of all vehicles in all steps, shape [N, V, 4]; NaN where one is not in the network."""
    states = np.full((int(np.ceil(fleet.duration / STEP)) + 1, len(fleet.vehicles), 4), np.nan)
    try:
        for row in states:
            for rank, x, y, z, angle, _, _ in fleet.process.step():
                row[rank] = x, y, z, angle
    finally:
        fleet.process.close()
    return states


def _trajectory(name: str, states: np.ndarray, first: float, model: str) -> Trajectory:
    """Return a vehicle's states as samples; time 0 is frame 0."""
    known = np.isfinite(states[:, 0])
    if known.sum() < 2:
        raise InputError(f"vehicle {name!r} was not inserted by SUMO; give fewer vehicles")
    time = STEP * np.arange(len(states)) - first
    x, y, z, angle = states[known].T
    return Trajectory(
        id=name,
        time=time[known],
        points=np.column_stack([x, y]),
        height=z,
        heading=np.unwrap(np.pi / 2 - np.radians(angle)),
        type=model,
        reference="front_bumper",
    )
