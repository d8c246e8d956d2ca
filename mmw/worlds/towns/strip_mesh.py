"""Triangles between rows of points, and the sorting of triangles into mesh parts."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mmw.core.mesh import TriangleMesh
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.section import EDGE_STRIPS

MIN_AREA = 1e-8
"""Triangles below this area are left out [m^2]: strips of no width where a profile has no kerb or no sidewalk."""


@dataclass
class Surface:
    """Triangles that share vertices, each with the material it is made of."""

    points: list[np.ndarray] = field(default_factory=list)
    """Blocks of vertices [m], each [n, 3]."""
    faces: dict[str, list[np.ndarray]] = field(default_factory=dict)
    """Material -> blocks of triangles, each [m, 3]."""
    count: int = 0

    def add_points(self, points: np.ndarray) -> np.ndarray:
        """Append vertices [n, 3] and return their indices, shape [n]."""
        index = np.arange(self.count, self.count + len(points))
        self.points.append(np.asarray(points, dtype=np.float64))
        self.count += len(points)
        return index

    def add_faces(self, material: str, faces: np.ndarray) -> None:
        """Append triangles [m, 3] of one material."""
        self.faces.setdefault(material, []).append(np.asarray(faces, dtype=np.int64).reshape(-1, 3))

    def parts(self, paths: dict[str, tuple[str, str]]) -> list[MeshPart]:
        """Return one mesh part a material."""
        points = np.concatenate(self.points)
        made = []
        for material, (path, label) in paths.items():
            if material not in self.faces:
                continue
            mesh = TriangleMesh(points, np.concatenate(self.faces[material]))
            mesh = mesh.select(mesh.areas > MIN_AREA)
            if len(mesh.faces):
                made.append(MeshPart.of(path, mesh, material, label))
        return made


def quads(lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Return two triangles for every cell between two rows of vertex indices.

    Args:
        lower: Indices along one row, shape [n]; the row runs to the left of the way from `lower` to `upper`.
        upper: Indices along the next row, shape [n].

    Returns:
        Triangles facing up, shape [2 (n - 1), 3]; those of cell k are rows 2 k and 2 k + 1.
    """
    a, b, c, d = lower[:-1], upper[:-1], upper[1:], lower[1:]
    return np.stack([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)], axis=1).reshape(-1, 3)


def zipper(lower: np.ndarray, t_lower: np.ndarray, upper: np.ndarray, t_upper: np.ndarray) -> np.ndarray:
    """Return the triangles between two rows whose vertices lie at different lateral positions.

    Every vertex of both rows is used, so the seam to the next strip has no vertex in the middle of an edge.

    Args:
        lower: Vertex indices of one row, shape [n]; the row runs to the left of the way from `lower` to `upper`.
        t_lower: Their lateral positions, ascending [m], shape [n].
        upper: Vertex indices of the other row, shape [m].
        t_upper: Their lateral positions, ascending [m], shape [m].

    Returns:
        Triangles facing up, shape [n + m - 2, 3].
    """
    i = j = 0
    faces = []
    while i < len(lower) - 1 or j < len(upper) - 1:
        if j == len(upper) - 1 or (i < len(lower) - 1 and t_lower[i + 1] <= t_upper[j + 1]):
            faces.append((lower[i], upper[j], lower[i + 1]))
            i += 1
        else:
            faces.append((lower[i], upper[j], upper[j + 1]))
            j += 1
    return np.array(faces, dtype=np.int64)


@dataclass(frozen=True)
class Chain:
    """Kerb, sidewalk and verge along one side of a road or round one corner, with the carriageway on the left."""

    name: str
    table: np.ndarray
    """Borders of the edge strips at every row, from the foot of the kerb outward [m], shape [N, 5, 3]."""


def chain_parts(name: str, chains: Sequence[Chain]) -> list[MeshPart]:
    """Return the meshes of kerbs, sidewalks and verges of one road or one junction."""
    surface = Surface()
    for chain in chains:
        rows, borders, _ = chain.table.shape
        index = surface.add_points(chain.table.reshape(-1, 3)).reshape(rows, borders)
        for k, (_, material) in enumerate(EDGE_STRIPS):
            # Outward lies to the right, so these face up, and the kerb's face looks at the carriageway.
            surface.add_faces(material, quads(index[:, k], index[:, k + 1]))
    return surface.parts(
        {
            "curb": (f"Sidewalks/{name}/curb", "sidewalk"),
            "concrete_sidewalk": (f"Sidewalks/{name}/walk", "sidewalk"),
            "grass": (f"Terrain/verge_{name}", "terrain"),
        }
    )


def offset_table(points: np.ndarray, outward: np.ndarray, offset: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Return the borders of the edge strips along a kerb line.

    Args:
        points: Foot of the kerb [m], shape [N, 3].
        outward: Unit vectors in plan, away from the carriageway, shape [N, 2].
        offset: Offsets of the borders [m], shape [N, 5] or [5].
        height: Heights of the borders above the foot [m], shape [N, 5] or [5].

    Returns:
        Shape [N, 5, 3].
    """
    offset = np.broadcast_to(offset, (len(points), 5))
    table = np.repeat(points[:, None, :], 5, axis=1)
    table[:, :, :2] += offset[:, :, None] * outward[:, None, :]
    table[:, :, 2] += np.broadcast_to(height, offset.shape)
    return table
