"""Closing the edges of imported sheets: kerb faces where something lower follows, the sides of roads otherwise."""

import numpy as np

from mmw.core.mesh import TriangleMesh
from mmw.worlds.towns.plan_geometry import PlanFaces, twice_areas
from mmw.worlds.towns.strip_mesh import Surface

SLAB = 0.6
"""Depth of the sides of a road below its surface, and thickness of a bridge deck [m]; design value."""
TOUCH = 1e-3
"""Faces within this distance in plan count as touching a point [m]."""
STEP = 0.02
"""Smaller steps between neighboring sheets stay open [m]."""
NEAR = 2e-4
"""An edge with a face of its height this far beside it lies within a sheet [m]; cut pieces lie on a grid of 1e-5 m."""
REACH = 1.0
"""Sheets farther above or below an edge have nothing to do with it [m]."""


class Sheets:
    """The upward faces of many sheets, looked up in plan; of several at one place, the one nearest in height counts."""

    def __init__(self, surfaces: list[Surface], touch: float = TOUCH) -> None:
        """Store surfaces; faces within `touch` of a point in plan [m] count as over it."""
        self._touch, corners = touch, []
        for surface in surfaces:
            points = np.concatenate(surface.points)
            corners += [points[block] for blocks in surface.faces.values() for block in blocks]
        triangles = np.concatenate(corners)
        self._faces = PlanFaces(triangles[twice_areas(triangles) > 1e-7])

    def hits(self, xy: np.ndarray, touch: float | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Return all faces over points [N, 2]: index of the point, shape [H], and height of the face there, [H].

        Faces within `touch` [m] in plan count as over a point, the distance of the sheets if it is None.
        """
        query, (p, q), z = self._faces.hits(xy, self._touch if touch is None else touch)
        inside = (p > -0.5) & (q > -0.5) & (p + q < 1.5)  # a sliver must not be extended to far heights
        return query[inside], z[inside]

    def nearest(self, points: np.ndarray, reach: float = REACH, touch: float | None = None) -> np.ndarray:
        """Return the height of the face nearest in height to each point [N, 3], NaN beyond `reach` [m], shape [N].

        `touch` is that of `hits`.
        """
        query, z = self.hits(points[:, :2], touch)
        return _closest(query, z, points[:, 2], reach)

    def below(self, points: np.ndarray, reach: float = REACH) -> np.ndarray:
        """Return the height of the highest face lower than each point by more than a step, NaN if none, shape [N]."""
        query, z = self.hits(points[:, :2])
        lower = z < points[query, 2] - STEP
        return _closest(query[lower], z[lower], points[:, 2], reach)

    def lowest(self, xy: np.ndarray) -> np.ndarray:
        """Return the height of the lowest face over points [N, 2], NaN if none, shape [N]."""
        query, z = self.hits(xy)
        found = np.full(len(xy), np.inf)
        np.minimum.at(found, query, z)
        return np.where(np.isfinite(found), found, np.nan)


def _closest(query: np.ndarray, z: np.ndarray, wanted: np.ndarray, reach: float) -> np.ndarray:
    found = np.full(len(wanted), np.nan)
    order = np.argsort(-np.abs(z - wanted[query]), kind="stable")  # the nearest is written last
    found[query[order]] = z[order]
    found[np.abs(found - wanted) > reach] = np.nan
    return found


def open_edges(surface: Surface) -> np.ndarray:
    """Return the edges with one face, the outside on their right: pairs of vertex indices, shape [E, 2]."""
    points = np.concatenate(surface.points)
    faces = np.concatenate([block for blocks in surface.faces.values() for block in blocks])
    faces = faces[2.0 * TriangleMesh(points, faces).areas > 2e-8]
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    key = np.unique(np.round(points, 5), axis=0, return_inverse=True)[1].reshape(-1)[edges]
    present = {tuple(edge) for edge in key.tolist()}
    is_open = np.array([(b, a) not in present and a != b for a, b in key.tolist()], bool)
    return edges[is_open]


def close_edges(surface: Surface, sheets: Sheets, raised: str = "curb", side: str = "soil") -> None:
    """Add vertical faces below the open edges of a surface.

    An edge next to a lower sheet gets a face down to it, of the material `raised`; an edge next to nothing gets one of
    depth `SLAB` below it, of the material `side`; an edge that goes on at the same height gets none.
    """
    edges = open_edges(surface)
    if len(edges) == 0:
        return
    points = np.concatenate(surface.points)
    a, b = points[edges[:, 0]], points[edges[:, 1]]
    step = b[:, :2] - a[:, :2]
    length = np.maximum(np.linalg.norm(step, axis=1), 1e-9)
    middle = 0.5 * (a + b)
    right = np.column_stack([step[:, 1], -step[:, 0], np.zeros(len(step))]) / length[:, None]
    beside = middle + 0.01 * right
    found = sheets.nearest(beside, 0.5)
    drop = beside[:, 2] - found
    alone, kerb = np.isnan(found), drop > STEP
    alone[alone] = np.isnan(sheets.nearest((middle + NEAR * right)[alone], STEP, touch=0.0))
    for mask, material in ((alone, side), (kerb, raised)):
        if not mask.any():
            continue
        tops = [a[mask], b[mask]]
        feet = []
        for top in tops:
            foot = top.copy()
            if material == side:
                foot[:, 2] -= SLAB
            else:
                under = sheets.below(top, 0.5)
                foot[:, 2] = np.where(np.isnan(under), top[:, 2] - drop[mask], under)
            feet.append(foot)
        low_a, low_b, top_a, top_b = surface.add_points(np.concatenate([*feet, *tops])).reshape(4, -1)
        surface.add_faces(material, np.column_stack([low_a, low_b, top_b]))
        surface.add_faces(material, np.column_stack([low_a, top_b, top_a]))
