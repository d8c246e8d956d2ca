"""Small things along city streets: advertising columns, cycle racks, guard rails."""

import numpy as np

from mmw.worlds.towns.primitives import box, lathe, merge
from mmw.worlds.towns.prop_parts import ROOT, Piece


def advertising_column(rng: np.random.Generator) -> list[Piece]:
    """Return a column for posters, 1.3 m across and 3.5 m tall."""
    return [
        ("body", lathe([(0.62, 0.25), (0.62, 3.05)], 10), "plastic", "static"),
        ("base", lathe([(0.70, -ROOT), (0.70, 0.3)], 10), "concrete_structure", "static"),
        ("cap", lathe([(0.78, 3.0), (0.78, 3.15), (0.0, 3.5)], 10), "metal_pole", "static"),
    ]


def cycle_rack(rng: np.random.Generator) -> list[Piece]:
    """Return four hoops to lock cycles to, 3 m along y."""
    hoops = []
    for y in (-1.2, -0.4, 0.4, 1.2):
        hoops += [box((0.05, 0.05, 0.83 + 0.3), (x, y, 0.5 * (0.83 - 0.3))) for x in (-0.35, 0.35)]
        hoops.append(box((0.77, 0.06, 0.05), (0.0, y, 0.85)))
    return [("hoops", merge(hoops), "metal_pole", "static")]


def guard_rail(rng: np.random.Generator) -> list[Piece]:
    """Return a steel guard rail, 4 m along y, its face to +x."""
    posts = [box((0.1, 0.12, 0.72 + ROOT), (-0.08, y, 0.5 * (0.72 - ROOT))) for y in (-1.0, 1.0)]
    return [
        ("rail", box((0.08, 4.0, 0.31), (0.0, 0.0, 0.6)), "metal_pole", "guard_rail"),
        ("posts", merge(posts), "metal_pole", "guard_rail"),
    ]
