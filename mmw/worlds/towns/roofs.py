"""Roofs: flat behind a parapet, gable, hip; chimneys and the equipment of a flat roof. Frame as in `buildings.py`."""

from collections import defaultdict

import numpy as np
import shapely

from mmw.core.mesh import TriangleMesh, merge
from mmw.worlds.towns.block_description import BuildingStyle
from mmw.worlds.towns.building_footprints import Plan, rectangle
from mmw.worlds.towns.facades import window_columns
from mmw.worlds.towns.primitives import box, flat, lathe, place, quads, stacked

Meshes = defaultdict[str, list[TriangleMesh]]
"""Use, such as `facade` -> what has been made for it so far."""

PARAPET_THICKNESS = 0.3
CORNICE = (0.25, 0.35)  # overhang, height [m]
ROOF_THICKNESS = 0.2
EAVES = 0.45
PLANT_ROOM = (0.42, 0.36, 3.4)
"""Part of width and depth that a plant room covers (fractions), and its height [m]; design values."""


def flat_roof(style: BuildingStyle, plan: Plan, top: float, is_joined: bool, out: Meshes) -> None:
    """Add a roof behind a parapet, with a cornice where no neighbor adjoins."""
    rim = top + style.parapet_m
    overhang = CORNICE[0] if style.windows == "punched" and not is_joined else 0.0
    rings = [
        (plan.ring(PARAPET_THICKNESS), top),
        (plan.ring(PARAPET_THICKNESS), rim),
        (plan.ring(-overhang), rim),
    ]
    if overhang:
        rings += [(plan.ring(-overhang), rim - CORNICE[1]), (plan.ring(), rim - CORNICE[1])]
    out["facade"].append(quads(*stacked(rings, inward=True)))
    out["roof"].append(flat(plan.ring(PARAPET_THICKNESS), top))


def gable_roof(style: BuildingStyle, width: float, depth: float, top: float, out: Meshes) -> None:
    """Add a pitched roof along the longer side and the wall triangles under its ends."""
    turned = depth > width
    length, run = (depth, 0.5 * width) if turned else (width, 0.5 * depth)
    rise = style.pitch * run
    reach, drop = run + EAVES, style.pitch * EAVES
    edge, thick = -drop, ROOF_THICKNESS
    section = np.array(
        [(-reach, edge), (0, rise), (reach, edge), (reach, edge + thick), (0, rise + thick), (-reach, edge + thick)]
    )
    half = 0.5 * length + EAVES
    points = np.concatenate(
        [np.column_stack([np.full(6, x), section[:, 0], top + section[:, 1]]) for x in (-half, half)]
    )
    sides = [[i + 6, (i + 1) % 6 + 6, (i + 1) % 6, i] for i in range(6)]
    ends = [[0, 1, 4, 5], [1, 2, 3, 4], [11, 10, 7, 6], [10, 9, 8, 7]]
    roof = quads(points, [*(side[::-1] for side in sides), *(end[::-1] for end in ends)])
    out["roof"].append(place(roof, (0, 0, 0), 0.5 * np.pi if turned else 0.0))
    for sign in (-1, 1):
        across, _ = window_columns(style, 2 * run)
        along = sign * run * (2 * across - 1)
        base = np.column_stack([np.full(len(along), sign * 0.5 * length), along, np.full(len(along), top)])
        apex = len(base)
        faces = [[i, i + 1, apex] for i in range(apex - 1)]
        end = TriangleMesh(np.vstack([base, [sign * 0.5 * length, 0.0, top + rise]]), np.array(faces, np.int32))
        out["facade"].append(place(end, (0, 0, 0), 0.5 * np.pi if turned else 0.0))


def hip_roof(style: BuildingStyle, width: float, depth: float, top: float, out: Meshes) -> None:
    """Add a roof that slopes to all four sides, with a level soffit under its eaves; over a square a pyramid."""
    turned = depth > width
    long, short = (max(width, depth), min(width, depth))
    low = rectangle(long, short, -EAVES)
    run = 0.5 * short + EAVES
    ridge = 0.5 * (long - short)
    points = np.vstack(
        [np.column_stack([low, np.full(4, z)]) for z in (top, top + ROOF_THICKNESS)]
        + [[[x, 0.0, top + ROOF_THICKNESS + style.pitch * run] for x in (-ridge, ridge)][: 2 if ridge else 1]]
    )
    fascia = [[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7], [0, 3, 2, 1]]
    slopes = quads(points, [*fascia, [4, 5, 9, 8], [6, 7, 8, 9]] if ridge else fascia)
    rises = [[5, 6, 9], [7, 4, 8]] if ridge else [[4, 5, 8], [5, 6, 8], [6, 7, 8], [7, 4, 8]]
    ends = TriangleMesh(points, np.array(rises, np.int32))
    out["roof"].append(place(merge([slopes, ends]), (0, 0, 0), 0.5 * np.pi if turned else 0.0))


def add_chimney(
    style: BuildingStyle, width: float, depth: float, top: float, rng: np.random.Generator, out: Meshes
) -> None:
    """Add a chimney beside the ridge."""
    long, short = max(width, depth), min(width, depth)
    x, y = (0.3 * long * rng.choice([-1, 1]), 0.12 * short)
    ridge = top + style.pitch * 0.5 * short
    low, high = ridge - style.pitch * 0.12 * short - 0.8, ridge + 0.9
    stack = box((0.8, 0.6, high - low), (x, y, 0.5 * (low + high)), bottom=False)
    out["chimney"].append(place(stack, (0, 0, 0), 0.5 * np.pi if depth > width else 0.0))


def add_equipment(plan: Plan, top: float, rng: np.random.Generator, out: Meshes) -> None:
    """Add a stair head, cooling units and now and then a tank, one to each quarter of a flat roof that is there."""
    width, depth = plan.width, plan.depth
    inner = shapely.Polygon(plan.ring(PARAPET_THICKNESS + 0.1))
    quarters = rng.permutation(4)[: rng.integers(1, 5)]
    for order, quarter in enumerate(quarters):
        x = (0.22 + 0.04 * rng.random()) * width * (1 if quarter % 2 else -1)
        y = (0.22 + 0.04 * rng.random()) * depth * (1 if quarter // 2 else -1)
        room = 0.36 * min(width, depth)
        if plan.form != "rectangle" and not shapely.contains(inner, shapely.box(x - 1.6, y - 2.0, x + 1.6, y + 2.0)):
            continue
        if order == 0:
            out["structure"].append(box((min(3.2, room), min(4.0, room), 2.6), (x, y, top + 1.3), bottom=False))
        elif order == 3:
            stand = box((1.2, 1.2, 1.2), (x, y, top + 0.6), bottom=False)
            tank = lathe([(1.1, top + 1.2), (1.1, top + 3.0), (0.0, top + 3.6)], 7, (x, y))
            out["metal"] += [stand, tank]
        else:
            out["metal"].append(box((min(2.4, room), min(1.6, room), 1.3), (x, y, top + 0.65), bottom=False))


def add_plant_room(plan: Plan, top: float, out: Meshes) -> None:
    """Add a metal plant room in the middle of a flat roof, on a low base and under a metal roof of its own."""
    share_x, share_y, height = PLANT_ROOM
    x = y = 0.0
    if plan.form == "l_shape":  # the part without the notch
        x, y = (0.12 if plan.is_mirrored else -0.12) * plan.width, -0.12 * plan.depth
    size = np.array([share_x * plan.width, share_y * plan.depth])
    out["structure"].append(box((*(size + 0.4), 0.5), (x, y, top + 0.25), bottom=False))
    out["metal"].append(box((*size, height), (x, y, top + 0.45 + 0.5 * height), bottom=False))
    out["metal"].append(box((*(size + 0.3), 0.25), (x, y, top + 0.45 + height + 0.1)))
