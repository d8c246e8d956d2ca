"""The gas station in three props: a canopy that stands over a driveway, a shop, and a sign with prices.

The canopy's origin lies in the middle of the driveway, which runs along y between two rows of islands.
"""

import numpy as np

from mmw.worlds.towns.primitives import box
from mmw.worlds.towns.prop_parts import Piece, block, piece

CANOPY = (14.0, 22.0, 0.9)
"""Canopy across and along the driveway, and its thickness [m]; design values."""
CLEAR = 5.0
"""Clear height below the canopy [m]; design value, 4.5 m of headroom that trucks are given and half a meter."""
DRIVEWAY = 6.0
"""Free width between the two rows of islands [m]; design value."""
ISLAND = (1.2, 6.6, 0.2)
"""Width, length and height of an island [m]; design values."""

_DEEP, _LONG, _THICK = CANOPY
_MIDDLE = CLEAR + 0.5 * _THICK
_CORNERS = [(i * 0.5 * (DRIVEWAY + ISLAND[0]), j * (0.25 * _LONG - 0.6)) for i in (-1, 1) for j in (-1, 1)]

GAS_STATION: dict[str, list[Piece]] = {
    "gas_canopy": [  # 22 x 14 m, 5 m clear, on four columns, with four islands and four pumps below
        piece("canopy", "metal_fascia", "building", box(CANOPY, (0.0, 0.0, _MIDDLE))),
        piece(
            "band", "car_paint_red", "building",
            *(box((_DEEP + 0.1, 0.05, 0.4), (0.0, k * (0.5 * _LONG + 0.015), _MIDDLE)) for k in (-1, 1)),
            *(box((0.05, _LONG - 0.04, 0.4), (k * (0.5 * _DEEP + 0.015), 0.0, _MIDDLE)) for k in (-1, 1)),
        ),
        piece(
            "columns", "metal_pole", "building",
            *(box((0.4, 0.4, CLEAR + 0.1 + 0.5), (i, j + np.sign(j) * 2.6, 0.5 * (CLEAR + 0.1 - 0.5)))
              for i, j in _CORNERS),
        ),
        piece("islands", "concrete_structure", "static", *(block(*ISLAND, i, j) for i, j in _CORNERS)),
        piece("pumps", "plastic", "static", *(box((0.55, 1.0, 1.7), (i, j, ISLAND[2] + 0.80)) for i, j in _CORNERS)),
        piece("displays", "window_glass", "static", *(box((0.62, 0.6, 0.35), (i, j, 1.45)) for i, j in _CORNERS)),
    ],
    "gas_shop": [  # 14 x 7 m with a glass front and a sign above it, and a metal roof edge
        piece("walls", "concrete_facade", "building", block(7.0, 14.0, 3.9)),
        piece(
            "panes", "window_glass", "building",
            *(box((0.08, 2.5, 2.7), (3.51, y, 1.55)) for y in (-5.2, -2.6, 2.6, 5.2)),
            *(box((0.08, 1.15, 2.4), (3.51, y, 1.3)) for y in (-0.6, 0.6)),
        ),
        piece("step", "concrete_structure", "building", block(1.0, 3.4, 0.08, 3.98)),
        piece("roof", "metal_fascia", "building", box((7.8, 14.6, 0.35), (0.2, 0.0, 3.98))),
        piece("sign", "car_paint_red", "building", box((0.12, 9.0, 0.55), (3.55, 0.0, 3.4))),
        piece("cooler", "metal_pole", "building", box((1.6, 2.4, 1.1), (-1.8, 3.5, 4.68))),
    ],
    "price_sign": [  # a pylon of 6.4 m that shows prices to both sides
        piece("panel", "metal_fascia", "traffic_sign", box((0.3, 1.9, 4.2), (0.0, 0.0, 4.3))),
        piece(
            "prices", "traffic_light_metal", "traffic_sign",
            *(box((0.36, 1.5, 0.5), (0.0, 0.0, z)) for z in (2.75, 3.45, 4.15)),
        ),
        piece("emblem", "car_paint_red", "traffic_sign", box((0.36, 1.7, 1.4), (0.0, 0.0, 5.5))),
        piece("posts", "metal_pole", "pole", *(block(0.16, 0.16, 2.3, 0.0, y) for y in (-0.7, 0.7))),
    ],
}  # fmt: skip
