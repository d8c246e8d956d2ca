"""Street furniture and plants, each a small mesh of simple shapes with about the right size, and of few faces.

Frame of every prop: origin on the ground, x to its front (the street, or the drivers whom a sign speaks to), z up.
"""

from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np

from mmw.core.errors import InputError
from mmw.worlds.towns.farm_props import barn, field_fence, hay_bales, silo, water_tower, wooden_barn
from mmw.worlds.towns.gas_station import gas_canopy, gas_shop, price_sign
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.primitives import Mesh, ball, beam, box, circle, lathe, merge, place, prism, weld
from mmw.worlds.towns.prop_parts import ROOT, Piece, PropMaker, pole, upright
from mmw.worlds.towns.street_props import advertising_column, cycle_rack, guard_rail
from mmw.worlds.towns.trees import broadleaf_tree, hedge, oak, planter, spruce

FENCE_LENGTH = 6.0
"""Length of a fence panel [m]; design value."""

PANEL_LENGTH = {"fence": FENCE_LENGTH, "field_fence": FENCE_LENGTH, "hedge": 4.0, "guard_rail": 4.0}
"""Kinds that stand end to end, and the length of one [m]."""


def street_lamp(rng: np.random.Generator) -> list[Piece]:
    """Return a lamp post of 8 m with an arm over the kerb."""
    post = lathe([(0.17, -ROOT), (0.17, 0.9), (0.11, 1.0), (0.06, 8.0)], 6)
    return [
        ("post", merge([post, beam((0, 0, 7.9), (1.6, 0, 8.3), 0.08)]), "metal_pole", "pole"),
        ("lantern", box((0.75, 0.28, 0.10), (1.85, 0, 8.34)), "traffic_light_metal", "pole"),
        ("lens", box((0.55, 0.20, 0.04), (1.88, 0, 8.28)), "street_lamp_lens", "pole"),
    ]


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


def _sign(name: str, outline: np.ndarray, height: float) -> list[Piece]:
    """Return a post that carries a metal plate with a sign on its front.

    Args:
        name: Sign, one of `mmw.worlds.materials.town_decals.SIGNS`.
        outline: Border of the plate (y, z) about its middle [m], shape [K, 2].
        height: Height of the plate's middle [m].
    """
    face = upright(prism(0.98 * outline, 0.01, 0.03))
    return [
        ("plate", place(upright(prism(outline, 0.0, 0.02)), (0.045, 0, height)), "metal_pole", "traffic_sign"),
        (name, place(face, (0.045, 0, height)), "sign_face", "traffic_sign"),
        ("post", lathe([(0.04, -ROOT), (0.04, height + 0.3)], 5), "metal_pole", "pole"),
    ]


def _rectangle(width: float, height: float) -> np.ndarray:
    return 0.5 * np.array([[-width, -height], [width, -height], [width, height], [-width, height]])


def give_way_sign(rng: np.random.Generator) -> list[Piece]:
    """Return a triangle that stands on its tip."""
    return _sign("give_way", circle(0.52, 3, -0.5 * np.pi), 2.4)


def stop_sign(rng: np.random.Generator) -> list[Piece]:
    """Return an octagon."""
    return _sign("stop", circle(0.42, 8, np.pi / 8), 2.4)


def speed_sign(rng: np.random.Generator) -> list[Piece]:
    """Return a round sign of 50 km/h."""
    return _sign("speed_50", circle(0.35, 12, np.pi / 12), 2.3)


def slow_sign(rng: np.random.Generator) -> list[Piece]:
    """Return a round sign of 30 km/h."""
    return _sign("speed_30", circle(0.35, 12, np.pi / 12), 2.3)


def no_entry_sign(rng: np.random.Generator) -> list[Piece]:
    """Return a round sign with a bar."""
    return _sign("no_entry", circle(0.35, 12, np.pi / 12), 2.3)


def priority_sign(rng: np.random.Generator) -> list[Piece]:
    """Return a square that stands on its corner."""
    return _sign("priority", circle(0.42, 4, 0.0), 2.4)


def parking_sign(rng: np.random.Generator) -> list[Piece]:
    """Return a blue square with a P."""
    return _sign("parking", _rectangle(0.6, 0.6), 2.4)


def crossing_sign(rng: np.random.Generator) -> list[Piece]:
    """Return a blue square that shows a person on a zebra crossing."""
    return _sign("crossing", _rectangle(0.6, 0.6), 2.4)


def one_way_sign(rng: np.random.Generator) -> list[Piece]:
    """Return a blue square with an arrow."""
    return _sign("one_way", _rectangle(0.6, 0.6), 2.4)


def street_name_sign(rng: np.random.Generator) -> list[Piece]:
    """Return two name plates across each other."""
    return [
        ("mill_street", box((0.03, 1.0, 0.22), (0, 0.45, 2.7)), "sign_face", "traffic_sign"),
        ("linden_road", box((1.0, 0.03, 0.22), (0.45, 0, 2.95)), "sign_face", "traffic_sign"),
        ("post", lathe([(0.04, -ROOT), (0.04, 3.1)], 6), "metal_pole", "pole"),
    ]


def _lights(at: Sequence[float]) -> tuple[Mesh, list[Mesh]]:
    """Return the case with visors, and the lenses from the top, of a signal head that looks along +x."""
    x, y, z = at
    angle = np.radians([-15.0, 55.0, 125.0, 195.0])
    arc = np.column_stack([np.cos(angle), np.sin(angle)])
    visor = upright(prism(np.concatenate([0.14 * arc, 0.125 * arc[::-1]]), 0.13, 0.33))
    lens = upright(prism(circle(0.11, 8, np.pi / 8), 0.12, 0.165))
    lamps = [(x, y, z + dz) for dz in (0.32, 0.0, -0.32)]
    return merge([box((0.28, 0.36, 1.05), at), *(place(visor, lamp) for lamp in lamps)]), [
        place(lens, lamp) for lamp in lamps
    ]


def traffic_light(rng: np.random.Generator) -> list[Piece]:
    """Return a signal that shows red, at the kerb and on an arm of 4 m over the lanes (-y, bottom at 5.6 m)."""
    return _traffic_light({"red": "signal_red", "amber": "signal_amber", "green": "signal_green"})


def traffic_light_green(rng: np.random.Generator) -> list[Piece]:
    """Return the same signal that shows green."""
    return _traffic_light({"red": "signal_red_dark", "amber": "signal_amber", "green": "signal_green_lit"})


def _traffic_light(lamps: Mapping[str, str]) -> list[Piece]:
    """Return a signal whose lamps, from the top, have given materials."""
    cases, lenses = zip(_lights((0.15, 0, 3.0)), _lights((0.15, -4.0, 6.15)), strict=True)
    post = merge([pole(6.6, 0.11, 0.08), beam((0, 0, 6.4), (0, -4.2, 6.5), 0.1)])
    return [
        ("heads", merge(cases), "traffic_light_metal", "traffic_light"),
        *(
            (color, merge(lens[k] for lens in lenses), material, "traffic_light")
            for k, (color, material) in enumerate(lamps.items())
        ),
        ("post", post, "metal_pole", "pole"),
    ]


def bus_shelter(rng: np.random.Generator) -> list[Piece]:
    """Return a shelter of 4 x 1.4 m, open to the street."""
    posts = [box((0.1, 0.1, 2.4 + ROOT), (x, y, 0.5 * (2.4 - ROOT))) for x in (-0.65, 0.55) for y in (-1.9, 1.9)]
    panes = [box((0.03, 3.7, 1.9), (-0.65, 0, 1.25)), box((1.1, 0.03, 1.9), (-0.05, 1.9, 1.25))]
    seat = [box((0.4, 3.0, 0.06), (-0.4, 0, 0.5)), *(box((0.06, 0.06, 0.47), (-0.4, y, 0.235)) for y in (-1.2, 1.2))]
    return [
        ("frame", merge([*posts, box((1.5, 4.2, 0.12), (0.0, 0, 2.46))]), "metal_pole", "static"),
        ("panes", merge(panes), "clear_pane", "static"),
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
        speed_sign, slow_sign, no_entry_sign, priority_sign, parking_sign, crossing_sign, one_way_sign,
        street_name_sign, traffic_light, traffic_light_green, bus_shelter, kiosk, fence, monument, gas_canopy, gas_shop,
        price_sign, silo, barn, wooden_barn, hay_bales, field_fence, water_tower, advertising_column, planter,
        cycle_rack, guard_rail,
    )
}  # fmt: skip
"""Kind -> maker."""

TREES = {maker.__name__: maker for maker in (broadleaf_tree, oak, spruce)}
"""Kinds whose fineness can be chosen."""

VARIED = (*TREES, "silo")
"""Kinds whose size is random."""

CROWN_DETAIL = 3
"""Fineness of the crowns of trees: 180 triangles for a broad-leaved one; 2 gives 80."""


def build_prop(
    name: str, kind: str, at: Sequence[float], yaw: float, rng: np.random.Generator, detail: int = CROWN_DETAIL
) -> list[MeshPart]:
    """Return the meshes of one prop.

    Args:
        name: Name of the prim under `Props`.
        kind: A key of `PROPS`.
        at: Position on the ground in the town frame [m], shape [3].
        yaw: Direction of the prop's x axis, counter-clockwise from east [rad].
        rng: Varies the size of plants and silos.
        detail: Fineness of the crowns of trees, as `CROWN_DETAIL`.

    Raises:
        InputError: If the kind is unknown.
    """
    if kind not in PROPS:
        raise InputError(f"props: kind {kind!r}; known kinds are: {', '.join(sorted(PROPS))}; use one of them")
    if kind in TREES:
        pieces = TREES[kind](rng, detail)
    else:
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
