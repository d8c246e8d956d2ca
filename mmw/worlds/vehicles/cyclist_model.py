"""A person on a city bicycle, from closed parts. Body frame: x forward, y left, z up, origin on the ground.

The origin is midway between the axles. The rider sits upright and rests one foot on each pedal; wheels and legs do not
turn. Sizes are design values [m] for wheels of 28 inches; the rider has the proportions of `Figure`.
"""

import numpy as np

from mmw.worlds.vehicles.pedestrian_models import ANGLES, FIGURES, Figure, head, limb, shoe, trunk
from mmw.worlds.vehicles.primitives import Shape, join, pod, quads, weld

NAME = "cyclist"

RIDER = Figure(1.74, 1.0, trousers="cloth_dark", hair="hair_brown")

PAINTS = FIGURES["man"].colors
"""Variants of the shirt; the first is the asset's own selection."""

CYCLIST_MATERIAL = {
    "shirt": "cloth_<paint>", "trousers": RIDER.trousers, "skin": RIDER.skin, "hair": RIDER.hair, "eyes": "hair",
    "lips": "lips", "rubber": "car_rubber", "frame": "car_paint_graphite", "metal": "car_rim",
}  # fmt: skip
"""Mesh -> material of the library."""

WHEEL_RADIUS, TYRE_RADIUS = 0.34, 0.019
WHEELBASE = 1.06
SPOKES = 10
RIM_FACETS = 32

BOTTOM_BRACKET = np.array([-0.04, 0.0, 0.29])
CRANK = 0.17
SADDLE = np.array([-0.27, 0.0, 0.86])
HEAD_TUBE = np.array([0.36, 0.0, 0.86]), np.array([0.41, 0.0, 0.66])
GRIP = np.array([0.24, 0.27, 1.03])
LEAN = 0.16
"""Forward lean of the trunk, as the tangent of its angle against the vertical."""


def build_cyclist() -> Shape:
    """Return rider and bicycle with the parts of `CYCLIST_MATERIAL`."""
    shape = join([*_bicycle(), *_rider()])
    return shape.moved((0.0, 0.0, -float(shape.points[:, 2].min())))


def _tube(start, end, radius: float, part: str = "frame") -> Shape:
    return limb(start, end, ((0.0, radius), (1.0, radius)), part)


def _ring(center: np.ndarray, radius: float, thickness: float, part: str) -> Shape:
    """Return a torus in the plane of x and z."""
    around = 2 * np.pi * np.append(np.arange(RIM_FACETS), 0) / RIM_FACETS
    out = radius + thickness * np.cos(ANGLES)
    grid = np.empty((RIM_FACETS + 1, len(ANGLES), 3))
    grid[..., 0] = center[0] + np.cos(around)[:, None] * out
    grid[..., 1] = center[1] + thickness * np.sin(ANGLES)
    grid[..., 2] = center[2] + np.sin(around)[:, None] * out
    return weld(quads(grid[::-1], lambda _, __: part))


def _bicycle() -> list[Shape]:
    front, rear = (np.array([x, 0.0, WHEEL_RADIUS]) for x in (WHEELBASE / 2, -WHEELBASE / 2))
    shapes = []
    for hub in (front, rear):
        shapes.append(_ring(hub, WHEEL_RADIUS - TYRE_RADIUS, TYRE_RADIUS, "rubber"))
        shapes.append(_ring(hub, WHEEL_RADIUS - 2 * TYRE_RADIUS - 0.004, 0.009, "metal"))
        shapes.append(pod(hub - (0.02, 0.045, 0.02), hub + np.array([0.02, 0.045, 0.02]), "metal", 8, 4))
        for angle in 2 * np.pi * (np.arange(SPOKES) + 0.5) / SPOKES:
            out = np.array([np.cos(angle), 0.0, np.sin(angle)])
            shapes.append(_tube(hub + 0.01 * out, hub + (WHEEL_RADIUS - 2 * TYRE_RADIUS) * out, 0.002, "metal"))
    top, low = HEAD_TUBE
    seat = BOTTOM_BRACKET + 0.78 * (SADDLE - BOTTOM_BRACKET)
    shapes += [
        _tube(BOTTOM_BRACKET, SADDLE, 0.016), _tube(seat, top, 0.017), _tube(BOTTOM_BRACKET, low, 0.020),
        _tube(low - 0.15 * (low - top), top + np.array([-0.03, 0.0, 0.14]), 0.020),
    ]  # fmt: skip
    for side in (1.0, -1.0):
        aside = np.array([0.0, side, 0.0])
        shapes += [
            _tube(low + 0.02 * aside, front + 0.05 * aside, 0.012),
            _tube(BOTTOM_BRACKET + 0.03 * aside, rear + 0.055 * aside, 0.010),
            _tube(seat + 0.02 * aside, rear + 0.055 * aside, 0.008),
            _tube(BOTTOM_BRACKET + 0.06 * aside, _pedal(side) - 0.03 * aside, 0.011, "metal"),
            pod(_pedal(side) - (0.05, 0.05, 0.012), _pedal(side) + np.array([0.05, 0.05, 0.010]), "rubber", 8, 4),
            _tube(top + np.array([-0.03, 0.0, 0.14]), GRIP * (1, side, 1) - 0.09 * aside, 0.011, "metal"),
            pod(_grip(side) - (0.018, 0.06, 0.018), _grip(side) + np.array([0.018, 0.06, 0.018]), "rubber", 8, 4),
        ]
    shapes.append(pod(SADDLE - (0.14, 0.075, 0.0), SADDLE + np.array([0.13, 0.075, 0.06]), "rubber", 10, 6))
    return shapes


def _pedal(side: float) -> np.ndarray:
    """Return the middle of a pedal; the left one is in front."""
    return BOTTOM_BRACKET + np.array([side * CRANK, 0.12 * side, 0.0])


def _grip(side: float) -> np.ndarray:
    return GRIP * (1.0, side, 1.0)


def _rider() -> list[Shape]:
    h = RIDER.height
    hip = SADDLE + np.array([0.02, 0.0, 0.10])
    upper = join([*trunk(h, h, has_skirt=False), *head(h, RIDER)])
    points = upper.points - np.array([0.0, 0.0, 0.49 * h])
    points[:, 0] += LEAN * points[:, 2]
    shapes = [Shape(points + hip, upper.faces, upper.parts, upper.st)]
    shoulder = hip + np.array([LEAN * 0.305 * h, 0.0, 0.305 * h])
    for side in (1.0, -1.0):
        shapes += [*_leg(hip + np.array([0.0, 0.055 * h * side, 0.02]), side), *_arm(shoulder, side)]
    return shapes


def _leg(hip: np.ndarray, side: float) -> list[Shape]:
    h, ankle = RIDER.height, _pedal(side) + np.array([-0.06, -0.01 * side, 0.085])
    knee = _joint(hip, ankle, 0.25 * h, 0.245 * h, np.array([1.0, 0.0, 0.3]))
    thigh = ((-0.03, 0.02), (0.0, 0.034), (0.2, 0.051), (0.5, 0.049), (0.9, 0.039), (1.0, 0.037), (1.06, 0.026))
    shin = ((-0.1, 0.02), (-0.04, 0.034), (0.05, 0.037), (0.3, 0.041), (0.7, 0.034), (0.97, 0.030), (1.0, 0.024))
    sole = shoe(np.array([ankle[0], ankle[1], 0.0]), h, h)
    return [
        limb(hip, knee, tuple((share, radius * h) for share, radius in thigh), "trousers"),
        limb(knee, ankle, tuple((share, radius * h) for share, radius in shin), "trousers"),
        sole.moved((0.0, 0.0, float(_pedal(side)[2]) + 0.01)),
    ]


def _arm(shoulder: np.ndarray, side: float) -> list[Shape]:
    h, start = RIDER.height, shoulder + np.array([0.0, 0.104 * RIDER.height * side, 0.0])
    wrist = _grip(side) + np.array([-0.05, -0.01 * side, 0.045])
    elbow = _joint(start, wrist, 0.172 * h, 0.157 * h, np.array([0.0, 0.9 * side, -1.0]))
    upper = ((-0.1, 0.010), (-0.06, 0.021), (0.06, 0.031), (0.3, 0.031), (0.8, 0.026), (1.0, 0.025), (1.06, 0.016))
    lower = ((-0.12, 0.012), (-0.06, 0.022), (0.06, 0.025), (0.4, 0.023), (0.97, 0.017), (1.0, 0.013))
    fist = ((-0.1, 0.011), (0.1, 0.013), (0.4, 0.018), (0.75, 0.017), (0.95, 0.011), (1.0, 0.006))
    return [
        limb(start, elbow, tuple((share, radius * h) for share, radius in upper), "shirt"),
        limb(elbow, wrist, tuple((share, radius * h) for share, radius in lower), "shirt"),
        limb(wrist, _grip(side) + np.array([0.03, 0.0, 0.0]), tuple((s, r * h) for s, r in fist), "skin"),
    ]


def _joint(start: np.ndarray, end: np.ndarray, first: float, second: float, toward: np.ndarray) -> np.ndarray:
    """Return the joint of two bones of given lengths between two points, on the side of a direction; straight limbs
    where they are too far apart."""
    line = end - start
    distance = float(np.linalg.norm(line))
    line /= distance
    along = np.clip((distance**2 + first**2 - second**2) / (2 * distance), 0.0, first)
    aside = toward - (toward @ line) * line
    return start + along * line + np.sqrt(first**2 - along**2) * aside / np.linalg.norm(aside)
