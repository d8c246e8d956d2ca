"""Compute the acceleration of a driver behind a leader, in bends and before a stop line, with limited jerk."""

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

CLOSING = 2 * sqrt(ACCELERATION * BRAKING)
"""Denominator of the term for the closing speed [m/s^2]."""

PREVIEW = 0.5
"""A driver looks this far ahead in time at the speed that the road allows [s]."""


def follow_leader(speed: float, desired: float, headway: float, gap: float, leader_speed: float) -> float:
    """Return the acceleration of the intelligent driver model [m/s^2].

    Args:
        speed: Own speed [m/s].
        desired: Speed on a free road [m/s], > 0.
        headway: Time gap [s].
        gap: Distance from the front bumper to the leader's rear bumper [m]; inf without a leader.
        leader_speed: Speed of the leader [m/s].

    Source: Treiber, Hennecke, Helbing, Phys. Rev. E 62 (2000), 1805, equations 3 and 4, with exponent 4; above the
    desired speed no harder than the comfortable deceleration.
    """
    free = max(ACCELERATION * (1 - (speed / desired) ** 4), -BRAKING)
    if gap == inf:
        return free
    closing = speed * (speed - leader_speed) / CLOSING
    target = STANDSTILL_GAP + max(0.0, speed * headway + closing)
    return free - ACCELERATION * (target / max(gap, 0.1)) ** 2


def desired_acceleration(car: Car, gap: float, leader_speed: float) -> float:
    """Return the acceleration that the driver desires [m/s^2].

    Bends and stop lines set speeds at points ahead, followed with a preview.
    """
    speed, station = car.speed, car.station
    desired = follow_leader(speed, car.desired_speed(station), car.headway, gap, leader_speed)
    bend = (car.desired_speed(station + speed * PREVIEW) - speed) / PREVIEW
    if bend < desired:
        desired = bend
    left = car.stop_station() - car.front - speed * PREVIEW
    if left < inf:
        stop = (sqrt(2 * car.stop_braking * max(0.0, left)) - speed) / PREVIEW
        if stop < desired:
            desired = stop
    return max(desired, -HARDEST_BRAKING)


def request_distance(speed: float) -> float:
    """Return the distance from a stop line at which a driver requests the junction [m], at a speed [m/s].

    It is a little longer than the planned braking, so that a vehicle that may enter at once need not brake.
    """
    return speed**2 / (2 * STOP_BRAKING) + (PREVIEW + 0.3) * speed + 2.0


def integrate(car: Car, desired: float) -> None:
    """Move a vehicle by one step with linearly changing acceleration."""
    if car.speed == 0.0 and desired < 0.1:
        car.acceleration = 0.0
        return
    before = car.acceleration
    after = min(max(desired, before - JERK * STEP), before + JERK * STEP)
    after = max(after, -sqrt(2 * JERK * car.speed))  # zero acceleration can be reached before the vehicle stops
    speed = car.speed + 0.5 * STEP * (before + after)
    if speed <= 0.0:
        car.stand_at(car.station + max(0.0, car.speed * STEP / 3))
        car.speed = car.acceleration = 0.0
        return
    car.stand_at(car.station + max(0.0, car.speed * STEP + STEP**2 * (2 * before + after) / 6))
    car.speed, car.acceleration = speed, after
