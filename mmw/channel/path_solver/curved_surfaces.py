"""Find the curved surfaces that a mesh shows as small facets, such as posts and panels of vehicles.

Two facets of one object belong to one curved surface where they meet without a concave edge and lie near the arc that
the edge suggests: chords of width w that meet at an angle b are 0.5 w tan(b / 4) from their arc, whose radius is
w / (2 sin(b / 2)). A square post has corners, a hexagonal one is a round post.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.core.planar_surfaces import components
from mmw.kernels.channel.curved_surfaces import CurvedFacets
from mmw.physics.em.vectors import dot, norm
from mmw.scene.mesh_edges import MeshEdges

MAX_BEND_RAD = np.radians(75.0)
"""Largest bend between two facets of a curved surface [rad]: a round trunk of five facets bends by 72 degrees."""

MAX_SAGITTA_M = 0.04
"""Farthest that a curved surface may lie from the chords of its facets [m]. Design value."""

WIDE_SAGITTA_M = 0.005
"""The same for facets that are no small ones: a panel with a rounded rim is flat, and its rim is curved [m]."""

SLIVER_SHARE = 1e-3
"""Faces with a smaller sine between two edges say nothing about curvature."""

MAX_CONCAVE_RAD = np.radians(2.0)
"""Largest bend of a concave edge within a curved surface [rad]: less than meshes of convex bodies are wrong by."""

MAX_RADIUS_M = 10.0
"""Largest radius of what bends between wide facets [m]; streets and hills stay flat pieces. Design value."""

SMALL_FACET_M = 0.3
"""Facets narrower than this bend by any radius [m]. Design value."""


@dataclass(frozen=True)
class CurvedPart:
    """Curved surfaces of one mesh: Q of them, F faces, S surfaces."""

    group: np.ndarray
    """Curved surface of each flat surface, -1 for none, shape [S]."""
    normal: np.ndarray
    """Outward unit normal at each corner of each face, 0 for a face of none, shape [F, 3, 3]."""
    curvature: np.ndarray
    """Curvature at each corner, a symmetric matrix over the plane across its normal [1/m], shape [F, 3, 3, 3]."""
    edge_group: np.ndarray
    """Curved surface of each edge of the outlines, growing, shape [E]."""
    begin: np.ndarray
    """Shape [E, 3], [m]."""
    end: np.ndarray
    """Shape [E, 3], [m]."""
    facing: np.ndarray
    """Outward unit normal of the facet at each edge, shape [E, 3]."""


@dataclass(frozen=True)
class CurvedTable:
    """Curved surfaces of a scene."""

    is_curved: np.ndarray
    """Whether a surface is a facet of a curved surface, shape [G], bool."""
    group: np.ndarray
    """Curved surface of each geometry row, -1 for none, shape [R]."""
    largest: np.ndarray
    """Largest surface of the curved surface of each, which names it; a flat surface itself, shape [G]."""
    first_facet: np.ndarray
    """First facet of each surface, shape [G]; of no meaning where it has none."""
    surface: np.ndarray
    """Surface of each facet, shape [F]."""
    device: CurvedFacets
    """The facets for kernels."""


def find_curved(mesh: MeshEdges, surface: np.ndarray, object_id: np.ndarray) -> CurvedPart:
    """Return the curved surfaces of a mesh.

    Args:
        mesh: Edges of the mesh.
        surface: Flat surface of each face, 0 to S - 1, shape [F].
        object_id: Object of each face, shape [F]; surfaces do not go on from one object to another.
    """
    count = int(surface.max(initial=-1)) + 1
    nothing = np.zeros((0, 3))
    normal, curvature = np.zeros((len(surface), 3, 3)), np.zeros((len(surface), 3, 3, 3))
    none = CurvedPart(np.full(count, -1), normal, curvature, np.zeros(0, dtype=np.int64), *[nothing] * 3)
    if not len(surface):
        return none
    doubled = np.cross(mesh.corner[:, 1] - mesh.corner[:, 0], mesh.corner[:, 2] - mesh.corner[:, 0])
    face_area = 0.5 * norm(doubled)
    area = np.bincount(surface, face_area, count)
    whole = np.maximum(area, 1e-300)[:, None]
    center = _sums(surface, mesh.corner.mean(axis=1) * face_area[:, None], count) / whole
    mean = _sums(surface, mesh.normal * face_area[:, None], count)
    mean /= np.maximum(norm(mean), 1e-300)[:, None]
    is_joined = _joins(mesh, surface, object_id, center)
    one, two = mesh.face[mesh.first[is_joined]], mesh.face[mesh.first[is_joined] + 1]
    label = components(count, surface[one], surface[two])
    is_curved = np.bincount(label, minlength=count)[label] > 1
    if not is_curved.any():
        return none
    group = np.full(count, -1)
    group[is_curved] = np.unique(label[is_curved], return_inverse=True)[1]
    of_face = np.where(mesh.has_area, group[surface], -1)
    own = np.flatnonzero(of_face >= 0)
    own = own[np.argsort(surface[own], kind="stable")]  # the order in which values are summed
    normal[own] = _corner_normals(mesh, own, of_face, surface, area, mean)
    curvature[own] = _corner_curvatures(mesh, own, of_face, normal[own])
    half, edge_group = _outlines(mesh, of_face)
    order = np.argsort(edge_group, kind="stable")
    half, edge_group = half[order], edge_group[order]
    begin, end = (mesh.points[mesh.vertex[half, k]] for k in (0, 1))
    facing = mesh.normal[mesh.face[half]]
    inward = np.cross(facing, end - begin)  # counter-clockwise if the facet lies on this side
    is_turned = dot(inward, mesh.points[mesh.opposite[half]] - begin) < 0.0
    begin, end = np.where(is_turned[:, None], end, begin), np.where(is_turned[:, None], begin, end)
    return CurvedPart(group, normal, curvature, edge_group, begin, end, facing)


def _sums(row: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Return sums of vectors by row, shape [count, 3]."""
    return np.stack([np.bincount(row, values[:, k], count) for k in range(3)], axis=1)


def _joins(mesh: MeshEdges, surface: np.ndarray, object_id: np.ndarray, center: np.ndarray) -> np.ndarray:
    """Return the edges over which a curved surface goes on, shape [n]."""
    edge = np.flatnonzero(mesh.size == 2)
    one, two = mesh.first[edge], mesh.first[edge] + 1
    f1, f2 = mesh.face[one], mesh.face[two]
    is_agreed = (mesh.vertex[one, 0] != mesh.vertex[two, 0]) & mesh.has_area[f1] & mesh.has_area[f2]
    is_agreed &= (object_id[f1] == object_id[f2]) & (surface[f1] != surface[f2])
    edge, one, two, f1, f2 = (values[is_agreed] for values in (edge, one, two, f1, f2))
    n1, n2 = mesh.normal[f1], mesh.normal[f2]
    bend = np.arctan2(norm(np.cross(n1, n2)), dot(n1, n2))
    begin, end = mesh.points[mesh.vertex[one, 0]], mesh.points[mesh.vertex[one, 1]]
    along = (end - begin) / np.maximum(norm(end - begin), 1e-300)[:, None]
    width = np.zeros(len(edge))
    for face in (f1, f2):  # a rectangle's middle is half of its width away
        arm = center[surface[face]] - begin
        width = np.maximum(width, 2.0 * norm(arm - dot(arm, along)[:, None] * along))
    is_concave = dot(n1, mesh.points[mesh.opposite[two]] - begin) > 0.0
    sagitta = 0.5 * width * np.tan(0.25 * bend)
    is_arc = (bend <= MAX_BEND_RAD) & (sagitta <= np.where(width <= SMALL_FACET_M, MAX_SAGITTA_M, WIDE_SAGITTA_M))
    is_arc &= (width <= SMALL_FACET_M) | (width <= 2.0 * MAX_RADIUS_M * np.sin(0.5 * bend))
    return edge[is_arc & (~is_concave | (bend <= MAX_CONCAVE_RAD))]


def _corner_normals(
    mesh: MeshEdges, own: np.ndarray, of_face: np.ndarray, surface: np.ndarray, area: np.ndarray, mean: np.ndarray
) -> np.ndarray:
    """Return the unit normal at the corners of faces of curved surfaces, shape [n, 3, 3].

    It is the mean over the flat pieces that meet there, weighted by their area: where a wide panel meets a narrow
    rounding, the rounding bends.
    """
    key = np.column_stack([mesh.welded[own].reshape(-1), np.repeat(of_face[own], 3), np.repeat(surface[own], 3)])
    piece, inverse = np.unique(key, axis=0, return_inverse=True)
    meeting, of_piece = np.unique(piece[:, :2], axis=0, return_inverse=True)
    total = _sums(of_piece.reshape(-1), mean[piece[:, 2]] * area[piece[:, 2]][:, None], len(meeting))
    total /= np.maximum(norm(total), 1e-300)[:, None]
    return total[of_piece.reshape(-1)[inverse.reshape(-1)]].reshape(-1, 3, 3)


def _corner_curvatures(mesh: MeshEdges, own: np.ndarray, of_face: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return the curvature at the corners of faces of curved surfaces [1/m], shape [n, 3, 3, 3].

    The curvature of a face is the change of the normals between its corners over their distances, without hollows; at
    a corner the mean, weighted by area, of the faces that meet there, each turned to the normal of the corner.

    Args:
        mesh: Edges of the mesh.
        own: The faces, shape [n].
        of_face: Curved surface of each face of the mesh.
        normal: Unit normals at their corners, shape [n, 3, 3].

    Source: S. Rusinkiewicz, Estimating curvatures and their derivatives on triangle meshes, 3DPVT 2004.
    """
    a, b, c = mesh.corner[own].swapaxes(0, 1)
    x = (b - a) / norm(b - a)[:, None]
    up = mesh.normal[own]
    y = np.cross(up, x)
    run, rise = (
        np.stack([np.stack([dot(v, x), dot(v, y)], axis=1) for v in pair], axis=2)  # [n, axis, edge]
        for pair in ((b - a, c - a), (normal[:, 1] - normal[:, 0], normal[:, 2] - normal[:, 0]))
    )
    is_wide = np.abs(np.linalg.det(run)) > SLIVER_SHARE * norm(b - a) * norm(c - a)
    bend = np.where(is_wide[:, None, None], rise @ np.linalg.inv(np.where(is_wide[:, None, None], run, np.eye(2))), 0.0)
    share, direction = np.linalg.eigh(0.5 * (bend + bend.swapaxes(1, 2)))
    bend = (direction * np.maximum(share, 0.0)[:, None]) @ direction.swapaxes(1, 2)
    plane = np.stack([x, y], axis=2)
    of_faces = plane @ bend @ plane.swapaxes(1, 2)
    key = np.column_stack([mesh.welded[own].reshape(-1), np.repeat(of_face[own], 3)])
    _, meeting = np.unique(key, axis=0, return_inverse=True)
    meeting = meeting.reshape(-1)
    area = np.repeat(0.5 * norm(np.cross(b - a, c - a)), 3)
    turned = _turned(np.repeat(of_faces, 3, axis=0), np.repeat(up, 3, axis=0), normal.reshape(-1, 3))
    count = int(meeting.max()) + 1
    total = np.stack(
        [np.bincount(meeting, area * turned[:, i, j], count) for i in range(3) for j in range(3)], axis=1
    ).reshape(-1, 3, 3)
    total /= np.maximum(np.bincount(meeting, area, count), 1e-300)[:, None, None]
    return total[meeting].reshape(-1, 3, 3, 3)


def _turned(matrix: np.ndarray, normal: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return matrices over the planes across normals, turned with them to other normals the shortest way, [N, 3, 3]."""
    middle = normal + other
    turn = np.eye(3) - middle[:, :, None] * middle[:, None] / (1.0 + dot(normal, other))[:, None, None]
    turn = turn + 2.0 * other[:, :, None] * normal[:, None]
    return turn @ matrix @ turn.swapaxes(1, 2)


def _outlines(mesh: MeshEdges, of_face: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the half-edges at which curved surfaces end, and the curved surface of each."""
    edge = np.repeat(np.arange(len(mesh.size)), mesh.size)
    half = (
        np.repeat(mesh.first, mesh.size) + np.arange(len(edge)) - np.repeat(np.cumsum(mesh.size) - mesh.size, mesh.size)
    )
    group = of_face[mesh.face[half]]
    _, at, times = np.unique(np.column_stack([edge, group]), axis=0, return_index=True, return_counts=True)
    keep = (times == 1) & (group[at] >= 0)
    return half[at[keep]], group[at[keep]]


def make_curved_table(
    parts: Sequence[tuple[MeshEdges, np.ndarray, np.ndarray, np.ndarray]],
    row: np.ndarray,
    first: np.ndarray,
    triangle_count: np.ndarray,
    area: np.ndarray,
    device: str,
) -> CurvedTable:
    """Return the curved surfaces of a scene.

    Args:
        parts: Edges, and surface, object and triangle on the device of each face, of the town and of every model.
        row: Geometry row of each surface of the scene, shape [G]; R rows.
        first: First triangle of each row, shape [R].
        triangle_count: Triangles of each row, shape [R].
        area: Area of each row [m^2], shape [R].
        device: Warp device.
    """
    curved = [find_curved(mesh, surface, object_id) for mesh, surface, object_id, _ in parts]
    groups = np.cumsum([0, *(int(part.group.max(initial=-1)) + 1 for part in curved)])
    count = int(triangle_count.sum())
    group_of, normal, curvature = np.full(count, -1), np.zeros((count, 3, 3)), np.zeros((count, 3, 3, 3))
    for part, (_, surface, _, at), k in zip(curved, parts, groups, strict=False):
        group_of[at] = np.where(part.group < 0, -1, part.group + k)[surface]
        normal[at], curvature[at] = part.normal, part.curvature
    group = group_of[first]
    edge_group = np.concatenate([part.edge_group + k for part, k in zip(curved, groups, strict=False)])
    is_curved = group[row] >= 0
    order = np.lexsort((-area, group))
    lead = np.zeros(int(groups[-1]) + 1, dtype=np.int64)  # the last one is that of no group
    lead[group[order[::-1]]] = order[::-1]  # the last one written stays
    every = np.arange(len(row))
    largest = np.where(is_curved, every + lead[group[row]] - row, every)  # rows of one carrier follow each other
    facet = np.flatnonzero(is_curved)
    pieces = triangle_count[row[facet]]
    surface = np.repeat(facet, pieces)
    triangle = (
        np.repeat(first[row[facet]], pieces) + np.arange(len(surface)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    )
    out = CurvedFacets()
    for name, values, dtype in (
        ("surface", surface, wp.int32),
        ("corner", 3 * triangle, wp.int32),
        ("normal", normal.reshape(-1, 3), wp.vec3d),
        ("curvature", curvature.reshape(-1, 3, 3), wp.mat33d),
        ("group", group, wp.int32),
        ("first", np.searchsorted(edge_group, np.arange(groups[-1] + 1)), wp.int32),
        ("begin", np.concatenate([part.begin for part in curved]), wp.vec3d),
        ("end", np.concatenate([part.end for part in curved]), wp.vec3d),
        ("facing", np.concatenate([part.facing for part in curved]), wp.vec3d),
    ):
        setattr(out, name, wp.array(values, dtype=dtype, device=device))
    return CurvedTable(is_curved, group, largest, np.searchsorted(surface, every), surface, out)
