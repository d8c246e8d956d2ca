"""Simplify objects to upright prisms, as DeepMIMO's converters do: the convex outline from above, from base to top.

Source: DeepMIMO 4.0.5, `core/scene.py`, `_get_faces_convex_hull`. Flat objects, which it drops or gives faces without
area, are one polygon here.
"""

import numpy as np

ROUNDING_M = 0.05
"""Distance to the line between its neighbors below which a corner of an outline is left out [m]. Design value: it makes
posts and crowns, whose outlines are circles of many corners, cheap to draw."""

Polygons = list[list[int]]
"""Corners of each polygon, as numbers of vertices."""

FLAT_M = 1e-3
"""Height below which an object is one horizontal polygon, and width below which it is one vertical one [m]. Design
value: DeepMIMO compares heights to 1 mm."""


def prism(points: np.ndarray) -> tuple[np.ndarray, Polygons]:
    """Return corners and polygons of the prism around an object, which face outward.

    Args:
        points: Vertices of the object [m], shape [N, 3], at least two that differ.

    Returns:
        Corners [m], shape [C, 3]: the outline at the base, counter-clockwise from above, then at the top. Polygons:
        base, top, sides; of a flat object one.
    """
    low, high = points[:, 2].min(), points[:, 2].max()
    outline = without_small_corners(convex_outline(points[:, :2]))
    if len(outline) < 3:  # a wall without thickness, or a vertical line
        (x0, y0), (x1, y1) = outline[0], outline[-1]
        return np.array([[x0, y0, low], [x1, y1, low], [x1, y1, high], [x0, y0, high]]), [[0, 1, 2, 3]]
    count = len(outline)
    top = np.column_stack([outline, np.full(count, high)])
    if high - low < FLAT_M:
        return top, [list(range(count))]
    base = np.column_stack([outline, np.full(count, low)])
    sides = [[i, (i + 1) % count, count + (i + 1) % count, count + i] for i in range(count)]
    return np.concatenate([base, top]), [list(range(count))[::-1], list(range(count, 2 * count)), *sides]


def convex_outline(points: np.ndarray) -> np.ndarray:
    """Return the corners of the convex hull of points in a plane, counter-clockwise, shape [C, 2].

    Two corners are returned for points on a line, up to `FLAT_M`, and one for equal points.

    Source: A. M. Andrew, "Another efficient algorithm for convex hulls in two dimensions", Information Processing
    Letters 9 (5), 1979.
    """
    ordered = np.unique(points, axis=0)
    if len(ordered) < 3:
        return ordered
    chains = []
    for chain in (ordered, ordered[::-1]):
        hull: list[np.ndarray] = []
        for point in chain:
            while len(hull) >= 2 and _turn(hull[-2], hull[-1], point) <= 0:
                hull.pop()
            hull.append(point)
        chains.append(hull[:-1])
    outline = np.array([*chains[0], *chains[1]])
    ends = np.array([outline[0], outline[np.argmax(np.linalg.norm(outline - outline[0], axis=1))]])
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    across = (outline - ends[0]) @ np.array([-along[1], along[0]])
    return ends if across.max() - across.min() < FLAT_M else outline


def without_small_corners(outline: np.ndarray) -> np.ndarray:
    """Return a convex outline without corners that stand out by less than `ROUNDING_M`, the smallest first.

    Args:
        outline: Corners, counter-clockwise [m], shape [C, 2]; three at least are kept.
    """
    while len(outline) > 3:
        before, after = np.roll(outline, 1, axis=0), np.roll(outline, -1, axis=0)
        chord, own = after - before, outline - before
        height = np.abs(chord[:, 0] * own[:, 1] - chord[:, 1] * own[:, 0]) / np.linalg.norm(chord, axis=1)
        if height.min() >= ROUNDING_M:
            break
        outline = np.delete(outline, np.argmin(height), axis=0)
    return outline


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    """Return twice the signed area of a triangle, positive if it turns to the left."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def main_material(points: np.ndarray, faces: np.ndarray, material: np.ndarray) -> int:
    """Return the material that has the largest area of some triangles, the smallest number of equal ones.

    Args:
        points: Vertices [m], shape [V, 3].
        faces: Triangles, shape [T, 3].
        material: Material of each triangle, shape [T].
    """
    corner = points[faces]
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    return int(np.argmax(np.bincount(material, weights=area)))
