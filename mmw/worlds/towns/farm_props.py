"""Farm props: grain silos, barns, hay bales, field fences, a water tower."""

import numpy as np

from mmw.worlds.towns.primitives import beam, box, circle, lathe, place, prism
from mmw.worlds.towns.prop_parts import ROOT, Piece, block, piece, pole, upright

SILO_RADIUS = 3.0
"""Radius of a grain silo [m]; design value."""
SILO_HEIGHT = (12.0, 16.0)
"""Lowest and highest wall of a grain silo [m]; design values."""
BARN = (20.0, 12.0)
"""Length and width of a barn [m]; design values."""


def silo(rng: np.random.Generator) -> list[Piece]:
    """Return a grain silo of brick, 6 m across and 12 to 16 m tall, with a conical metal roof and a ladder."""
    height = round(float(rng.uniform(*SILO_HEIGHT)), 2)
    rim, beside = height - 0.15, SILO_RADIUS + 0.15
    ladder = [box((0.07, 0.07, height - 2.0), (beside, y, 0.5 * height + 1.0)) for y in (-0.25, 0.25)]
    rungs = [box((0.06, 0.5, 0.06), (beside, 0.0, z)) for z in np.arange(2.5, height - 0.5, 1.5)]
    ties = [box((0.3, 0.06, 0.06), (SILO_RADIUS, y, z)) for y in (-0.25, 0.25) for z in (2.6, height - 0.6)]
    eaves = SILO_RADIUS + 0.2
    roof = lathe([(eaves, rim), (eaves, rim + 0.3), (0.4, rim + 2.0), (0.0, rim + 2.1)], 16)
    return [
        piece("wall", "brick_facade", "building", pole(height, SILO_RADIUS, sides=16)),
        piece("roof", "metal_fascia", "building", roof),
        piece("ladder", "metal_pole", "building", *ladder, *rungs, *ties),
        piece("door", "metal_pole", "building", box((0.5, 1.2, 2.0 + 0.3), (-SILO_RADIUS + 0.15, 0.0, 0.85))),
    ]


def _barn(walls: str) -> list[Piece]:
    """Return a barn of 20 x 12 m whose gables look along x, with double doors in both."""
    half_length, half_width = 0.5 * BARN[0], 0.5 * BARN[1]
    eaves, ridge = 4.6, 8.8
    rise = (ridge - eaves) / half_width
    gable = [(-half_width, -ROOT), (half_width, -ROOT), (half_width, eaves), (0, ridge), (-half_width, eaves)]
    out, thick = half_width + 0.6, 0.22
    low, top = eaves - 0.6 * rise - 0.03, ridge - 0.03
    slopes = [(-out, low), (0, top), (out, low), (out, low + thick), (0, top + thick), (-out, low + thick)]
    doors = [
        box((0.12, 1.95, 3.9 + 0.3), (side * half_length, y, 0.5 * (3.9 - 0.3))) for side in (-1, 1) for y in (-1, 1)
    ]
    rails = [box((0.16, 6.4, 0.16), (side * half_length, 0.0, 4.05)) for side in (-1, 1)]
    panes = [box((1.6, 0.1, 1.0), (x, side * half_width, 2.6)) for side in (-1, 1) for x in (-7.0, -3.5, 0.0, 3.5, 7.0)]
    return [
        piece("walls", walls, "building", upright(prism(np.array(gable), -half_length, half_length))),
        piece("roof", "tile_roof", "building", upright(prism(np.array(slopes), -half_length - 0.5, half_length + 0.5))),
        piece("doors", "bark" if walls == "wood" else "wood", "building", *doors),
        piece("rails", "metal_pole", "building", *rails),
        piece("windows", "window_glass", "building", *panes),
    ]


_BALE = upright(prism(circle(0.75, 10), -0.5 * 1.25, 0.5 * 1.25))
_LEG_ANGLES = np.pi * (0.25 + 0.5 * np.arange(5))
_BRACE_ENDS = [(3.0 * np.cos(a), 3.0 * np.sin(a), 6.5) for a in _LEG_ANGLES]

FARM: dict[str, list[Piece]] = {
    "barn": _barn("brick_facade"),
    "wooden_barn": _barn("wood"),
    "hay_bales": [  # three round bales, two on the ground and one on top of them
        piece(
            "bales", "wood", "static",
            *(place(_BALE, (0.06 * k, y, z))
              for k, (y, z) in enumerate([(-0.78, 0.58), (0.78, 0.58), (0.0, 0.58 + 1.29)])),
        ),
    ],
    "field_fence": [  # posts and two rails, 6 m along y
        piece("posts", "wood", "fence", *(block(0.12, 0.12, 1.25, 0.0, y) for y in (-2.5, 0.0, 2.5))),
        piece("rails", "wood", "fence", *(box((0.05, 6.0, 0.12), (0.05, 0.0, z)) for z in (0.55, 1.05))),
    ],
    "water_tower": [  # a metal tank on four braced legs, 20 m
        piece("tank", "metal_fascia", "building",
              lathe([(0.9, 11.6), (3.2, 12.8), (3.2, 17.5), (0.4, 19.4), (0.0, 19.6)], 12)),
        piece(
            "legs", "metal_pole", "building",
            *(beam((3.4 * np.cos(a), 3.4 * np.sin(a), -ROOT), (2.6 * np.cos(a), 2.6 * np.sin(a), 13.0), 0.35)
              for a in _LEG_ANGLES[:4]),
            *(beam(_BRACE_ENDS[k], _BRACE_ENDS[k + 1], 0.18) for k in range(4)),
        ),
        piece("pipe", "metal_pole", "building", pole(11.8, 0.4, sides=8)),
    ],
}  # fmt: skip
