"""Build farm props: grain silos, barns, hay bales, field fences, a water tower."""

import numpy as np

from mmw.worlds.towns.primitives import beam, box, circle, lathe, merge, place, prism
from mmw.worlds.towns.prop_parts import ROOT, Piece, upright

SILO_RADIUS = 3.0
"""Radius of a grain silo [m]; design value."""
SILO_HEIGHT = (12.0, 16.0)
"""Lowest and highest wall of a grain silo [m]; design values."""
BARN = (20.0, 12.0)
"""Length and width of a barn [m]; design values."""


def silo(rng: np.random.Generator) -> list[Piece]:
    """Return a grain silo of brick, 6 m across and 12 to 16 m tall, with a conical metal roof and a ladder."""
    height = round(float(rng.uniform(*SILO_HEIGHT)), 2)
    rim = height - 0.15
    ladder = [box((0.07, 0.07, height - 2.0), (SILO_RADIUS + 0.15, y, 0.5 * height + 1.0)) for y in (-0.25, 0.25)]
    rungs = [box((0.06, 0.5, 0.06), (SILO_RADIUS + 0.15, 0.0, z)) for z in np.arange(2.5, height - 0.5, 1.5)]
    ties = [box((0.3, 0.06, 0.06), (SILO_RADIUS, y, z)) for y in (-0.25, 0.25) for z in (2.6, height - 0.6)]
    return [
        ("wall", lathe([(SILO_RADIUS, -ROOT), (SILO_RADIUS, height)], 16), "brick_facade", "building"),
        (
            "roof",
            lathe([(SILO_RADIUS + 0.2, rim), (SILO_RADIUS + 0.2, rim + 0.3), (0.4, rim + 2.0), (0.0, rim + 2.1)], 16),
            "metal_fascia", "building",
        ),
        ("ladder", merge([*ladder, *rungs, *ties]), "metal_pole", "building"),
        ("door", box((0.5, 1.2, 2.0 + 0.3), (-SILO_RADIUS + 0.15, 0.0, 0.85)), "metal_pole", "building"),
    ]  # fmt: skip


def _barn(walls: str) -> list[Piece]:
    """Return a barn of 20 x 12 m whose gables look along x, with double doors in both."""
    half_length, half_width = 0.5 * BARN[0], 0.5 * BARN[1]
    eaves, ridge = 4.6, 8.8
    rise = (ridge - eaves) / half_width
    gable = [(-half_width, -ROOT), (half_width, -ROOT), (half_width, eaves), (0, ridge), (-half_width, eaves)]
    body = upright(prism(np.array(gable), -half_length, half_length))
    out, thick = half_width + 0.6, 0.22
    low = eaves - 0.6 * rise - 0.03
    top = ridge - 0.03
    slopes = [(-out, low), (0, top), (out, low), (out, low + thick), (0, top + thick), (-out, low + thick)]
    roof = upright(prism(np.array(slopes), -half_length - 0.5, half_length + 0.5))
    doors = [
        box((0.12, 1.95, 3.9 + 0.3), (side * half_length, y, 0.5 * (3.9 - 0.3))) for side in (-1, 1) for y in (-1, 1)
    ]
    rails = [box((0.16, 6.4, 0.16), (side * half_length, 0.0, 4.05)) for side in (-1, 1)]
    panes = [box((1.6, 0.1, 1.0), (x, side * half_width, 2.6)) for side in (-1, 1) for x in (-7.0, -3.5, 0.0, 3.5, 7.0)]
    return [
        ("walls", body, walls, "building"),
        ("roof", roof, "tile_roof", "building"),
        ("doors", merge(doors), "bark" if walls == "wood" else "wood", "building"),
        ("rails", merge(rails), "metal_pole", "building"),
        ("windows", merge(panes), "window_glass", "building"),
    ]


def barn(rng: np.random.Generator) -> list[Piece]:
    """Return a barn with brick walls."""
    return _barn("brick_facade")


def wooden_barn(rng: np.random.Generator) -> list[Piece]:
    """Return a barn with wooden walls."""
    return _barn("wood")


def hay_bales(rng: np.random.Generator) -> list[Piece]:
    """Return three round bales, two on the ground and one on top of them."""
    radius, width = 0.75, 1.25
    roll = upright(prism(circle(radius, 10), -0.5 * width, 0.5 * width))
    places = [(-0.78, 0.58), (0.78, 0.58), (0.0, 0.58 + 1.29)]
    bales = [place(roll, (0.06 * k, y, z)) for k, (y, z) in enumerate(places)]
    return [("bales", merge(bales), "wood", "static")]


def field_fence(rng: np.random.Generator) -> list[Piece]:
    """Return a fence of posts and two rails, 6 m along y."""
    posts = [box((0.12, 0.12, 1.25 + ROOT), (0.0, y, 0.5 * (1.25 - ROOT))) for y in (-2.5, 0.0, 2.5)]
    rails = [box((0.05, 6.0, 0.12), (0.05, 0.0, z)) for z in (0.55, 1.05)]
    return [("posts", merge(posts), "wood", "fence"), ("rails", merge(rails), "wood", "fence")]


def water_tower(rng: np.random.Generator) -> list[Piece]:
    """Return a water tower of 20 m: a metal tank on four braced legs."""
    legs = [
        beam((3.4 * np.cos(a), 3.4 * np.sin(a), -ROOT), (2.6 * np.cos(a), 2.6 * np.sin(a), 13.0), 0.35)
        for a in np.pi * (0.25 + 0.5 * np.arange(4))
    ]
    ring = [(3.0 * np.cos(a), 3.0 * np.sin(a), 6.5) for a in np.pi * (0.25 + 0.5 * np.arange(5))]
    braces = [beam(ring[k], ring[k + 1], 0.18) for k in range(4)]
    tank = lathe([(0.9, 11.6), (3.2, 12.8), (3.2, 17.5), (0.4, 19.4), (0.0, 19.6)], 12)
    return [
        ("tank", tank, "metal_fascia", "building"),
        ("legs", merge([*legs, *braces]), "metal_pole", "building"),
        ("pipe", lathe([(0.4, -ROOT), (0.4, 11.8)], 8), "metal_pole", "building"),
    ]
