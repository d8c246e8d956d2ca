"""Limit the speed along a path: lane limit, comfort in bends and over crests, braking ahead."""

import numpy as np

from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.route import PATH_STEP
from mmw.traffic.vehicle_pose import Stance

LATERAL_ACCELERATION = 2.3
"""Design limit of sideways acceleration [m/s^2]; with the driver's control error it stays below 2.5."""

VERTICAL_ACCELERATION = 1.0
"""Design limit of vertical acceleration over crests and through sags [m/s^2]."""

PATH_JERK = 5.0
"""Design limit of the horizontal jerk that the path causes at constant speed [m/s^3]; changes of speed add to it."""

VERTICAL_JERK = 6.0
"""Design limit of the vertical jerk that the road causes at constant speed [m/s^3]."""

CURVE_BRAKING = 1.6
"""Deceleration ahead of a slower place [m/s^2]; with the control error it stays below 2."""

LOWEST_SPEED = 1.5
"""A place with a lower limit is driven at this speed [m/s]."""


def speed_limit(
    stance: Stance, graph: LaneGraph, factor: float, slow: tuple[float, float, float] | None = None
) -> np.ndarray:
    """Return the speed that a driver desires at every sample of a path.

    Args:
        stance: The body along the path.
        graph: Lanes with their limits.
        factor: The driver's share of the lane's limit.
        slow: First and last station [m] of a stretch with a limit of its own, and that limit [m/s].

    Returns:
        Speed [m/s], shape [N]; it falls by at most `CURVE_BRAKING` and says nothing about speeding up.
    """
    line = stance.track.line
    lane = np.minimum(np.searchsorted(line.ends, line.station, side="right"), len(line.lanes) - 1)
    speed = factor * np.array([graph.lanes[name].speed for name in line.lanes])[lane]
    speed = np.minimum(speed, np.maximum(comfort_speed(stance.columns[:, [0, 1, 3]]), LOWEST_SPEED))
    if slow is not None:
        inside = (line.station >= slow[0]) & (line.station <= slow[1])
        speed = np.where(inside, np.minimum(speed, slow[2]), speed)
    return brake_ahead(speed, 2 * CURVE_BRAKING * line.station)


def comfort_speed(body: np.ndarray) -> np.ndarray:
    """Return the speed at which a path is within the limits of acceleration and jerk [m/s].

    Args:
        body: Points every `PATH_STEP` [m], shape [N, 3].
    """
    second = np.gradient(np.gradient(body, PATH_STEP, axis=0), PATH_STEP, axis=0)
    third = np.gradient(second, PATH_STEP, axis=0)
    tiny = 1e-9
    return np.minimum.reduce(
        [
            np.sqrt(LATERAL_ACCELERATION / (np.hypot(second[:, 0], second[:, 1]) + tiny)),
            np.sqrt(VERTICAL_ACCELERATION / (np.abs(second[:, 2]) + tiny)),
            np.cbrt(PATH_JERK / (np.hypot(third[:, 0], third[:, 1]) + tiny)),
            np.cbrt(VERTICAL_JERK / (np.abs(third[:, 2]) + tiny)),
        ]
    )


def brake_ahead(speed: np.ndarray, ramp: np.ndarray) -> np.ndarray:
    """Return speeds from which a driver can brake to the later ones; `ramp` is 2 a s at each of them [m^2/s^2]."""
    return np.sqrt(np.maximum(np.minimum.accumulate((speed**2 + ramp)[::-1])[::-1] - ramp, 0.0))
