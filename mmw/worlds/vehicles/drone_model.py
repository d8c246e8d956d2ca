"""The quadrotor, from closed parts. Body frame: x forward, y left, z up, origin in the middle of the body.

Size: 0.35 m from motor to motor across, as small camera drones have; all numbers are design values [m].
"""

import numpy as np

from mmw.worlds.vehicles.pedestrian_models import limb
from mmw.worlds.vehicles.primitives import Shape, box, join, pod

NAME = "quadrotor"

PAINTS = ("white", "red", "graphite")
"""Variants of the lid; the first is the asset's own selection."""

DRONE_MATERIAL = {
    "shell": "plastic", "lid": "car_paint_<paint>", "motors": "car_rim", "rotors": "car_trim", "camera": "car_gloss",
}  # fmt: skip
"""Mesh of the drone -> material of the library."""

REACH = 0.35 / 2 / np.sqrt(2.0)
"""Distance of a motor from the middle along x and along y."""

ROTOR_LENGTH = 0.22
"""Two blades of a rotor, 8.7 inches."""

MOTOR_TOP = 0.035
"""Height of the rotors above the middle."""

LEG_LENGTH = 0.085

UP = np.array([0.0, 0.0, 1.0])


def build_drone() -> Shape:
    """Return the drone with the parts of `DRONE_MATERIAL`; its rotors stand still."""
    shapes = [
        pod((-0.095, -0.05, -0.032), (0.095, 0.05, 0.022), "shell", 12, 8),
        pod((-0.075, -0.04, 0.010), (0.055, 0.04, 0.032), "lid", 12, 8),
        pod((0.075, -0.022, -0.048), (0.115, 0.022, -0.010), "camera", 10, 6),
    ]
    for x in (1.0, -1.0):
        for y in (1.0, -1.0):
            hub = np.array([x * REACH, y * REACH, 0.0])
            top, low = hub + UP * MOTOR_TOP, hub - UP * LEG_LENGTH
            shapes += [
                limb((0.05 * x, 0.03 * y, -0.003), hub, ((0.0, 0.012), (1.0, 0.009)), "shell"),
                limb(hub - UP * 0.012, top, ((0.0, 0.013), (0.9, 0.013), (1.0, 0.006)), "motors"),
                limb(low, hub - UP * 0.005, ((0.0, 0.005), (1.0, 0.007)), "shell"),
            ]
            half = np.array([ROTOR_LENGTH / 2, 0.011, 0.0012] if x * y > 0 else [0.011, ROTOR_LENGTH / 2, 0.0012])
            shapes.append(box(top - half, top + half, "rotors"))
    return join(shapes)
