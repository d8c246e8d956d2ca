"""Find the curved surfaces that a mesh shows as small facets, such as posts and panels of vehicles.

Two facets of one object belong to one curved surface where they meet without a concave edge and lie near the arc that
the edge suggests: chords of width w that meet at an angle b are 0.5 w tan(b / 4) from their arc, whose radius is
w / (2 sin(b / 2)). A square post has corners, a hexagonal one is a round post.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.channel.path_solver.curvature import corner_curvatures
from mmw.channel.path_solver.curved_extension import extend
from mmw.channel.path_solver.curved_outlines import Pieces, find_pieces, outline_edges
from mmw.core.planar_surfaces import components, sums_by_row
from mmw.kernels.channel.curved_surfaces import CurvedFacets
from mmw.physics.em.finite_surfaces import WEAKEST_CURVED_SHARE
from mmw.physics.em.vectors import dot, norm
from mmw.scene.mesh_edges import MeshEdges

MAX_BEND_RAD = np.radians(75.0)
"""Largest bend between two facets of a curved surface [rad]: a round trunk of five facets bends by 72 degrees."""

MAX_SAGITTA_M = 0.04
"""Farthest that a curved surface may lie from the chords of its facets [m]. Design value."""

WIDE_SAGITTA_M = 0.005
"""The same for facets that are no small ones: a panel with a rounded rim is flat, and its rim is curved [m]."""

MAX_CONCAVE_RAD = np.radians(2.0)
"""Largest bend of a concave edge within a curved surface [rad]: less than meshes of convex bodies are wrong by."""

MAX_RADIUS_M = 10.0
"""Largest radius of what bends between wide facets [m]; streets and hills stay flat pieces. Design value."""

PANEL_BEND_RAD = np.radians(3.0)
"""Facets that bend by less are one panel where normals are weighted: seams cut panels into narrow strips [rad]. Design
value."""

SMALL_FACET_M = 0.3
"""Facets narrower than this bend by any radius [m]. Design value."""


SHAPE_COLUMNS = ("corner", "normal", "curvature", "outside")


@dataclass(frozen=True)
class CurvedPart:
    """Curved surfaces of one mesh: Q of them, S flat surfaces, N facets, those beyond outlines behind the others."""

    group: np.ndarray
    """Curved surface of each flat surface, -1 for none, shape [S]."""
    face: np.ndarray
    """Face of the mesh that each facet is, or that it extends, shape [N]."""
    corner: np.ndarray
    """Corners of each facet [m], shape [N, 3, 3]."""
    normal: np.ndarray
    """Outward unit normal at each corner, shape [N, 3, 3]."""
    curvature: np.ndarray
    """Curvature at each corner, a symmetric matrix over the plane across its normal [1/m], shape [N, 3, 3, 3]."""
    outside: np.ndarray
    """1 at corners beyond an outline, 0 at others, shape [N, 3]."""
    edge: np.ndarray
    """Edge of the outlines that each facet extends, -1 for a face of the mesh, shape [N]."""
    pieces: Pieces
    """Pieces of one material."""
    edge_group: np.ndarray
    """Curved surface of each edge of the outlines, growing, and behind them Q + piece of those of pieces, shape [E]."""
    begin: np.ndarray
    """Shape [E, 3], [m]."""
    end: np.ndarray
    """Shape [E, 3], [m]."""
    facing: np.ndarray
    """Outward unit normal of the facet at each edge, shape [E, 3]."""
    end_normal: np.ndarray
    """Outward unit normal of the curved surface at both ends of each edge, shape [E, 2, 3]."""


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
    """Surface of each facet, with those that extend it behind its own, shape [F]."""
    is_beyond: np.ndarray
    """Whether each facet extends its surface beyond the outline, shape [F], bool."""
    piece: np.ndarray
    """Piece of one material that each surface is in, -1 where its curved surface has no more than one, shape [G]."""
    piece_group: np.ndarray
    """Curved surface of each piece, growing, shape [M]."""
    piece_material: np.ndarray
    """Material of each piece, shape [M]."""
    first_piece: int
    """Outline of the first piece; those of curved surfaces are before it."""
    device: CurvedFacets
    """The facets for kernels."""


def find_curved(mesh: MeshEdges, surface: np.ndarray, object_id: np.ndarray, material: np.ndarray) -> CurvedPart:
    """Return the curved surfaces of a mesh.

    Args:
        mesh: Edges of the mesh.
        surface: Flat surface of each face, 0 to S - 1, shape [F].
        object_id: Object of each face, shape [F]; surfaces do not go on from one object to another.
        material: Material of each face, that of its flat surface, shape [F].
    """
    count = int(surface.max(initial=-1)) + 1
    if not len(surface):
        return _no_curved(count)
    doubled = np.cross(mesh.corner[:, 1] - mesh.corner[:, 0], mesh.corner[:, 2] - mesh.corner[:, 0])
    face_area = 0.5 * norm(doubled)
    area = np.bincount(surface, face_area, count)
    whole = np.maximum(area, 1e-300)[:, None]
    center = sums_by_row(surface, mesh.corner.mean(axis=1) * face_area[:, None], count) / whole
    one, two, bend = _smooth_pairs(mesh, surface, object_id)
    is_arc = _lies_on_arc(mesh, surface, center, one, two, bend)
    of_one, of_two = surface[mesh.face[one]], surface[mesh.face[two]]
    label = components(count, of_one[is_arc], of_two[is_arc])
    is_panel = bend < PANEL_BEND_RAD
    panel = components(count, of_one[is_panel], of_two[is_panel])
    is_curved = np.bincount(label, minlength=count)[label] > 1
    if not is_curved.any():
        return _no_curved(count)
    group = np.full(count, -1)
    group[is_curved] = np.unique(label[is_curved], return_inverse=True)[1]
    of_face = np.where(mesh.has_area, group[surface], -1)
    own = np.flatnonzero(of_face >= 0)
    own = own[np.argsort(surface[own], kind="stable")]  # the order in which values are summed
    vertices = np.column_stack([mesh.welded[own].reshape(-1), np.repeat(of_face[own], 3)])
    meeting = np.unique(vertices, axis=0, return_inverse=True)[1].reshape(-1, 3)
    normal = _corner_normals(mesh, own, meeting, panel[surface], np.bincount(panel, area, count))
    of_surface = np.zeros(count, dtype=np.int64)
    of_surface[surface] = material
    pieces = find_pieces(group, of_surface)
    whole_edges = outline_edges(mesh, of_face)
    piece_edges = outline_edges(mesh, np.where(mesh.has_area, pieces.of_surface[surface], -1))
    half, edge_group, vertex = (np.concatenate(pair) for pair in zip(whole_edges, piece_edges, strict=True))
    edges = len(whole_edges[0])
    edge_group[edges:] += int(group.max()) + 1
    facing = mesh.normal[mesh.face[half]]
    place = np.empty(len(surface), dtype=np.int64)
    place[own] = np.arange(len(own))
    row = place[mesh.face[half]][:, None]
    at = np.argmax(mesh.welded[own[row]] == vertex[..., None], axis=2)
    middle = center[surface[mesh.face[half[:edges]]]]
    normal = _turned_at_outlines(mesh, meeting, normal, half[:edges], middle, row[:edges, 0], at[:edges])
    curvature = corner_curvatures(mesh, own, meeting, of_face[own], normal)
    ends, end_normal = mesh.points[vertex], normal[row, at]
    inner = row[:edges], at[:edges]
    beyond = extend(ends[:edges], meeting[inner], facing[:edges], end_normal[:edges], curvature[inner])
    return CurvedPart(
        group=group,
        face=np.concatenate([own, mesh.face[half][beyond.edge]]),
        corner=np.concatenate([mesh.corner[own], beyond.corner]),
        normal=np.concatenate([normal, beyond.normal]),
        curvature=np.concatenate([curvature, beyond.curvature]),
        outside=np.concatenate([np.zeros((len(own), 3)), beyond.outside]),
        edge=np.concatenate([np.full(len(own), -1), beyond.edge]),
        pieces=pieces,
        edge_group=edge_group,
        begin=ends[:, 0],
        end=ends[:, 1],
        facing=facing,
        end_normal=end_normal,
    )


def _no_curved(count: int) -> CurvedPart:
    """Return no curved surface of a mesh with a number of flat ones."""
    rows, points, triples = np.zeros(0, dtype=np.int64), np.zeros((0, 3)), np.zeros((0, 3, 3))
    return CurvedPart(
        group=np.full(count, -1),
        face=rows,
        corner=triples,
        normal=triples,
        curvature=np.zeros((0, 3, 3, 3)),
        outside=points,
        edge=rows,
        pieces=Pieces(np.full(count, -1), rows, rows),
        edge_group=rows,
        begin=points,
        end=points,
        facing=points,
        end_normal=np.zeros((0, 2, 3)),
    )


def _smooth_pairs(
    mesh: MeshEdges, surface: np.ndarray, object_id: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the half-edges of each edge between flat surfaces of one object that agree about the outside, and its bend
    [rad], shape [n] each.
    """
    one = mesh.first[mesh.size == 2]
    two = one + 1
    f1, f2 = mesh.face[one], mesh.face[two]
    is_agreed = (mesh.vertex[one, 0] != mesh.vertex[two, 0]) & mesh.has_area[f1] & mesh.has_area[f2]
    is_agreed &= (object_id[f1] == object_id[f2]) & (surface[f1] != surface[f2])
    one, two = one[is_agreed], two[is_agreed]
    n1, n2 = mesh.normal[mesh.face[one]], mesh.normal[mesh.face[two]]
    return one, two, np.arctan2(norm(np.cross(n1, n2)), dot(n1, n2))


def _lies_on_arc(
    mesh: MeshEdges, surface: np.ndarray, center: np.ndarray, one: np.ndarray, two: np.ndarray, bend: np.ndarray
) -> np.ndarray:
    """Return over which edges, given by their half-edges, a curved surface goes on, shape [n]."""
    begin, end = mesh.points[mesh.vertex[one, 0]], mesh.points[mesh.vertex[one, 1]]
    along = (end - begin) / np.maximum(norm(end - begin), 1e-300)[:, None]
    width = np.zeros(len(one))
    for half in (one, two):  # a rectangle's middle is half of its width away
        arm = center[surface[mesh.face[half]]] - begin
        width = np.maximum(width, 2.0 * norm(arm - dot(arm, along)[:, None] * along))
    is_concave = dot(mesh.normal[mesh.face[one]], mesh.points[mesh.opposite[two]] - begin) > 0.0
    sagitta = 0.5 * width * np.tan(0.25 * bend)
    is_arc = (bend <= MAX_BEND_RAD) & (sagitta <= np.where(width <= SMALL_FACET_M, MAX_SAGITTA_M, WIDE_SAGITTA_M))
    is_arc &= (width <= SMALL_FACET_M) | (width <= 2.0 * MAX_RADIUS_M * np.sin(0.5 * bend))
    return is_arc & (~is_concave | (bend <= MAX_CONCAVE_RAD))


def _corner_normals(
    mesh: MeshEdges, own: np.ndarray, meeting: np.ndarray, panel: np.ndarray, area: np.ndarray
) -> np.ndarray:
    """Return the unit normal at the corners of faces of curved surfaces, shape [n, 3, 3].

    It is the mean over the panels that meet there, weighted by their whole area: where a wide panel meets a narrow
    rounding, the rounding bends, also where a seam cuts a narrow strip from the panel. That of a panel is the mean of
    its faces there, weighted by their angles, which does not depend on how it is cut into triangles.

    Args:
        mesh: Edges of the mesh.
        own: The faces, shape [n].
        meeting: Vertex of a curved surface at their corners, shape [n, 3].
        panel: Panel of each face of the mesh: faces that bend little from one to the next.
        area: Area of each panel [m^2].

    Source: G. Thuermer and C. A. Wuethrich, Computing vertex normals from polygonal facets, Journal of Graphics Tools 3
    (1998) (weights by angle).
    """
    corner = mesh.corner[own]
    to_next, to_last = np.roll(corner, -1, axis=1) - corner, np.roll(corner, 1, axis=1) - corner
    angle = np.arctan2(np.linalg.norm(np.cross(to_next, to_last), axis=2), (to_next * to_last).sum(axis=2))
    key = np.column_stack([meeting.reshape(-1), np.repeat(panel[own], 3)])
    sheet, of_corner = np.unique(key, axis=0, return_inverse=True)
    normal = sums_by_row(
        of_corner.reshape(-1), (mesh.normal[own][:, None] * angle[..., None]).reshape(-1, 3), len(sheet)
    )
    normal /= np.maximum(norm(normal), 1e-300)[:, None]
    total = sums_by_row(sheet[:, 0], normal * area[sheet[:, 1]][:, None], int(meeting.max()) + 1)
    total /= np.maximum(norm(total), 1e-300)[:, None]
    return total[meeting]


def _turned_at_outlines(
    mesh: MeshEdges,
    meeting: np.ndarray,
    normal: np.ndarray,
    half: np.ndarray,
    center: np.ndarray,
    row: np.ndarray,
    at: np.ndarray,
) -> np.ndarray:
    """Return the normals at the corners of faces, turned at outlines as far as they turn from the other side of a
    facet to its middle: the mean over the facets that meet at a corner lacks those beyond, shape [n, 3, 3].

    Args:
        mesh: Edges of the mesh.
        meeting: Vertex of a curved surface at the corners of faces, shape [n, 3].
        normal: Unit normals there, shape [n, 3, 3].
        half: Half-edges of the outlines, shape [E].
        center: Middle of the flat surface at each [m], shape [E, 3].
        row: Face at each, a row of `meeting`, shape [E].
        at: Corner of that face at both ends of each, shape [E, 2].
    """
    out = mesh.out_of_face(half)
    begin, far = mesh.points[mesh.vertex[half, 0]], mesh.points[mesh.opposite[half]]
    turn = -dot(normal[row, 3 - at.sum(axis=1)], out)
    share = dot(begin - center, out) / np.maximum(dot(center - far, out), 1e-12)
    turn = np.clip(turn * np.clip(share, 0.0, 1.0), 0.0, np.sin(0.5 * MAX_BEND_RAD))
    count, ends = int(meeting.max()) + 1, meeting[row[:, None], at].reshape(-1)
    out, turn = np.repeat(out, 2, axis=0), np.repeat(turn, 2)
    across = sums_by_row(ends, (out[:, :, None] * out[:, None]).reshape(-1, 9), count).reshape(-1, 3, 3)
    total = sums_by_row(ends, turn[:, None] * out, count)
    turned = np.einsum("vij,vj->vi", np.linalg.pinv(across, rcond=0.1, hermitian=True), total)  # fits all edges best
    normal = normal + turned[meeting]
    return normal / np.linalg.norm(normal, axis=2)[..., None]


def make_curved_table(
    parts: Sequence[tuple[MeshEdges, np.ndarray, np.ndarray, np.ndarray, np.ndarray]],
    row: np.ndarray,
    first: np.ndarray,
    triangle_count: np.ndarray,
    area: np.ndarray,
    device: str,
) -> CurvedTable:
    """Return the curved surfaces of a scene.

    Args:
        parts: Edges, and surface, object, material and triangle on the device of each face, of the town and of every
            model.
        row: Geometry row of each surface of the scene, shape [G]; R rows.
        first: First triangle of each row, shape [R].
        triangle_count: Triangles of each row, shape [R].
        area: Area of each row [m^2], shape [R].
        device: Warp device.
    """
    curved = [find_curved(*part[:-1]) for part in parts]
    groups = np.cumsum([0, *(int(part.group.max(initial=-1)) + 1 for part in curved)])
    numbers = np.cumsum([0, *(len(part.pieces.group) for part in curved)])
    row_of = np.repeat(np.arange(len(first)), triangle_count)  # of each triangle
    group, piece, rows, edge_group = np.full(len(first), -1), np.full(len(first), -1), [], []
    for part, (_, surface, _, _, at), k, m in zip(curved, parts, groups, numbers, strict=False):
        own = part.pieces.of_surface
        group[row_of[at]] = np.where(part.group < 0, -1, part.group + k)[surface]
        piece[row_of[at]] = np.where(own < 0, -1, own + m)[surface]
        rows.append(row_of[at][part.face])
        count = int(part.group.max(initial=-1)) + 1
        edge_group.append(part.edge_group + np.where(part.edge_group < count, k, groups[-1] + m - count))
    edge_group = np.concatenate(edge_group)
    by_group = np.argsort(edge_group, kind="stable")
    is_curved = group[row] >= 0
    order = np.lexsort((-area, group))
    lead = np.zeros(int(groups[-1]) + 1, dtype=np.int64)  # the last one is that of no group
    lead[group[order[::-1]]] = order[::-1]  # the last one written stays
    every = np.arange(len(row))
    largest = np.where(is_curved, every + lead[group[row]] - row, every)  # rows of one carrier follow each other
    edges = np.cumsum([0, *(len(part.begin) for part in curved)])
    moved = np.append(np.argsort(by_group), -1)
    edge = [moved[np.where(part.edge < 0, -1, part.edge + k)] for part, k in zip(curved, edges, strict=False)]
    shapes = {name: np.concatenate([getattr(part, name) for part in curved]) for name in SHAPE_COLUMNS}
    of_shape, of_edge = np.concatenate(rows), np.concatenate(edge)
    order = np.lexsort((of_edge, of_shape))
    begin_of, end_of = (np.searchsorted(of_shape[order], np.arange(len(first)), side) for side in ("left", "right"))
    facet = np.flatnonzero(is_curved)
    pieces = (end_of - begin_of)[row[facet]]
    surface = np.repeat(facet, pieces)
    shape = np.repeat(begin_of[row[facet]] - np.cumsum(pieces) + pieces, pieces) + np.arange(len(surface))
    out = CurvedFacets()
    span = np.searchsorted(surface, every), np.searchsorted(surface, every, "right")
    members = np.stack([np.full(len(row), len(surface)), np.zeros(len(row), dtype=np.int64)], axis=1)
    np.minimum.at(members[:, 0], largest, span[0])
    np.maximum.at(members[:, 1], largest, span[1])
    for name, values, dtype in (
        ("surface", surface, wp.int32),
        ("shape", shape, wp.int32),
        ("corner", shapes["corner"][order].reshape(-1, 3), wp.vec3d),
        ("normal", shapes["normal"][order].reshape(-1, 3), wp.vec3d),
        ("curvature", shapes["curvature"][order].reshape(-1, 3, 3), wp.mat33d),
        ("outside", shapes["outside"][order], wp.vec3d),
        ("edge", of_edge[order], wp.int32),
        ("member", members[largest], wp.vec2i),
        ("group", group, wp.int32),
        ("first", np.searchsorted(edge_group[by_group], np.arange(groups[-1] + numbers[-1] + 1)), wp.int32),
        ("begin", np.concatenate([part.begin for part in curved])[by_group], wp.vec3d),
        ("end", np.concatenate([part.end for part in curved])[by_group], wp.vec3d),
        ("facing", np.concatenate([part.facing for part in curved])[by_group], wp.vec3d),
        ("begin_normal", np.concatenate([part.end_normal[:, 0] for part in curved])[by_group], wp.vec3d),
        ("end_normal", np.concatenate([part.end_normal[:, 1] for part in curved])[by_group], wp.vec3d),
    ):
        setattr(out, name, wp.array(values, dtype=dtype, device=device))
    out.weakest = WEAKEST_CURVED_SHARE
    is_beyond = of_edge[order][shape] >= 0
    piece_group = np.concatenate([part.pieces.group + k for part, k in zip(curved, groups, strict=False)])
    piece_material = np.concatenate([part.pieces.material for part in curved])
    named = piece[row], piece_group, piece_material, int(groups[-1])
    return CurvedTable(is_curved, group, largest, span[0], surface, is_beyond, *named, out)
