"""Street furniture and plants, each a small mesh of simple shapes with about the right size, and of few faces.

Frame of every prop: origin on the ground, x to its front (the street, or the drivers whom a sign speaks to), z up.
"""

from collections.abc import Sequence

import numpy as np

from mmw.core.errors import InputError
from mmw.core.mesh import TriangleMesh, merge
from mmw.worlds.towns.farm_props import FARM, silo
from mmw.worlds.towns.gas_station import GAS_STATION
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.primitives import ball, beam, box, circle, lathe, place, prism, weld
from mmw.worlds.towns.prop_parts import ROOT, Piece, block, piece, pole, upright
from mmw.worlds.towns.trees import broadleaf_tree, crown, oak, spruce

FENCE_LENGTH = 6.0
"""Length of a fence panel [m]; design value."""

PANEL_LENGTH = {"fence": FENCE_LENGTH, "field_fence": FENCE_LENGTH, "hedge": 4.0, "guard_rail": 4.0}
"""Kinds that stand end to end, and the length of one [m]."""


def _sign(name: str, outline: np.ndarray, height: float) -> list[Piece]:
    """Return a post with a metal plate, (y, z) about its middle at `height` [m], and a sign of `SIGNS` on its front."""
    plate, face = upright(prism(outline, 0.0, 0.02)), upright(prism(0.98 * outline, 0.01, 0.03))
    return [
        piece("plate", "metal_pole", "traffic_sign", place(plate, (0.045, 0, height))),
        piece(name, "sign_face", "traffic_sign", place(face, (0.045, 0, height))),
        piece("post", "metal_pole", "pole", pole(height + 0.3, 0.04)),
    ]


def _lights(at: Sequence[float]) -> tuple[TriangleMesh, list[TriangleMesh]]:
    """Return the case with visors, and the lenses from the top, of a signal head that looks along +x."""
    x, y, z = at
    angle = np.radians([-15.0, 55.0, 125.0, 195.0])
    arc = np.column_stack([np.cos(angle), np.sin(angle)])
    visor = upright(prism(np.concatenate([0.14 * arc, 0.125 * arc[::-1]]), 0.13, 0.33))
    lens = upright(prism(circle(0.11, 8, np.pi / 8), 0.12, 0.165))
    lamps = [(x, y, z + dz) for dz in (0.32, 0.0, -0.32)]
    case = merge([box((0.28, 0.36, 1.05), at), *(place(visor, lamp) for lamp in lamps)])
    return case, [place(lens, lamp) for lamp in lamps]


def _traffic_light(**lamps: str) -> list[Piece]:
    """Return a signal at the kerb and on an arm of 4 m over the lanes (-y, bottom at 5.6 m): lamp -> its material."""
    heads = [_lights((0.15, 0, 3.0)), _lights((0.15, -4.0, 6.15))]
    return [
        piece("heads", "traffic_light_metal", "traffic_light", *(case for case, _ in heads)),
        *(
            piece(color, material, "traffic_light", *(lenses[k] for _, lenses in heads))
            for k, (color, material) in enumerate(lamps.items())
        ),
        piece("post", "metal_pole", "pole", pole(6.6, 0.11, 0.08), beam((0, 0, 6.4), (0, -4.2, 6.5), 0.1)),
    ]


_SQUARE = 0.5 * np.array([[-0.6, -0.6], [0.6, -0.6], [0.6, 0.6], [-0.6, 0.6]])
_STEPS = [(4.5 - 0.9 * k, 0.35 * k if k else -ROOT) for k in range(3)]
_DISC = circle(0.35, 12, np.pi / 12)

_STREET: dict[str, list[Piece]] = {
    "street_lamp": [  # a post of 8 m with an arm over the kerb
        piece(
            "post", "metal_pole", "pole", lathe([(0.17, -ROOT), (0.17, 0.9), (0.11, 1.0), (0.06, 8.0)], 6),
            beam((0, 0, 7.9), (1.6, 0, 8.3), 0.08),
        ),
        piece("lantern", "traffic_light_metal", "pole", box((0.75, 0.28, 0.10), (1.85, 0, 8.34))),
        piece("lens", "street_lamp_lens", "pole", box((0.55, 0.20, 0.04), (1.88, 0, 8.28))),
    ],
    "hedge": [piece("leaves", "foliage", "vegetation", block(0.7, 4.0, 1.1))],
    "bench": [
        piece(
            "seat", "wood", "static", box((0.45, 1.8, 0.06), (0.0, 0, 0.45)), box((0.06, 1.76, 0.44), (-0.21, 0, 0.69))
        ),
        piece("foot", "concrete_structure", "static", block(0.34, 1.2, 0.42)),
    ],
    "litter_bin": [
        piece("body", "plastic", "static", lathe([(0.22, -0.2), (0.27, 0.85)], 5)),
        piece("lid", "metal_pole", "static", lathe([(0.30, 0.85), (0.0, 1.02)], 5)),
    ],
    "hydrant": [
        piece(
            "body", "metal_pole", "static", lathe([(0.14, -0.2), (0.19, 0.55), (0.0, 0.8)], 6),
            beam((0, -0.24, 0.42), (0, 0.24, 0.42), 0.12),
        ),
    ],
    "bollard": [piece("body", "metal_pole", "pole", lathe([(0.08, -0.3), (0.08, 0.85), (0.0, 0.95)], 6))],
    "give_way_sign": _sign("give_way", circle(0.52, 3, -0.5 * np.pi), 2.4),
    "stop_sign": _sign("stop", circle(0.42, 8, np.pi / 8), 2.4),
    "speed_sign": _sign("speed_50", _DISC, 2.3),
    "slow_sign": _sign("speed_30", _DISC, 2.3),
    "no_entry_sign": _sign("no_entry", _DISC, 2.3),
    "priority_sign": _sign("priority", circle(0.42, 4, 0.0), 2.4),
    "parking_sign": _sign("parking", _SQUARE, 2.4),
    "crossing_sign": _sign("crossing", _SQUARE, 2.4),
    "one_way_sign": _sign("one_way", _SQUARE, 2.4),
    "street_name_sign": [  # two name plates across each other
        piece("mill_street", "sign_face", "traffic_sign", box((0.03, 1.0, 0.22), (0, 0.45, 2.7))),
        piece("linden_road", "sign_face", "traffic_sign", box((1.0, 0.03, 0.22), (0.45, 0, 2.95))),
        piece("post", "metal_pole", "pole", pole(3.1, 0.04, sides=6)),
    ],
    "traffic_light": _traffic_light(red="signal_red", amber="signal_amber", green="signal_green"),
    "traffic_light_green": _traffic_light(red="signal_red_dark", amber="signal_amber", green="signal_green_lit"),
    "bus_shelter": [  # 4 x 1.4 m, open to the street
        piece(
            "frame", "metal_pole", "static", *(block(0.1, 0.1, 2.4, x, y) for x in (-0.65, 0.55) for y in (-1.9, 1.9)),
            box((1.5, 4.2, 0.12), (0.0, 0, 2.46)),
        ),
        piece(
            "panes", "clear_pane", "static", box((0.03, 3.7, 1.9), (-0.65, 0, 1.25)),
            box((1.1, 0.03, 1.9), (-0.05, 1.9, 1.25)),
        ),
        piece(
            "seat", "wood", "static", box((0.4, 3.0, 0.06), (-0.4, 0, 0.5)),
            *(box((0.06, 0.06, 0.47), (-0.4, y, 0.235)) for y in (-1.2, 1.2)),
        ),
    ],
    "kiosk": [  # 3 x 2.4 m
        piece("body", "wood", "building", block(2.4, 3.0, 2.5)),
        piece("window", "window_glass", "building", box((0.06, 2.2, 1.0), (1.22, 0, 1.5))),
        piece("roof", "metal_fascia", "building", box((3.0, 3.6, 0.15), (0.1, 0, 2.575))),
    ],
    "fence": [piece("panel", "wood", "fence", block(0.05, FENCE_LENGTH, 1.0))],
    "monument": [  # of the roundabout: a stepped base, a column of 8 m and a metal ball; 9.6 m in all
        piece(
            "base", "concrete_structure", "static",
            *(lathe([(r, low), (r, 0.35 * (k + 1))], 16) for k, (r, low) in enumerate(_STEPS)),
        ),
        piece(
            "column", "marble_facade", "static",
            lathe([(1.3, 1.05), (1.3, 1.5), (0.9, 1.7), (0.75, 7.6), (1.1, 7.8), (1.1, 8.1)], 12),
        ),
        piece("ball", "metal_fascia", "static", ball((0.8, 0.8, 0.8), (0, 0, 8.85), 10, 6)),
    ],
    "advertising_column": [  # 1.3 m across and 3.5 m tall
        piece("body", "plastic", "static", lathe([(0.62, 0.25), (0.62, 3.05)], 10)),
        piece("base", "concrete_structure", "static", pole(0.3, 0.70, sides=10)),
        piece("cap", "metal_pole", "static", lathe([(0.78, 3.0), (0.78, 3.15), (0.0, 3.5)], 10)),
    ],
    "planter": [  # a round tub with a shrub
        piece("tub", "concrete_structure", "static", lathe([(0.55, -0.2), (0.75, 0.65)], 8)),
        piece("crown", "foliage_light", "vegetation", crown(np.random.default_rng(0), 0.7, 0.45, 1.45, 7, 2)),
    ],
    "cycle_rack": [  # four hoops, 3 m along y
        piece(
            "hoops", "metal_pole", "static",
            *(hoop for y in (-1.2, -0.4, 0.4, 1.2) for hoop in (
                *(box((0.05, 0.05, 0.83 + 0.3), (x, y, 0.5 * (0.83 - 0.3))) for x in (-0.35, 0.35)),
                box((0.77, 0.06, 0.05), (0.0, y, 0.85)))),
        ),
    ],
    "guard_rail": [  # of steel, 4 m along y, its face to +x
        piece("rail", "metal_pole", "guard_rail", box((0.08, 4.0, 0.31), (0.0, 0.0, 0.6))),
        piece("posts", "metal_pole", "guard_rail", *(block(0.1, 0.12, 0.72, -0.08, y) for y in (-1.0, 1.0))),
    ],
}  # fmt: skip

TREES = {"broadleaf_tree": broadleaf_tree, "oak": oak, "spruce": spruce}
"""Kind -> maker of a tree of random size whose fineness can be chosen."""

FIXED = {
    kind: [(name, weld(mesh), material, label) for name, mesh, material, label in pieces]
    for kind, pieces in (_STREET | GAS_STATION | FARM).items()
}
"""Kind -> pieces of a prop that is the same everywhere."""

PROPS = (*TREES, "silo", *FIXED)
"""All kinds."""

CROWN_DETAIL = 3
"""Fineness of the crowns of trees: 180 triangles for a broad-leaved one; 2 gives 80."""


def build_prop(
    name: str, kind: str, at: Sequence[float], yaw: float, rng: np.random.Generator, detail: int = CROWN_DETAIL
) -> list[MeshPart]:
    """Return the meshes of one prop.

    Args:
        name: Name of the prim under `Props`.
        kind: One of `PROPS`.
        at: Position on the ground in the town frame [m], shape [3].
        yaw: Direction of the prop's x axis, counter-clockwise from east [rad].
        rng: Varies the size of trees and silos.
        detail: Fineness of the crowns of trees, as `CROWN_DETAIL`.

    Raises:
        InputError: If the kind is unknown.
    """
    if kind not in PROPS:
        raise InputError(f"props: kind {kind!r}; known kinds are: {', '.join(sorted(PROPS))}; use one of them")
    pieces = TREES[kind](rng, detail) if kind in TREES else silo(rng) if kind == "silo" else FIXED[kind]
    return [
        MeshPart.of(f"Props/{name}/{part}", place(mesh, at, yaw), material, label)
        for part, mesh, material, label in pieces
    ]
