"""Find the outlines of the flat surfaces of a scene, over all that are coplanar, to weigh their reflections."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import warp as wp

from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.planar_surfaces import sums_by_row
from mmw.core.transforms import cross
from mmw.kernels.channel.edge_integral import NODES
from mmw.kernels.channel.finite_surfaces import Outlines, lies_on_kernel
from mmw.physics.em.finite_surfaces import WEAKEST_SHARE
from mmw.physics.em.vectors import dot, norm

SAME_CORNER_M = 1e-4
"""Corners of triangles that are closer than this [m] are one, so that edges between panes cancel."""

STRAIGHT_RAD = 1e-3
"""Edges that bend by less than this are one."""


@dataclass(frozen=True)
class OutlineTable:
    """Outlines of the surfaces of town and models, in the frame of what carries them; no member for infinite ones."""

    of_plane: np.ndarray
    """Outline of every plane of a `SurfaceTable`, shape [K], int32."""
    first: np.ndarray
    """First edge of each outline, and the number of edges, shape [G + 1]."""
    begin: np.ndarray
    """Begin of each edge, counter-clockwise around `normal` [m], shape [E, 3]."""
    end: np.ndarray
    """End of each edge [m], shape [E, 3]."""
    normal: np.ndarray
    """Unit normal of each outline, shape [G, 3]."""
    width: np.ndarray
    """Smaller extent of each outline [m], shape [G]."""
    area: np.ndarray
    """Area inside each outline [m^2], shape [G]."""
    piece_of: np.ndarray
    """Outline of the surfaces of one plane and material that each surface of the scene belongs to, with the same
    `width` as that of the plane; -1 where a plane has one material, and for what lies on others, shape [S]."""
    piece_plane: np.ndarray
    """Outline of the plane that each outline is a piece of, -1 for those of planes, shape [G]."""
    piece_material: np.ndarray
    """Material of each piece, -1 for outlines of planes, shape [G]."""

    def pieces(self, outline: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the pieces of outlines of planes, shape [Q], one outline after the other, and their numbers, [Q]."""
        order, sorted_planes = self._pieces_by_plane
        low, high = (np.searchsorted(sorted_planes, outline, side) for side in ("left", "right"))
        count = high - low
        within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        return order[np.repeat(low, count) + within], count

    @cached_property
    def _pieces_by_plane(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows in the order of their planes, and these planes."""
        order = np.argsort(self.piece_plane, kind="stable")
        return order, self.piece_plane[order]

    def on_device(self, device: str, carriers_hz: tuple[float, ...], made: "Outlines | None" = None) -> Outlines:
        """Return the outlines for kernels, for a set of carriers; they share the arrays of those made before."""
        out = Outlines()
        for name, values, dtype in (
            ("group", self.of_plane, wp.int32),
            ("first", self.first, wp.int32),
            ("begin", self.begin, wp.vec3d),
            ("end", self.end, wp.vec3d),
            ("normal", self.normal, wp.vec3d),
            ("width", self.width, wp.float64),
            ("area", self.area, wp.float64),
        ):
            setattr(out, name, getattr(made, name) if made else wp.array(values, dtype=dtype, device=device))
        node, weight = np.polynomial.legendre.leggauss(NODES)
        for name, values in (("node", 0.5 * (node + 1.0)), ("weight", 0.5 * weight)):
            own = getattr(made.rule, name) if made else wp.array(values, dtype=wp.float64, device=device)
            setattr(out.rule, name, own)
        out.longest_m = SPEED_OF_LIGHT / min(carriers_hz)
        out.shortest_m = SPEED_OF_LIGHT / max(carriers_hz)
        out.weakest = WEAKEST_SHARE
        return out


def make_outline_table(
    triangle: np.ndarray, row_of: np.ndarray, group: np.ndarray, normal: np.ndarray, area: np.ndarray,
    of_plane: np.ndarray, material: np.ndarray, row: np.ndarray,
) -> OutlineTable:  # fmt: skip
    """Return the outlines of groups of coplanar surfaces, and where a group has several materials, those of each.

    An edge that two triangles of a group share is inside. Pieces of edges that lie on each other are left: their
    integrals cancel. Surfaces that lie on others of their group, such as markings on a road, add nothing.

    Args:
        triangle: Corners of the triangles [m], shape [T, 3, 3], those of one surface together.
        row_of: Surface of each, shape [T].
        group: Group of each surface, 0 to G - 1, shape [N].
        normal: Unit normal of each surface, shape [N, 3].
        area: Area of each surface [m^2], shape [N].
        of_plane: Group of each plane, shape [K].
        material: Material of each surface, shape [N].
        row: Row above of each surface of the scene, of which instances share some, shape [S].
    """
    count = int(group.max(initial=-1)) + 1
    order = np.lexsort((-area, group))
    lead = order[np.flatnonzero(np.append(True, group[order][1:] != group[order][:-1])[: len(order)])]
    facing = normal[lead]
    lies_on = _lying_on_others(triangle, row_of, group, area)
    keep = ~lies_on[row_of]
    triangle, row_of = triangle[keep], row_of[keep]
    own = group[row_of]
    pair, piece = np.unique(np.column_stack([own, material[row_of]]), axis=0, return_inverse=True)
    several = np.bincount(pair[:, 0], minlength=count)[pair[:, 0]] > 1
    pair, piece = pair[several], np.where(several, count + np.cumsum(several) - 1, -1)[piece.reshape(-1)]
    piece_of = np.full(len(group), -1)
    piece_of[row_of] = piece
    triangle, own = np.concatenate([triangle, triangle[piece >= 0]]), np.concatenate([own, piece[piece >= 0]])
    facing, count = np.concatenate([facing, facing[pair[:, 0]]]), count + len(pair)
    doubled = cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0])
    is_turned = dot(doubled, facing[own]) < 0.0
    triangle = np.where(is_turned[:, None, None], triangle[:, ::-1], triangle)
    corner = triangle.reshape(-1, 3)
    key = np.column_stack([np.repeat(own, 3), np.round(corner / SAME_CORNER_M).astype(np.int64)])
    _, at, vertex = np.unique(key, axis=0, return_index=True, return_inverse=True)
    vertex = vertex.reshape(-1, 3)
    edge = vertex[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    edge = edge[edge[:, 0] != edge[:, 1]]
    low, high = edge.min(axis=1), edge.max(axis=1)
    order = np.lexsort((high, low))
    low, high, sign = low[order], high[order], np.where(edge[order, 0] == low[order], 1, -1)
    starts = np.flatnonzero(np.append(True, (low[1:] != low[:-1]) | (high[1:] != high[:-1])))[: len(low)]
    net = np.add.reduceat(sign, starts) if len(starts) else np.zeros(0, dtype=int)
    starts, net = starts[net != 0], np.sign(net[net != 0])
    tail, head = np.where(net > 0, low[starts], high[starts]), np.where(net > 0, high[starts], low[starts])
    tail, head = _straightened(tail, head, corner[at])
    begin, end, of_edge = corner[at[tail]], corner[at[head]], key[at[tail], 0]
    order = np.argsort(of_edge, kind="stable")
    first = np.searchsorted(of_edge[order], np.arange(count + 1)).astype(np.int32)
    half = 0.5 * norm(doubled)
    size = np.bincount(own, half, count)
    width = _widths(triangle, own, half, size)
    plane_count = count - len(pair)
    width[plane_count:] = width[pair[:, 0]]
    none = np.full(plane_count, -1)
    pieces = (np.concatenate([none, column]) for column in pair.T)
    outlines = begin[order], end[order], facing, width, size
    return OutlineTable(of_plane.astype(np.int32), first, *outlines, piece_of[row], *pieces)


def _straightened(tail: np.ndarray, head: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return edges from vertex `tail` to vertex `head`, shape [E], with those made one that go straight on."""
    count = len(point)
    is_plain = (np.bincount(tail, minlength=count) == 1) & (np.bincount(head, minlength=count) == 1)
    leaving = np.full(count, -1)
    leaving[tail] = np.arange(len(tail))
    along = point[head] - point[tail]
    along /= np.maximum(norm(along), 1e-300)[:, None]
    following = np.where(is_plain[head], leaving[head], -1)
    goes_on = (following >= 0) & (dot(along, along[following]) > 1.0 - 0.5 * STRAIGHT_RAD**2)
    following = np.where(goes_on, following, np.arange(len(tail)))
    is_first = np.ones(len(tail), dtype=bool)
    is_first[following[goes_on]] = False
    while True:
        further = following[following]
        if (further == following).all():
            break
        following = further
    return tail[is_first], head[following[is_first]]


def _widths(triangle: np.ndarray, group: np.ndarray, area: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Return the smaller extent of groups of coplanar triangles [m]: that of the rectangle with the same moments.

    Args:
        triangle: Corners [m], shape [T, 3, 3].
        group: Group of each, shape [T].
        area: Area of each [m^2], shape [T].
        size: Area of each group [m^2], shape [G].
    """
    count, whole = len(size), np.maximum(size, 1e-12)
    center = sums_by_row(group, area[:, None] * triangle.mean(axis=1), count)
    offset = triangle - (center / whole[:, None])[group, None]
    corners = np.concatenate([offset, 3.0 * offset.mean(axis=1, keepdims=True)], axis=1)
    moment = np.empty(
        (count, 3, 3)
    )  # of a triangle: area / 12 times the sum over the corners and over thrice the middle
    for i in range(3):
        for j in range(3):
            own = area / 12.0 * (corners[:, :, i] * corners[:, :, j]).sum(axis=1)
            moment[:, i, j] = np.bincount(group, own, count) / whole
    return np.sqrt(12.0 * np.maximum(np.linalg.eigvalsh(moment)[:, 1], 0.0))


def _lying_on_others(triangle: np.ndarray, row_of: np.ndarray, group: np.ndarray, area: np.ndarray) -> np.ndarray:
    """Return which surfaces lie on a larger one of their group, by the middle of their largest triangle, shape [N]."""
    out = np.zeros(len(group), dtype=bool)
    of_triangle = group[row_of]
    order = np.argsort(of_triangle, kind="stable")
    first = np.searchsorted(of_triangle[order], np.arange(int(group.max(initial=-1)) + 2))
    twice = norm(cross(triangle[:, 1] - triangle[:, 0], triangle[:, 2] - triangle[:, 0]))
    by_area = np.lexsort((-twice, row_of))
    largest = by_area[np.append(True, row_of[by_area][1:] != row_of[by_area][:-1])[: len(by_area)]]
    largest = largest[np.bincount(group, minlength=len(first))[of_triangle[largest]] > 1]
    if not len(largest):
        return out
    found = wp.empty(len(largest), dtype=wp.uint8, device="cpu")
    given = [
        (triangle[largest].mean(axis=1), wp.vec3d),
        (row_of[largest], wp.int32),
        (of_triangle[largest], wp.int32),
        (first, wp.int32),
        (triangle[order].reshape(-1, 3), wp.vec3d),
        (row_of[order], wp.int32),
        (area, wp.float64),
    ]
    inputs = [wp.array(values, dtype=dtype, device="cpu") for values, dtype in given]
    wp.launch(lies_on_kernel, dim=len(largest), inputs=inputs, outputs=[found], device="cpu")
    out[row_of[largest]] = found.numpy().view(np.bool_)
    return out
