"""Attach details to walls: belts, steps and canopies at doors, signs and awnings of shops, balconies.

Every piece reaches a little into the wall, so that no two faces lie in one plane. Frame as in `buildings.py`.
"""

import numpy as np

from mmw.core.mesh import TriangleMesh
from mmw.worlds.materials.town_decals import SHOP_ASPECT
from mmw.worlds.towns.block_description import BuildingStyle
from mmw.worlds.towns.building_footprints import Plan
from mmw.worlds.towns.facades import window_columns
from mmw.worlds.towns.primitives import box, prism, quads, stacked
from mmw.worlds.towns.prop_parts import upright
from mmw.worlds.towns.roofs import Meshes

BELT = (0.12, 0.14)  # overhang, half the height [m]
SUNK = 0.05  # how far an attached body reaches into the wall [m]
AWNING = (1.3, 0.4)
"""Reach and drop of a shop's awning [m]; design values."""
SIGN_REACH, SIGN_GAP = 0.2, 0.12
BALCONY = (1.3, 0.18, 1.0)
"""Reach, thickness of the slab and height of the parapet of a balcony [m]; design values."""
RAIL = 0.1
"""Thickness of a balcony's parapet [m]."""


def belt(plan: Plan, level: float, out: Meshes) -> None:
    """Add a stone belt around the walls at the floor of the first storey."""
    reach, half = BELT
    profile = [(0.0, level - half), (reach, level - half), (reach, level + half), (0.0, level + half)]
    out["structure"].append(quads(*stacked([(plan.ring(-offset), z) for offset, z in profile])))


def entrance(style: BuildingStyle, plan: Plan, foot: float, floor: float, out: Meshes) -> None:
    """Add a step below the door, and a canopy above it where no awning hangs."""
    (start, front), (end, _) = plan.ring()[:2]
    width, middle = end - start, 0.5 * (start + end)
    across, windows = window_columns(style, width)
    columns = np.flatnonzero(windows)
    column = columns[len(columns) // 2]
    left, right = (across[column : column + 2] - 0.5) * width
    x, size = 0.5 * (left + right) + middle, right - left + 0.6
    above = floor + style.ground_storey_m - style.head_m + 0.2
    reach = 1.2
    size = min(size, 4.0)
    y = front - 0.5 * (reach - SUNK)
    out["structure"].append(box((size, reach + SUNK, floor - foot), (x, y, 0.5 * (floor + foot)), bottom=False))
    if not style.shop_front:
        out["metal"].append(box((size, reach + SUNK, 0.15), (x, y, above)))


def shop_front(style: BuildingStyle, plan: Plan, floor: float, out: Meshes) -> None:
    """Add signboards and an awning over the windows of the ground storey, on the front."""
    (start, front), (end, _) = plan.ring()[:2]
    head = floor + style.ground_storey_m - style.head_m
    x0, x1 = start + 0.35, end - 0.35
    reach, drop = AWNING
    section = np.array(
        [(SUNK, -0.08), (SUNK, 0.03), (0.0, 0.03), (-reach, 0.03 - drop), (-reach, -0.03 - drop), (0.0, -0.06)]
    )
    out["awning"].append(upright(prism(section + np.array([front, head]), x0, x1)))
    tall = style.head_m - 0.24
    if tall > 0.15:
        count = max(1, round((x1 - x0) / (SHOP_ASPECT * tall)))
        for k in range(count):
            size = ((x1 - x0) / count - SIGN_GAP, SIGN_REACH + SUNK, tall)
            x = x0 + (k + 0.5) * (x1 - x0) / count
            out["sign"].append(box(size, (x, front - 0.5 * (SIGN_REACH - SUNK), head + 0.07 + 0.5 * tall)))


def balconies(
    style: BuildingStyle, plan: Plan, floor: float, storeys: int, rng: np.random.Generator, out: Meshes
) -> None:
    """Add balconies to every second window column of the front, at all storeys but the ground one."""
    (start, front), (end, _) = plan.ring()[:2]
    across, windows = window_columns(style, end - start)
    columns = np.flatnonzero(windows)[int(rng.integers(2)) :: 2]
    for column in columns:
        left, right = start + across[column : column + 2] * (end - start) + [-0.35, 0.35]
        for storey in range(1, storeys):
            level = floor + style.ground_storey_m + (storey - 1) * style.storey_m
            out["structure"].append(_tray(float(left), float(right), front, level))


def _tray(left: float, right: float, front: float, level: float) -> TriangleMesh:
    """Return a slab with a parapet on all sides, one closed solid; its back lies in the wall."""
    reach, thick, tall = BALCONY
    outer = np.array([[left, front - reach], [right, front - reach], [right, front + SUNK], [left, front + SUNK]])
    inner = outer + RAIL * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    rings = [(outer, level - thick), (outer, level + tall), (inner, level + tall), (inner, level + 0.03)]
    points, strips = stacked(rings)
    return quads(points, [*strips, [3, 2, 1, 0], [12, 13, 14, 15]])
