"""How a driver holds the speed: behind a leader, in bends, before a stop line, with limited jerk."""

from math import inf, sqrt

from mmw.traffic.idm.vehicle import STOP_BRAKING, Car

STEP = 0.05
"""Time step of the engine [s]."""

ACCELERATION = 1.8
"""IDM: comfortable acceleration [m/s^2]."""

BRAKING = 2.0
"""IDM: comfortable deceleration [m/s^2]."""

STANDSTILL_GAP = 2.0
"""IDM: gap between bumpers at rest [m]."""

HARDEST_BRAKING = 6.0
"""Limit of deceleration [m/s^2]."""

JERK = 5.0
"""Limit of the change of acceleration [m/s^3]."""

PREVIEW = 0.5
"""A driver looks this far ahead in time at the speed that the road asks for [s]."""


def follow_leader(speed: float, wanted: float, headway: float, gap: float, leader_speed: float) -> float:
    """Return the acceleration of the intelligent driver model [m/s^2].

    Args:
        speed: Own speed [m/s].
        wanted: Speed on a free road [m/s], > 0.
        headway: Time gap [s].
        gap: Distance from the front bumper to the leader's rear bumper [m]; inf without a leader.
        leader_speed: Speed of the leader [m/s].

    Source: Treiber, Hennecke, Helbing, Phys. Rev. E 62 (2000), 1805, equations 3 and 4, with exponent 4; above the
    wanted speed no harder than the comfortable deceleration.
    """
    free = max(ACCELERATION * (1 - (speed / wanted) ** 4), -BRAKING)
    if gap == inf:
        return free
    closing = speed * (speed - leader_speed) / (2 * sqrt(ACCELERATION * BRAKING))
    target = STANDSTILL_GAP + max(0.0, speed * headway + closing)
    return free - ACCELERATION * (target / max(gap, 0.1)) ** 2


def desired_acceleration(car: Car, gap: float, leader_speed: float) -> float:
    """Return the acceleration that the driver wants [m/s^2].

    Bends and stop lines are speeds to be reached at a point, followed with a preview.
    """
    speed = car.speed
    wanted = follow_leader(speed, car.wanted_speed(car.station), car.headway, gap, leader_speed)
    ahead = car.station + speed * PREVIEW
    wanted = min(wanted, (car.wanted_speed(ahead) - speed) / PREVIEW)
    left = car.stop_station() - car.nose - speed * PREVIEW
    wanted = min(wanted, (sqrt(2 * car.stop_braking * max(0.0, left)) - speed) / PREVIEW)
    return max(wanted, -HARDEST_BRAKING)


def asking_distance(speed: float) -> float:
    """Return how far from a stop line a driver looks whether the junction is free [m], at a speed [m/s].

    That is the way to stop as planned and some more, so that who is let in at once need not brake.
    """
    return speed**2 / (2 * STOP_BRAKING) + (PREVIEW + 0.3) * speed + 2.0


def integrate(car: Car, wanted: float) -> None:
    """Move a vehicle by one step with linearly changing acceleration."""
    if car.speed == 0.0 and wanted < 0.1:
        car.acceleration = 0.0
        return
    before = car.acceleration
    after = min(max(wanted, before - JERK * STEP), before + JERK * STEP)
    after = max(after, -sqrt(2 * JERK * car.speed))  # can still be let go before the vehicle stands
    speed = car.speed + 0.5 * STEP * (before + after)
    if speed <= 0.0:
        car.station += max(0.0, car.speed * STEP / 3)
        car.speed = car.acceleration = 0.0
        return
    car.station += max(0.0, car.speed * STEP + STEP**2 * (2 * before + after) / 6)
    car.speed, car.acceleration = speed, after
