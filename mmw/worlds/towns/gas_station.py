"""The gas station in three props: a canopy that stands over a driveway, a shop, and a sign with prices.

The canopy's origin lies in the middle of the driveway, which runs along y between two rows of islands.
"""

import numpy as np

from mmw.worlds.towns.primitives import box, merge
from mmw.worlds.towns.prop_parts import ROOT, Piece

CANOPY = (14.0, 22.0, 0.9)
"""Canopy across and along the driveway, and its thickness [m]; design values."""
CLEAR = 5.0
"""Clear height below the canopy [m]; design value, 4.5 m of headroom that trucks are given and half a metre."""
DRIVEWAY = 6.0
"""Free width between the two rows of islands [m]; design value."""
ISLAND = (1.2, 6.6, 0.2)
"""Width, length and height of an island [m]; design values."""


def gas_canopy(rng: np.random.Generator) -> list[Piece]:
    """Return a canopy of 22 x 14 m, 5 m clear, on four columns, with four islands and four pumps below."""
    deep, long, thick = CANOPY
    x, y = 0.5 * (DRIVEWAY + ISLAND[0]), 0.25 * long - 0.6
    corners = [(i * x, j * y) for i in (-1, 1) for j in (-1, 1)]
    islands = [box((ISLAND[0], ISLAND[1], ISLAND[2] + ROOT), (i, j, 0.5 * (ISLAND[2] - ROOT))) for i, j in corners]
    columns = [
        box((0.4, 0.4, CLEAR + 0.1 + 0.5), (i, j + np.sign(j) * 2.6, 0.5 * (CLEAR + 0.1 - 0.5))) for i, j in corners
    ]
    pumps = [box((0.55, 1.0, 1.7), (i, j, ISLAND[2] + 0.80)) for i, j in corners]
    displays = [box((0.62, 0.6, 0.35), (i, j, 1.45)) for i, j in corners]
    middle = CLEAR + 0.5 * thick
    band = [box((deep + 0.1, 0.05, 0.4), (0.0, side * (0.5 * long + 0.015), middle)) for side in (-1, 1)]
    band += [box((0.05, long - 0.04, 0.4), (side * (0.5 * deep + 0.015), 0.0, middle)) for side in (-1, 1)]
    return [
        ("canopy", box((deep, long, thick), (0.0, 0.0, middle)), "metal_fascia", "building"),
        ("band", merge(band), "car_paint_red", "building"),
        ("columns", merge(columns), "metal_pole", "building"),
        ("islands", merge(islands), "concrete_structure", "static"),
        ("pumps", merge(pumps), "plastic", "static"),
        ("displays", merge(displays), "window_glass", "static"),
    ]


def gas_shop(rng: np.random.Generator) -> list[Piece]:
    """Return a shop of 14 x 7 m with a glass front and a sign above it, and a metal roof edge."""
    panes = [box((0.08, 2.5, 2.7), (3.51, y, 1.55)) for y in (-5.2, -2.6, 2.6, 5.2)]
    doors = [box((0.08, 1.15, 2.4), (3.51, y, 1.3)) for y in (-0.6, 0.6)]
    return [
        ("walls", box((7.0, 14.0, 3.9 + ROOT), (0.0, 0.0, 0.5 * (3.9 - ROOT))), "concrete_facade", "building"),
        ("panes", merge([*panes, *doors]), "window_glass", "building"),
        ("step", box((1.0, 3.4, 0.08 + ROOT), (3.98, 0.0, 0.5 * (0.08 - ROOT))), "concrete_structure", "building"),
        ("roof", box((7.8, 14.6, 0.35), (0.2, 0.0, 3.98)), "metal_fascia", "building"),
        ("sign", box((0.12, 9.0, 0.55), (3.55, 0.0, 3.4)), "car_paint_red", "building"),
        ("cooler", box((1.6, 2.4, 1.1), (-1.8, 3.5, 4.68)), "metal_pole", "building"),
    ]


def price_sign(rng: np.random.Generator) -> list[Piece]:
    """Return a pylon of 6.4 m that shows prices to both sides."""
    posts = [box((0.16, 0.16, 2.3 + ROOT), (0.0, y, 0.5 * (2.3 - ROOT))) for y in (-0.7, 0.7)]
    fields = [box((0.36, 1.5, 0.5), (0.0, 0.0, z)) for z in (2.75, 3.45, 4.15)]
    return [
        ("panel", box((0.3, 1.9, 4.2), (0.0, 0.0, 4.3)), "metal_fascia", "traffic_sign"),
        ("prices", merge(fields), "traffic_light_metal", "traffic_sign"),
        ("emblem", box((0.36, 1.7, 1.4), (0.0, 0.0, 5.5)), "car_paint_red", "traffic_sign"),
        ("posts", merge(posts), "metal_pole", "pole"),
    ]
