"""Street furniture and plants, each a small mesh of simple shapes with about the right size, and of few faces.

Frame of every prop: origin on the ground, x to its front (the street, or the drivers whom a sign speaks to), z up.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np

from mmw.town.farm import barn, field_fence, hay_bales, silo, water_tower, wooden_barn
from mmw.town.gas_station import gas_canopy, gas_shop, price_sign
from mmw.town.parts import MeshPart
from mmw.town.pieces import ROOT, Piece, PropMaker, pole, upright
from mmw.town.solids import Mesh, ball, beam, box, circle, lathe, merge, place, prism, weld
from mmw.town.street_props import advertising_column, cycle_rack, guard_rail, planter

FENCE_LENGTH = 6.0
"""Length of a fence panel [m]; design value."""

PANEL_LENGTH = {"fence": FENCE_LENGTH, "field_fence": FENCE_LENGTH, "hedge": 4.0, "guard_rail": 4.0}
"""Kinds that stand end to end, and the length of one [m]."""


def street_lamp(rng: np.random.Generator) -> list[Piece]:
    """Return a lamp post of 8 m with an arm over the kerb."""
    post = merge([pole(8.0, 0.12, 0.06), beam((0, 0, 7.9), (1.6, 0, 8.3), 0.08)])
    return [
        ("post", post, "metal_pole", "pole"),
        ("lantern", box((0.75, 0.28, 0.12), (1.85, 0, 8.33)), "plastic", "pole"),
    ]


def broadleaf_tree(rng: np.random.Generator) -> list[Piece]:
    """Return a street tree, 6 to 8 m tall, with a crown of at most 1.7 m radius."""
    height, crown = rng.uniform(6.0, 8.0), rng.uniform(1.3, 1.7)
    below = 2.4
    middle = 0.5 * (below + height)
    tall = height - below
    shape = [(0.0, below), (crown, below + 0.3 * tall), (0.78 * crown, below + 0.74 * tall), (0.0, height)]
    foliage = lathe(shape, 5)
    return [
        ("trunk", lathe([(0.18, -ROOT), (0.0, middle)], 4), "bark", "vegetation"),
        ("crown", foliage, "foliage", "vegetation"),
    ]


def oak(rng: np.random.Generator) -> list[Piece]:
    """Return a broad tree for open land, 8 to 12 m tall."""
    height, crown = rng.uniform(8.0, 12.0), rng.uniform(2.6, 3.8)
    lobes = [ball((crown, crown, 0.3 * height), (0, 0, 0.66 * height), 7, 4)]
    angle = rng.uniform(0, 2 * np.pi)
    offset = 0.55 * crown * np.array([np.cos(angle), np.sin(angle)])
    lobes.append(ball((0.7 * crown, 0.7 * crown, 0.2 * height), (*offset, 0.5 * height), 5, 3))
    return [
        ("trunk", lathe([(0.32, -ROOT), (0.0, 0.7 * height)], 5), "bark", "vegetation"),
        ("crown", merge(lobes), "foliage", "vegetation"),
    ]


def spruce(rng: np.random.Generator) -> list[Piece]:
    """Return a conifer of three stacked cones, 7 to 12 m tall."""
    height, radius = rng.uniform(7.0, 12.0), rng.uniform(1.5, 2.2)
    cones = [
        lathe([(radius * (1 - 0.22 * i), height * (0.14 + 0.25 * i)), (0.0, height * (0.55 + 0.225 * i))], 7)
        for i in range(3)
    ]
    return [
        ("trunk", lathe([(0.2, -ROOT), (0.15, 0.2 * height)], 6), "bark", "vegetation"),
        ("crown", merge(cones), "foliage", "vegetation"),
    ]


def hedge(rng: np.random.Generator) -> list[Piece]:
    """Return a clipped hedge, 4 m along y."""
    return [("leaves", box((0.7, 4.0, 1.1 + ROOT), (0, 0, 0.5 * (1.1 - ROOT))), "foliage", "vegetation")]


def bench(rng: np.random.Generator) -> list[Piece]:
    """Return a park bench of 1.8 m."""
    slats = [box((0.45, 1.8, 0.06), (0.0, 0, 0.45)), box((0.06, 1.76, 0.44), (-0.21, 0, 0.69))]
    foot = box((0.34, 1.2, 0.42 + ROOT), (0, 0, 0.5 * (0.42 - ROOT)))
    return [("seat", merge(slats), "wood", "static"), ("foot", foot, "concrete_structure", "static")]


def litter_bin(rng: np.random.Generator) -> list[Piece]:
    """Return a litter bin."""
    return [
        ("body", lathe([(0.22, -0.2), (0.27, 0.85)], 5), "plastic", "static"),
        ("lid", lathe([(0.30, 0.85), (0.0, 1.02)], 5), "metal_pole", "static"),
    ]


def hydrant(rng: np.random.Generator) -> list[Piece]:
    """Return a fire hydrant."""
    body = lathe([(0.14, -0.2), (0.19, 0.55), (0.0, 0.8)], 6)
    return [("body", merge([body, beam((0, -0.24, 0.42), (0, 0.24, 0.42), 0.12)]), "metal_pole", "static")]


def bollard(rng: np.random.Generator) -> list[Piece]:
    """Return a bollard of 0.95 m."""
    return [("body", lathe([(0.08, -0.3), (0.08, 0.85), (0.0, 0.95)], 6), "metal_pole", "pole")]


def _sign(outline: np.ndarray, height: float, inner: float) -> list[Piece]:
    """Return a post that carries a metal plate, red on its front, with a white field.

    Args:
        outline: Border of the plate (y, z) about its middle [m], shape [K, 2].
        height: Height of the plate's middle [m].
        inner: Size of the white field, as a share of the plate's; 0 for none.
    """
    red = upright(prism(0.98 * outline, 0.01, 0.03))
    pieces = [
        ("plate", place(upright(prism(outline, 0.0, 0.02)), (0.045, 0, height)), "metal_pole", "traffic_sign"),
        ("red", place(red, (0.045, 0, height)), "car_paint_red", "traffic_sign"),
        ("post", lathe([(0.04, -ROOT), (0.04, height + 0.3)], 5), "metal_pole", "pole"),
    ]
    if inner:
        field = upright(prism(inner * outline, 0.02, 0.04))
        pieces.insert(2, ("field", place(field, (0.045, 0, height)), "sign_face", "traffic_sign"))
    return pieces


def give_way_sign(rng: np.random.Generator) -> list[Piece]:
    """Return a triangle that stands on its tip."""
    return _sign(circle(0.52, 3, -0.5 * np.pi), 2.4, 0.68)


def stop_sign(rng: np.random.Generator) -> list[Piece]:
    """Return an octagon."""
    return _sign(circle(0.42, 8, np.pi / 8), 2.4, 0.0)


def speed_sign(rng: np.random.Generator) -> list[Piece]:
    """Return a disc of eight sides."""
    return _sign(circle(0.35, 8, np.pi / 8), 2.3, 0.76)


def street_name_sign(rng: np.random.Generator) -> list[Piece]:
    """Return two name plates across each other."""
    plates = [box((0.03, 1.0, 0.22), (0, 0.45, 2.7)), box((1.0, 0.03, 0.22), (0.45, 0, 2.95))]
    return [
        ("plate", merge(plates), "sign_face", "traffic_sign"),
        ("post", lathe([(0.04, -ROOT), (0.04, 3.1)], 6), "metal_pole", "pole"),
    ]


def _lights(at: Sequence[float]) -> tuple[Mesh, Mesh, Mesh]:
    """Return the case, the red lens, and the two dark lenses below it, of a signal head that looks along +x."""
    case = box((0.28, 0.36, 1.05), at)
    lenses = [box((0.06, 0.24, 0.24), (at[0] + 0.165, at[1], at[2] + dz)) for dz in (0.32, 0.0, -0.32)]
    return case, lenses[0], merge(lenses[1:])


def traffic_light(rng: np.random.Generator) -> list[Piece]:
    """Return a signal at the kerb with a second head on an arm of 4 m over the lanes (towards -y, bottom at 5.6 m)."""
    heads = [_lights((0.15, 0, 3.0)), _lights((0.15, -4.0, 6.15))]
    post = merge([pole(6.6, 0.11, 0.08), beam((0, 0, 6.4), (0, -4.2, 6.5), 0.1)])
    return [
        ("heads", merge(case for case, _, _ in heads), "traffic_light_metal", "traffic_light"),
        ("red", merge(red for _, red, _ in heads), "car_light_rear", "traffic_light"),
        ("dark", merge(dark for _, _, dark in heads), "plastic", "traffic_light"),
        ("post", post, "metal_pole", "pole"),
    ]


def bus_shelter(rng: np.random.Generator) -> list[Piece]:
    """Return a shelter of 4 x 1.4 m, open to the street."""
    posts = [box((0.1, 0.1, 2.4 + ROOT), (x, y, 0.5 * (2.4 - ROOT))) for x in (-0.65, 0.55) for y in (-1.9, 1.9)]
    panes = [box((0.03, 3.7, 1.9), (-0.65, 0, 1.25)), box((1.1, 0.03, 1.9), (-0.05, 1.9, 1.25))]
    seat = [box((0.4, 3.0, 0.06), (-0.4, 0, 0.5)), *(box((0.06, 0.06, 0.47), (-0.4, y, 0.235)) for y in (-1.2, 1.2))]
    return [
        ("frame", merge([*posts, box((1.5, 4.2, 0.12), (0.0, 0, 2.46))]), "metal_pole", "static"),
        ("panes", merge(panes), "window_glass", "static"),
        ("seat", merge(seat), "wood", "static"),
    ]


def kiosk(rng: np.random.Generator) -> list[Piece]:
    """Return a newspaper kiosk of 3 x 2.4 m."""
    body = box((2.4, 3.0, 2.5 + ROOT), (0, 0, 0.5 * (2.5 - ROOT)))
    return [
        ("body", body, "wood", "building"),
        ("window", box((0.06, 2.2, 1.0), (1.22, 0, 1.5)), "window_glass", "building"),
        ("roof", box((3.0, 3.6, 0.15), (0.1, 0, 2.575)), "metal_fascia", "building"),
    ]


def fence(rng: np.random.Generator) -> list[Piece]:
    """Return a board fence, 6 m along y."""
    return [("panel", box((0.05, FENCE_LENGTH, 1.0 + ROOT), (0.0, 0, 0.5 * (1.0 - ROOT))), "wood", "fence")]


def monument(rng: np.random.Generator) -> list[Piece]:
    """Return the roundabout's monument: a stepped base, a column of 8 m and a metal ball; 9.6 m in all."""
    steps = [
        lathe([(4.5 - 0.9 * i, -ROOT if i == 0 else 0.35 * i), (4.5 - 0.9 * i, 0.35 * (i + 1))], 16) for i in range(3)
    ]
    column = lathe([(1.3, 1.05), (1.3, 1.5), (0.9, 1.7), (0.75, 7.6), (1.1, 7.8), (1.1, 8.1)], 12)
    return [
        ("base", merge(steps), "concrete_structure", "static"),
        ("column", column, "marble_facade", "static"),
        ("ball", ball((0.8, 0.8, 0.8), (0, 0, 8.85), 10, 6), "metal_fascia", "static"),
    ]


PROPS: dict[str, PropMaker] = {
    maker.__name__: maker
    for maker in (
        street_lamp, broadleaf_tree, oak, spruce, hedge, bench, litter_bin, hydrant, bollard, give_way_sign, stop_sign,
        speed_sign, street_name_sign, traffic_light, bus_shelter, kiosk, fence, monument, gas_canopy, gas_shop,
        price_sign, silo, barn, wooden_barn, hay_bales, field_fence, water_tower, advertising_column, planter,
        cycle_rack, guard_rail,
    )
}  # fmt: skip
"""Kind -> maker."""

VARIED = ("broadleaf_tree", "oak", "spruce", "silo")
"""Kinds whose size is random."""


def build_prop(name: str, kind: str, at: Sequence[float], yaw: float, rng: np.random.Generator) -> list[MeshPart]:
    """Return the meshes of one prop.

    Args:
        name: Name of the prim under `Props`.
        kind: A key of `PROPS`.
        at: Position on the ground in the town frame [m], shape [3].
        yaw: Direction of the prop's x axis, counter-clockwise from east [rad].
        rng: Varies the size of plants and silos.

    Raises:
        ValueError: If the kind is unknown.
    """
    if kind not in PROPS:
        raise ValueError(f"props: kind {kind!r}; known kinds are: {', '.join(sorted(PROPS))}; use one of them")
    pieces = PROPS[kind](rng) if kind in VARIED else _fixed(kind)
    return [
        MeshPart(f"Props/{name}/{piece}", *place(mesh, at, yaw), material, label)
        for piece, mesh, material, label in pieces
    ]


@cache
def _fixed(kind: str) -> tuple[Piece, ...]:
    """Return the pieces of a prop that is the same everywhere."""
    pieces = PROPS[kind](np.random.default_rng(0))
    return tuple((piece, weld(mesh), material, label) for piece, mesh, material, label in pieces)
