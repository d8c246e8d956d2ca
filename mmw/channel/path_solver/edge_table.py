"""Find the wedges of a scene: convex edges between its flat surfaces, and edges of open sheets."""

from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.core.planar_surfaces import weld
from mmw.kernels.channel.edges import Wedges
from mmw.physics.em.vectors import dot, norm
from mmw.scene.device_scene import DeviceScene

MIN_WEDGE_RAD = 0.05
"""Smallest angle between the normals of a wedge's faces [rad]; flatter edges, as on a rounded bonnet, diffract
nothing that the facets do not reflect."""

NO_WEDGES = (*(np.zeros((0, 3)) for _ in range(5)), *(np.zeros(0, np.int32) for _ in range(2)))
"""Result of `find_wedges` where there are none."""

FOLDED = 1e-3
"""Faces back to back: the sum of their unit normals is shorter than this, which is the angle between them [rad]."""

SAME_PLACE_M = 1e-3
"""Pieces of an edge that are closer than this [m] are one edge."""


@dataclass(frozen=True)
class WedgeTable:
    """Wedges of the town and of every instance, by global id 0 to E - 1, in the frame of what carries them."""

    carrier: np.ndarray
    """Instance, V for the town, shape [E], int32."""
    begin: np.ndarray
    """One end of the edge [m], shape [E, 3]."""
    end: np.ndarray
    """Other end [m], shape [E, 3]."""
    normal_0: np.ndarray
    """Outward normal of one face, shape [E, 3]."""
    normal_n: np.ndarray
    """Outward normal of the other face, of a sheet the opposite one, shape [E, 3]."""
    away: np.ndarray
    """Unit vector across the edge into the open, between the two normals, shape [E, 3]."""
    surface_0: np.ndarray
    """Global surface of the first face, shape [E], int32."""
    surface_n: np.ndarray
    """Global surface of the second face, shape [E], int32."""
    device: Wedges
    """The same for kernels."""

    def __len__(self) -> int:
        return len(self.carrier)


def make_wedge_table(
    scene: DeviceScene, plane: np.ndarray, *, enabled: bool, sheets: bool, town: np.ndarray | None = None
) -> WedgeTable:
    """Return the wedges of a scene, or none if `enabled` is false.

    Args:
        scene: The scene; nothing of its batch is used.
        plane: Plane of every surface of the scene, shape [G].
        enabled: Whether diffraction is wanted.
        sheets: Whether the edges of open sheets are wanted too.
        town: Faces of the static world that have wedges, shape [M], bool; None for all.
    """
    arrays, instances = scene.arrays, enumerate(scene.instance_actor)
    columns = [(len(scene.instance_actor), 0, NO_WEDGES)]
    if enabled:
        faces = slice(None) if town is None else town
        of_town = find_wedges(arrays.points, arrays.faces[faces], arrays.surface[faces], sheets=sheets)
        of_model = [find_wedges(model.points, model.faces, model.surface, sheets=sheets) for model in arrays.models]
        columns.append((len(scene.instance_actor), 0, of_town))
        columns += [(k, int(scene.surface_offset[k]), of_model[arrays.actors[actor].model]) for k, actor in instances]
    vectors = [np.concatenate(values) for values in zip(*(wedges[:5] for _, _, wedges in columns), strict=True)]
    ids = [np.concatenate([wedges[k] + offset for _, offset, wedges in columns]) for k in (5, 6)]
    ids.append(np.concatenate([np.full(len(wedges[0]), carrier) for carrier, _, wedges in columns]))
    table = dict(zip(("begin", "end", "normal_0", "normal_n", "away"), vectors, strict=True))
    numbers = dict(zip(("surface_0", "surface_n", "carrier"), (values.astype(np.int32) for values in ids), strict=True))
    device = Wedges()
    for name, values in table.items():
        setattr(device, name, wp.array(values, dtype=wp.vec3d, device=scene.device))
    for name, values in numbers.items():
        setattr(device, name, wp.array(values, dtype=wp.int32, device=scene.device))
    face = plane[np.concatenate([numbers["surface_0"], numbers["surface_n"]])]
    order = np.argsort(face, kind="stable")
    first = np.searchsorted(face[order], np.arange(int(plane.max(initial=-1)) + 2))
    device.first = wp.array(first, dtype=wp.int32, device=scene.device)
    device.of_plane = wp.array(order % max(len(face) // 2, 1), dtype=wp.int32, device=scene.device)
    return WedgeTable(**numbers, **table, device=device)


def find_wedges(
    points: np.ndarray, faces: np.ndarray, surface: np.ndarray, *, sheets: bool = False
) -> tuple[np.ndarray, ...]:
    """Return the convex edges that two flat surfaces of a mesh share, and on request those that one face has alone.

    Faces are counter-clockwise from outside, so that convex and concave edges can be told apart; an edge between
    faces that disagree about the outside, or with three faces, is none. Closed bodies whose faces all look inward are
    turned. Faces back to back, as of a sheet that has both sides, have the edge of a half-plane.

    Args:
        points: Vertices [m], shape [N, 3].
        faces: Vertex indices, shape [M, 3].
        surface: Surface of each face, shape [M].
        sheets: Whether an edge with one face is the edge of an open sheet, with a face on both sides.

    Returns:
        begin, end, normal_0, normal_n, away, each [E, 3], and surface_0, surface_n, each [E]; sorted by the surfaces.
    """
    if len(faces) == 0:
        return NO_WEDGES
    vertex = weld(points)[faces]
    edges = vertex[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    face, opposite = np.repeat(np.arange(len(faces)), 3), faces[:, [2, 0, 1]].reshape(-1)
    is_forward = edges[:, 0] < edges[:, 1]
    order = np.lexsort((edges.max(axis=1), edges.min(axis=1)))
    low, high = edges.min(axis=1)[order], edges.max(axis=1)[order]
    starts = np.flatnonzero(np.append(True, (low[1:] != low[:-1]) | (high[1:] != high[:-1])))
    sizes = np.diff(np.append(starts, len(order)))
    real = low[starts] != high[starts]
    corner = points[faces].astype(np.float64)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    length = norm(normal)
    normal /= np.where(length > 0.0, length, 1.0)[:, None]
    is_turned = inside_out(points, faces, face[order], is_forward[order], starts[real], sizes[real])
    normal[is_turned] *= -1.0
    pair = starts[(sizes == 2) & real]
    one, two = order[pair], order[pair + 1]
    keep = (is_forward[one] != is_forward[two]) & (length[face[one]] > 0.0) & (length[face[two]] > 0.0)
    one, two = one[keep], two[keep]
    n0, nn = normal[face[one]], normal[face[two]]
    is_folded = norm(n0 + nn) < FOLDED
    depth = dot(n0, points[opposite[two]] - points[edges[one, 0]])
    is_wedge = (surface[face[one]] != surface[face[two]]) & (dot(n0, nn) < np.cos(MIN_WEDGE_RAD)) & (depth < 0.0)
    keep = is_wedge | is_folded
    one, two, n0, nn, is_folded = one[keep], two[keep], n0[keep], nn[keep], is_folded[keep]
    between = (n0 + nn) / np.where(is_folded, 1.0, norm(n0 + nn))[:, None]
    away = np.where(is_folded[:, None], _out_of_face(points, edges[one], opposite[one], n0), between)
    s0, sn = surface[face[one]], surface[face[two]]
    swap = s0 > sn
    s0, sn = np.where(swap, sn, s0), np.where(swap, s0, sn)
    n0, nn = np.where(swap[:, None], nn, n0), np.where(swap[:, None], n0, nn)
    if sheets:
        open_edge = order[starts[(sizes == 1) & real]]
        open_edge = open_edge[length[face[open_edge]] > 0.0]
        own = normal[face[open_edge]]
        out = _out_of_face(points, edges[open_edge], opposite[open_edge], own)
        one = np.concatenate([one, open_edge])
        n0, nn = np.concatenate([n0, own]), np.concatenate([nn, -own])
        away = np.concatenate([away, out])
        s0, sn = (np.concatenate([s, surface[face[open_edge]]]) for s in (s0, sn))
    if len(one) == 0:
        return NO_WEDGES
    return _joined(points[edges[one, 0]], points[edges[one, 1]], n0, nn, away, s0, sn)


def inside_out(
    points: np.ndarray, faces: np.ndarray, face: np.ndarray, is_forward: np.ndarray, starts: np.ndarray,
    sizes: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Return which faces are of a closed body whose faces all look inward, so that its volume is negative, shape [M].

    Args:
        points: Vertices [m], shape [N, 3].
        faces: Vertex indices, shape [M, 3].
        face: Face of each half-edge, those of one edge together, shape [3 M].
        is_forward: Whether the half-edge runs from its lower to its higher vertex, shape [3 M].
        starts: First half-edge of each edge, shape [E].
        sizes: Half-edges of each edge, shape [E].

    Source: volume by the divergence theorem, sum of (p0 - c) . ((p1 - c) x (p2 - c)) / 6 over the faces.
    """
    body = np.arange(len(faces))
    first = starts[sizes >= 2]
    links = np.stack([face[first], face[first + 1]], axis=1)
    while True:  # the lowest face of each body spreads over its faces
        lowest = np.minimum(body[links[:, 0]], body[links[:, 1]])
        before = body.copy()
        for side in (0, 1):
            np.minimum.at(body, links[:, side], lowest)
        body = body[body]
        if (body == before).all():
            break
    is_seam = sizes == 2
    is_seam[is_seam] = is_forward[starts[is_seam]] != is_forward[starts[is_seam] + 1]
    loose = np.bincount(body[face[starts[~is_seam]]], minlength=len(faces))  # open edges, or faces that disagree
    corner = points[faces].astype(np.float64)
    corner -= corner[body][:, :1]
    volume = np.bincount(body, weights=np.einsum("fk,fk->f", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])) / 6.0)
    size = np.bincount(body, weights=np.linalg.norm(corner, axis=2).max(axis=1) ** 3)
    is_turned = (loose[: len(volume)] == 0) & (volume < -1e-12 * size)  # a body without thickness has no inside
    return is_turned[body]


def _out_of_face(points: np.ndarray, edge: np.ndarray, opposite: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return the unit vector across an edge of a face, in its plane and away from it, shape [E, 3]."""
    out = np.cross(points[edge[:, 1]] - points[edge[:, 0]], normal)
    out /= np.maximum(norm(out), 1e-300)[:, None]
    inward = dot(out, points[opposite] - points[edge[:, 0]]) > 0.0
    return np.where(inward[:, None], -out, out)


def _joined(
    begin: np.ndarray, end: np.ndarray, n0: np.ndarray, nn: np.ndarray, away: np.ndarray, s0: np.ndarray, sn: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Return the edges with pieces that lie one behind the other on one line, between the same surfaces, made one."""
    along = (end - begin) / norm(end - begin)[:, None]
    lead = np.argmax(np.abs(along) > 1e-6, axis=1)
    flip = along[np.arange(len(along)), lead] < 0.0
    begin, end = np.where(flip[:, None], end, begin), np.where(flip[:, None], begin, end)
    along = np.where(flip[:, None], -along, along)
    foot = begin - dot(begin, along)[:, None] * along
    line = np.round(np.concatenate([along * 1e3, foot / SAME_PLACE_M], axis=1)).astype(np.int64)
    is_sheet = (s0 == sn)[:, None]  # a sheet has many edges, two surfaces have one line in common
    group = np.unique(np.column_stack([s0, sn, np.where(is_sheet, line, 0)]), axis=0, return_inverse=True)[1]
    group = group.reshape(-1)
    ahead = along[np.unique(group, return_index=True)[1]][group]
    low, high = dot(begin, ahead), dot(end, ahead)
    order = np.lexsort((low, group))
    group, low, high = group[order], low[order], high[order]
    is_new = np.append(True, (group[1:] != group[:-1]) | (low[1:] > high[:-1] + SAME_PLACE_M))
    first = np.flatnonzero(is_new)
    last = np.append(first[1:], len(order)) - 1
    first_piece, last_piece = order[first], order[last]
    vectors, ids = ([values[first_piece] for values in columns] for columns in ((n0, nn, away), (s0, sn)))
    return (begin[first_piece], end[last_piece], *vectors, *(values.astype(np.int32) for values in ids))
