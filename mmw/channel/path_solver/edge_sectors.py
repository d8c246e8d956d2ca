"""Find the open sectors around edges that more faces touch than the two of a free wedge: where bodies meet.

Around a line the faces that touch it are half-planes. Sorted by angle, each of them enters or leaves a body; where no
body is, the sector is open, and one wider than a straight angle is a wedge of the two faces that bound it.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.kernels.channel.edge_contacts import MIN_CONTACT_M, TOUCH_M, TOUCH_SHARE, EdgeBoxes, edge_contacts_kernel
from mmw.physics.em.vectors import dot, norm
from mmw.scene.mesh_edges import MeshEdges

SAME_SIDE_RAD = 1e-3
"""Half-planes whose angles differ by less [rad] are one. Faces back to back have unit normals whose sum is shorter."""


@dataclass(frozen=True)
class Contacts:
    """Faces that touch edges which they do not share, one row for each side of the edge on which they lie."""

    edge: np.ndarray
    """Row of the edge, shape [C]."""
    face: np.ndarray
    """Face, shape [C]."""
    low: np.ndarray
    """Begin of the contact, from the edge's begin [m], shape [C]."""
    high: np.ndarray
    """End of it [m], shape [C]."""
    side: np.ndarray
    """Unit vector across the edge into the face, shape [C, 3]."""

    def of(self, edges: np.ndarray) -> "Contacts":
        """Return the contacts of some edges, whose rows `edge` of the result counts; `edges` is sorted."""
        keep = np.flatnonzero(np.isin(self.edge, edges))
        edge = np.searchsorted(edges, self.edge[keep])
        return Contacts(edge, self.face[keep], self.low[keep], self.high[keep], self.side[keep])


def find_contacts(mesh: MeshEdges, edges: np.ndarray, device: str) -> Contacts:
    """Return the faces that lie along edges without having them: those that end there and those that go on.

    Args:
        mesh: Edges of a mesh.
        edges: Rows of the edges that are wanted, shape [W]; `edge` of the result counts these.
        device: Warp device.
    """
    edge, face, low, high = _touching(mesh, edges, device)
    is_own = np.zeros(len(edge), dtype=bool)
    for k in range(2, int(mesh.size[edges].max(initial=0))):
        has = mesh.size[edges[edge]] > k
        is_own |= has & (mesh.face[mesh.first[edges[edge]] + np.where(has, k, 0)] == face)
    keep = ~is_own & mesh.has_area[face]
    edge, face, low, high = edge[keep], face[keep], low[keep], high[keep]
    begin, end = (mesh.points[mesh.vertex[mesh.first[edges[edge]], k]] for k in (0, 1))
    length = norm(end - begin)
    across = np.cross(mesh.normal[face], (end - begin) / length[:, None])
    across /= np.maximum(norm(across), 1e-300)[:, None]
    reach = dot(mesh.corner[face] - begin[:, None], across[:, None])
    wide = 2.0 * np.minimum(TOUCH_M.value, TOUCH_SHARE.value * length)
    rows = [np.flatnonzero(is_there) for is_there in (reach.max(axis=1) > wide, reach.min(axis=1) < -wide)]
    both = np.concatenate(rows)
    side = np.concatenate([across[rows[0]], -across[rows[1]]])
    return Contacts(edge[both], face[both], low[both], high[both], side)


def _touching(mesh: MeshEdges, edges: np.ndarray, device: str) -> tuple[np.ndarray, ...]:
    """Return edge, face, and from where to where they touch [m], sorted; without two faces that have the edge."""
    nothing = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0)
    if not len(edges):
        return nothing
    begin, end = (mesh.points[mesh.vertex[mesh.first[edges], k]] for k in (0, 1))
    corners = [mesh.corner[:, k] for k in range(3)]
    low, high = np.minimum.reduce(corners), np.maximum.reduce(corners)
    origin = 0.5 * (low.min(axis=0) + high.max(axis=0))  # float32 boxes resolve more about the middle
    slack = TOUCH_M.value + 1e-6 * float((high.max(axis=0) - origin).max())

    def box(low: np.ndarray, high: np.ndarray, margin: float) -> list[wp.array]:
        sides = (low - (origin + margin), high - (origin - margin))
        return [wp.array(side.astype(np.float32), dtype=wp.vec3, device=device) for side in sides]

    tree = wp.Bvh(*box(low, high, slack))
    table = EdgeBoxes()
    table.lower, table.upper = box(np.minimum(begin, end), np.maximum(begin, end), 0.0)
    for name, values in (("begin", begin), ("end", end), ("corner", mesh.corner.reshape(-1, 3))):
        setattr(table, name, wp.array(values - origin, dtype=wp.vec3d, device=device))
    for name, k in (("own_0", 0), ("own_n", 1)):
        own = mesh.face[mesh.first[edges] + np.where(mesh.size[edges] > k, k, 0)]
        setattr(table, name, wp.array(own, dtype=wp.int32, device=device))

    def launch(rows: np.ndarray, count: wp.array, is_writing: bool, stop: wp.array, found: list[wp.array]) -> None:
        wp.launch(
            edge_contacts_kernel,
            dim=len(rows),
            inputs=[tree.id, table, wp.array(rows, dtype=wp.int32, device=device), is_writing, stop],
            outputs=[count, *found],
            device=device,
            block_dim=64,
        )

    def empty(size: int) -> list[wp.array]:
        return [wp.empty(size, dtype=kind, device=device) for kind in (wp.int32, wp.int32, wp.vec2d)]

    count = wp.zeros(len(begin), dtype=wp.int32, device=device)
    launch(np.arange(len(begin)), count, False, count, empty(0))
    counts = count.numpy()
    rows = np.flatnonzero(counts)
    if not len(rows):
        return nothing
    stop = np.cumsum(counts[rows])
    found = empty(int(stop[-1]))
    count, last = (wp.array(values, dtype=wp.int32, device=device) for values in (counts[rows], stop))
    launch(rows, count, True, last, found)
    edge, face, part = (values.numpy() for values in found)
    order = np.lexsort((face, edge))
    return edge[order].astype(np.int64), face[order].astype(np.int64), part[order, 0], part[order, 1]


def open_sectors(
    mesh: MeshEdges, edges: np.ndarray, contacts: Contacts, surface: np.ndarray, is_sheet: np.ndarray, min_bend: float
) -> tuple[np.ndarray, ...]:
    """Return the wedges at edges, piece by piece, from all half-planes that touch each piece.

    Args:
        mesh: Edges of a mesh.
        edges: Rows of the edges, shape [W].
        contacts: What touches them; `edge` counts `edges`.
        surface: Surface of each face, shape [M].
        is_sheet: Faces that have both sides, shape [M].
        min_bend: Smallest angle between the normals of a wedge's faces [rad].

    Returns:
        begin, end, normal_0, normal_n, away, each [E, 3], and surface_0, surface_n, each [E].
    """
    begin, end = (mesh.points[mesh.vertex[mesh.first[edges], k]] for k in (0, 1))
    length = norm(end - begin)
    unit = (end - begin) / length[:, None]
    half = np.repeat(mesh.first[edges], mesh.size[edges]) + _ramp(mesh.size[edges])
    edge = np.concatenate([np.repeat(np.arange(len(edges)), mesh.size[edges]), contacts.edge])
    face = np.concatenate([mesh.face[half], contacts.face])
    side = np.concatenate([-mesh.out_of_face(half), contacts.side])
    low = np.concatenate([np.zeros(len(half)), contacts.low])
    high = np.concatenate([length[edge[: len(half)]], contacts.high])
    keep = mesh.has_area[face]
    edge, face, side, low, high = edge[keep], face[keep], side[keep], low[keep], high[keep]
    piece_edge, piece_low, piece_high = _pieces(edge, low, high, length)
    of_edge = np.searchsorted(piece_edge, np.arange(len(edges) + 1))
    pieces = np.diff(of_edge)[edge]
    row = np.repeat(np.arange(len(edge)), pieces)  # a half-plane with each piece of its edge
    piece = np.repeat(of_edge[edge], pieces) + _ramp(pieces)
    middle = 0.5 * (piece_low + piece_high)[piece]
    is_there = (low[row] < middle) & (middle < high[row])
    row, piece = row[is_there], piece[is_there]
    first = np.zeros(len(edges), dtype=np.int64)
    first[edge[::-1]] = np.arange(len(edge))[::-1]  # the angle is measured from the first half-plane
    x_axis, along = side[first[edge[row]]], unit[edge[row]]
    normal = mesh.normal[face[row]]
    y_axis = np.cross(along, x_axis)
    angle = np.arctan2(dot(side[row], y_axis), dot(side[row], x_axis)) % (2.0 * np.pi)
    angle = np.where(angle > 2.0 * np.pi - SAME_SIDE_RAD, angle - 2.0 * np.pi, angle)
    is_leaving = dot(normal, np.cross(along, side[row])) > 0.0  # the open lies behind it, counter-clockwise
    both = np.flatnonzero(is_sheet[face[row]])
    twice = np.concatenate([np.arange(len(row)), both])
    is_leaving = np.concatenate([is_leaving, ~is_leaving[both]])
    normal = np.concatenate([normal, -normal[both]])
    lower, upper = _sectors(piece[twice], angle[twice], is_leaving, surface[face[row[twice]]])
    turn = angle[twice[upper]] - angle[twice[lower]]
    turn = np.where(turn < 0.5 * SAME_SIDE_RAD, turn + 2.0 * np.pi, turn)
    n0, nn = normal[lower], normal[upper]
    s0, sn = (surface[face[row[twice[k]]]] for k in (lower, upper))
    is_folded = norm(n0 + nn) < SAME_SIDE_RAD
    is_wedge = (turn > np.pi) & (dot(n0, nn) < np.cos(min_bend)) & (is_folded | (s0 != sn))
    lower, n0, nn, s0, sn, is_folded = (values[is_wedge] for values in (lower, n0, nn, s0, sn, is_folded))
    own = piece[twice[lower]]
    at, start, stop = piece_edge[own], piece_low[own], piece_high[own]
    between = (n0 + nn) / np.where(is_folded, 1.0, norm(n0 + nn))[:, None]
    return (
        np.where((start > 0.0)[:, None], begin[at] + start[:, None] * unit[at], begin[at]),
        np.where((stop < length[at])[:, None], begin[at] + stop[:, None] * unit[at], end[at]),
        n0,
        nn,
        np.where(is_folded[:, None], -side[row[twice[lower]]], between),
        s0,
        sn,
    )


def _pieces(
    edge: np.ndarray, low: np.ndarray, high: np.ndarray, length: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return pieces of edges, cut where a contact begins or ends: edge, begin and end of each [m], sorted.

    No piece is shorter than a contact, or than a quarter of its edge.
    """
    every = np.arange(len(length))
    at, of = np.concatenate([low, high]), np.concatenate([edge, edge])
    near = np.minimum(MIN_CONTACT_M.value, 0.25 * length)
    at = np.where(at < near[of], 0.0, np.where(at > length[of] - near[of], length[of], at))
    of, at = np.concatenate([every, every, of]), np.concatenate([np.zeros(len(length)), length, at])
    order = np.lexsort((at, of))
    of, at = of[order], at[order]
    is_cut = np.append(True, (of[1:] != of[:-1]) | (at[1:] - at[:-1] > near[of[1:]]))
    of, at = of[is_cut], at[is_cut]
    inner = of[1:] == of[:-1]
    return of[:-1][inner], at[:-1][inner], at[1:][inner]


def _sectors(
    piece: np.ndarray, angle: np.ndarray, is_leaving: np.ndarray, surface: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows of the half-planes on both sides of each open sector, counter-clockwise.

    Half-planes at one angle bound sectors together; of those the lowest surface counts. Bodies are counted around the
    edge: a sector is open where the fewest are. Where as many half-planes enter as leave, this tells a wall between two
    bodies from a sheet in the open; otherwise the faces that look into a sector have to do.

    Args:
        piece: Piece of an edge that each half-plane touches, shape [N].
        angle: Angle around the edge [rad], shape [N].
        is_leaving: Whether a body ends there, counter-clockwise, shape [N].
        surface: Surface of the half-plane, shape [N].
    """
    order = np.lexsort((surface, angle, piece))
    of, at = piece[order], angle[order]
    is_new = np.append(True, (of[1:] != of[:-1]) | (at[1:] - at[:-1] > SAME_SIDE_RAD))[: len(of)]
    cluster, start = np.cumsum(is_new) - 1, np.flatnonzero(is_new)
    count = len(start)
    leave, enter = (_lowest(cluster, order, is_leaving[order] == side, surface, count) for side in (True, False))
    owner = of[start]
    is_first = np.append(True, owner[1:] != owner[:-1])[:count]
    begin = np.flatnonzero(is_first)
    group = np.cumsum(is_first) - 1
    following = np.arange(count) + 1
    following[np.append(begin[1:], count)[: len(begin)] - 1] = begin
    net = np.bincount(cluster, weights=np.where(is_leaving[order], -1.0, 1.0), minlength=count)
    inside = np.cumsum(net)  # the smallest of each piece is that of the open, wherever the count begins
    total = np.bincount(group, weights=net, minlength=len(begin))
    lowest = np.minimum.reduceat(inside, begin) if count else inside
    is_open = (leave >= 0) & (enter[following] >= 0)
    is_open &= (total[group] != 0.0) | (inside == lowest[group])
    return leave[is_open], enter[following[is_open]]


def _lowest(cluster: np.ndarray, row: np.ndarray, is_wanted: np.ndarray, surface: np.ndarray, count: int) -> np.ndarray:
    """Return the wanted row of lowest surface in each cluster, -1 where there is none, shape [count]."""
    cluster, row = cluster[is_wanted], row[is_wanted]
    order = np.lexsort((surface[row], cluster))[::-1]
    lowest = np.full(count, -1)
    lowest[cluster[order]] = row[order]  # the last one written stays
    return lowest


def _ramp(counts: np.ndarray) -> np.ndarray:
    """Return 0 to n - 1 for each n of counts, one after the other."""
    return np.arange(int(counts.sum())) - np.repeat(np.cumsum(counts) - counts, counts)
