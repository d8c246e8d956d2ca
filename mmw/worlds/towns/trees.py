"""Trees: closed crowns with lumps, whose normals are smooth, on tapered trunks.

No leaf is cut out: `mmw.scene.leaf_cards` makes leaves inside a crown when a scene is loaded. A crown is one surface
around its middle, the outer hull of several round clumps, so that no triangle is hidden inside it. Frame as in
`props.py`.
"""

import itertools

import numpy as np

from mmw.core.mesh import TriangleMesh
from mmw.worlds.towns.primitives import lathe
from mmw.worlds.towns.prop_parts import ROOT, Piece

GREENS = ("foliage", "foliage_light", "foliage_dark")
"""Materials of the crowns of broad-leaved trees."""


SMOOTHED, SHARPNESS = 3, 14.0
"""Crowns coarser than this `frequency` follow the mean hull around each vertex; how narrow that mean is [-]."""


def sphere(frequency: int) -> TriangleMesh:
    """Return a unit sphere of 20 x `frequency`^2 triangles: an icosahedron whose faces are divided."""
    golden = 0.5 * (1.0 + np.sqrt(5.0))
    corners = np.array([(0.0, a, b * golden) for a, b in itertools.product((-1.0, 1.0), repeat=2)])
    corners = np.concatenate([np.roll(corners, k, axis=1) for k in range(3)])
    near = np.linalg.norm(corners[:, None] - corners, axis=2) < 2.1
    points: list[np.ndarray] = []
    faces: list[list[int]] = []
    index: dict[tuple[int, ...], int] = {}
    for a, b, c in itertools.combinations(range(12), 3):
        if not (near[a, b] and near[b, c] and near[a, c]):
            continue
        if np.linalg.det(corners[[a, b, c]]) < 0:
            b, c = c, b
        at = {}
        for i, j in itertools.product(range(frequency + 1), repeat=2):
            if i + j <= frequency:
                k = frequency - i - j
                key = tuple(sorted((v, w) for v, w in ((a, k), (b, i), (c, j)) if w))
                if key not in index:
                    index[key] = len(points)
                    points.append((corners[a] * k + corners[b] * i + corners[c] * j) / frequency)
                at[i, j] = index[key]
        for i, j in itertools.product(range(frequency), repeat=2):
            if i + j < frequency:
                faces.append([at[i, j], at[i + 1, j], at[i, j + 1]])
            if i + j < frequency - 1:
                faces.append([at[i + 1, j], at[i + 1, j + 1], at[i, j + 1]])
    unit = np.array(points)
    return TriangleMesh(unit / np.linalg.norm(unit, axis=1, keepdims=True), np.array(faces, np.int32))


def crown(
    rng: np.random.Generator, radius: float, low: float, high: float, clumps: int, frequency: int, lean: float = 0.0
) -> TriangleMesh:
    """Return a crown: the hull of clumps around a middle, seen from there.

    Args:
        rng: Places the clumps.
        radius: Largest reach from the trunk [m].
        low: Lower end [m].
        high: Upper end [m].
        clumps: Number of clumps around the core.
        frequency: Fineness, as of `sphere`.
        lean: How much of the height the widest part lies above (positive) or below the middle, as a share.
    """
    unit, fine = sphere(frequency), sphere(max(frequency, SMOOTHED))
    turn = rng.uniform(0, 2 * np.pi)
    spin = np.array([[np.cos(turn), np.sin(turn), 0.0], [-np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    along, sample = unit.points @ spin, fine.points @ spin
    reach = np.full(len(sample), 0.50)
    golden = np.pi * (3.0 - np.sqrt(5.0))
    for k in range(clumps):  # spread evenly, then shifted
        height = 1.0 - 2.0 * (k + 0.5) / clumps + rng.uniform(-0.15, 0.15)
        angle = golden * k + rng.uniform(-0.4, 0.4)
        ring = np.sqrt(max(0.0, 1.0 - min(1.0, abs(height)) ** 2))
        middle = np.array([ring * np.cos(angle), ring * np.sin(angle), height]) * rng.uniform(0.50, 0.72)
        size = rng.uniform(0.34, 0.46)
        ahead = sample @ middle
        inside = size**2 - (middle @ middle - ahead**2)
        reach = np.maximum(reach, np.where(inside > 0, ahead + np.sqrt(np.maximum(inside, 0.0)), 0.0))
    if frequency < SMOOTHED:  # the few vertices of a coarse crown would catch a clump or miss it
        weight = np.exp(SHARPNESS * (along @ sample.T - 1.0))
        reach = weight @ reach / weight.sum(axis=1)
    reach = reach * rng.uniform(0.90, 1.05, len(along))
    points = along * reach[:, None]
    points[:, :2] *= radius / np.hypot(points[:, 0], points[:, 1]).max()
    bottom, top = points[:, 2].min(), points[:, 2].max()
    share = (points[:, 2] - bottom) / (top - bottom)
    points[:, 2] = low + (high - low) * (share + lean * share * (1.0 - share))
    return TriangleMesh(points, unit.faces)


def trunk(height: float, radius: float) -> TriangleMesh:
    """Return a trunk of five sides that is wider at its foot."""
    return lathe([(1.5 * radius, -ROOT), (radius, 0.6), (0.55 * radius, height)], 5)


def broadleaf_tree(rng: np.random.Generator, frequency: int = 3) -> list[Piece]:
    """Return a street tree, 6 to 8 m tall, with a crown of at most 1.7 m radius."""
    height, radius = rng.uniform(6.0, 8.0), rng.uniform(1.35, 1.7)
    green = GREENS[int(rng.choice(3, p=[0.5, 0.35, 0.15]))]
    hull = crown(rng, radius, 2.3, height, 10, frequency, rng.uniform(-0.35, 0.1))
    return [
        ("trunk", trunk(0.5 * (2.3 + height), 0.13), "bark", "vegetation"),
        ("crown", hull, green, "vegetation"),
    ]


def oak(rng: np.random.Generator, frequency: int = 3) -> list[Piece]:
    """Return a broad tree for open land, 8 to 12 m tall."""
    height, radius = rng.uniform(8.0, 12.0), rng.uniform(2.6, 3.8)
    green = GREENS[int(rng.choice(3, p=[0.55, 0.2, 0.25]))]
    hull = crown(rng, radius, 0.25 * height, height, 13, frequency, rng.uniform(-0.1, 0.25))
    return [
        ("trunk", trunk(0.6 * height, rng.uniform(0.22, 0.3)), "bark", "vegetation"),
        ("crown", hull, green, "vegetation"),
    ]


def spruce(rng: np.random.Generator, frequency: int = 3) -> list[Piece]:
    """Return a conifer of stacked tiers with uneven rims, 7 to 12 m tall."""
    height, radius = rng.uniform(7.0, 12.0), rng.uniform(1.5, 2.2)
    tiers, rays = (4, 9) if frequency > 2 else (4, 7)
    points: list[np.ndarray] = []
    faces: list[np.ndarray] = []
    for k in range(tiers):
        start = sum(len(block) for block in points)
        foot = height * (0.10 + 0.78 * k / tiers)
        tip = min(height, foot + height * (0.42 - 0.035 * k)) if k < tiers - 1 else height
        wide = radius * (1.0 - 0.80 * k / tiers)
        angle = 2 * np.pi * (np.arange(rays) + 0.5 * (k % 2) + rng.uniform(-0.25, 0.25, rays)) / rays
        reach = wide * rng.uniform(0.72, 1.0, rays)
        reach *= wide / reach.max()
        sag = foot + height * rng.uniform(-0.025, 0.035, rays)
        rim = np.column_stack([reach * np.cos(angle), reach * np.sin(angle), sag])
        points.append(np.concatenate([rim, [[0.0, 0.0, tip], [0.0, 0.0, foot + 0.09 * height]]]))
        ring, following = start + np.arange(rays), start + np.roll(np.arange(rays), -1)
        ends = np.full(rays, start + rays)
        faces += [np.column_stack([ring, following, ends]), np.column_stack([following, ring, ends + 1])]
    hull = TriangleMesh(np.concatenate(points), np.concatenate(faces).astype(np.int32))
    return [
        ("trunk", trunk(0.2 * height, 0.16), "bark", "vegetation"),
        ("crown", hull, "foliage_dark", "vegetation"),
    ]
