"""Join the edges of a mesh that go on from one to the next: a rim, a curb, the outline of a roof.

A wave that is diffracted at one of them moves on over the others as the ends move, so they share its identity, and the
length over which it is formed. Lines that run side by side share the identity alone.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.core.planar_surfaces import components, weld
from mmw.kernels.channel.side_by_side import Edges, side_by_side_kernel
from mmw.physics.em.vectors import dot, norm

MAX_TURN_COS = np.cos(np.radians(30.0))
"""Edges that turn by less than 30 degrees where they meet go on. Design value."""

BESIDE_M = 0.2
"""Lines of a body that are nearer to each other share their name [m]: a corner that is rounded in a few facets, both
sides of a post, a trim along a car. The first Fresnel zone of a path of 28 GHz that ends 5 m away is as wide, so the
wave passes from one to the other without an end. Design value."""

PARALLEL_COS = np.cos(np.radians(25.0))
"""Cosine of the largest angle between two edges that run side by side. Design value."""

LONGEST_M = 1e4
"""A line that closes on itself goes on for this long [m]: without end, against every Fresnel zone."""


@dataclass(frozen=True)
class EdgeLines:
    """Lines of E edges."""

    name: np.ndarray
    """Lowest edge of the line of each edge and of those that run beside it, shape [E]."""
    ahead: np.ndarray
    """Length of the line before the begin and behind the end of each edge [m], shape [E, 2]."""


def join_edges(
    begin: np.ndarray, end: np.ndarray, away: np.ndarray, body: np.ndarray | None = None, device: str = "cpu"
) -> EdgeLines:
    """Return the lines of edges; each end goes on into the edge that turns the least, if that edge chooses it too.

    Args:
        begin: Begin of each edge [m], shape [E, 3].
        end: End of each edge [m], shape [E, 3].
        away: Unit vector across each edge into the open, shape [E, 3]; edges that face different ways do not join.
        body: What each belongs to, shape [E]; None for one body.
        device: Warp device that looks for edges that run side by side.
    """
    count = len(begin)
    if not count:
        nothing = np.zeros(0, dtype=np.int64)
        return EdgeLines(nothing, np.zeros((0, 2)))
    length = norm(end - begin)
    along = (end - begin) / length[:, None]
    out = np.concatenate([-along, along])  # end k of edge e is row k E + e
    vertex = weld(np.concatenate([begin, end]))
    order = np.argsort(vertex, kind="stable")
    chosen, best = np.full(2 * count, -1), np.full(2 * count, MAX_TURN_COS)
    step = 1
    while True:  # pairs of rows at one vertex, `step` apart in the order
        one, other = order[:-step], order[step:]
        near = vertex[one] == vertex[other]
        if not near.any():
            break
        one, other = one[near], other[near]
        fits = (dot(away[one % count], away[other % count]) > np.cos(np.pi / 4)) & (one % count != other % count)
        straight = np.where(fits, -dot(out[one], out[other]), -1.0)
        for a, b in ((one, other), (other, one)):
            is_better = straight > best[a]
            best[a[is_better]], chosen[a[is_better]] = straight[is_better], b[is_better]
        step += 1
        if step >= len(order):
            break
    row = np.flatnonzero(chosen >= 0)
    row = row[chosen[chosen[row]] == row]
    one, other = edges_side_by_side(begin, end, body, device)
    name = components(count, np.append(row % count, one), np.append(chosen[row] % count, other))
    # from an end over the next edge to its other end, and on, twice as far in each round
    following = np.arange(2 * count)
    following[row] = (chosen[row] + count) % (2 * count)
    gone = np.zeros(2 * count)
    gone[row] = length[chosen[row] % count]
    for _ in range(int(np.ceil(np.log2(count + 1))) + 1):
        gone = np.minimum(gone + gone[following], LONGEST_M)
        following = following[following]
    goes_on = np.zeros(2 * count, dtype=bool)
    goes_on[row] = True
    gone[goes_on[following]] = LONGEST_M
    ahead = np.stack([gone[:count], gone[count:]], axis=1)
    return EdgeLines(name, ahead)


def line_lengths(begin: np.ndarray, end: np.ndarray, ahead: np.ndarray) -> np.ndarray:
    """Return the length of the line of each edge, from its ends and `EdgeLines.ahead` [m], shape [E]."""
    return norm(end - begin) + ahead.sum(axis=1)


def edges_side_by_side(
    begin: np.ndarray, end: np.ndarray, body: np.ndarray | None = None, device: str = "cpu"
) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs of edges of one body, within `BESIDE_M` of each other and parallel; the first is the lower one.

    Args:
        begin: Begin of each edge [m], shape [E, 3].
        end: End of each edge [m], shape [E, 3].
        body: What each belongs to, shape [E]; None for one body.
        device: Warp device.
    """
    origin = 0.5 * (begin.min(axis=0) + begin.max(axis=0))  # float32 boxes resolve more about the middle
    margin = 0.5 * BESIDE_M + 1e-6 * float(np.abs(np.concatenate([begin, end]) - origin).max())
    edges = Edges()
    for name, side, sign in (("lower", np.minimum(begin, end), -1.0), ("upper", np.maximum(begin, end), 1.0)):
        box = (side - origin + sign * margin).astype(np.float32)
        setattr(edges, name, wp.array(box, dtype=wp.vec3, device=device))
    edges.begin = wp.array(begin - origin, dtype=wp.vec3d, device=device)
    edges.span = wp.array(end - begin, dtype=wp.vec3d, device=device)
    bodies = np.zeros(len(begin), dtype=np.int32) if body is None else body
    edges.body = wp.array(bodies, dtype=wp.int32, device=device)
    tree = wp.Bvh(edges.lower, edges.upper)

    def launch(is_writing: bool, start: wp.array, count: wp.array, other: wp.array) -> None:
        wp.launch(
            side_by_side_kernel,
            dim=len(begin),
            inputs=[tree.id, edges, BESIDE_M, PARALLEL_COS, is_writing, start],
            outputs=[count, other],
            device=device,
            block_dim=64,
        )

    count, nothing = (wp.empty(size, dtype=wp.int32, device=device) for size in (len(begin), 0))
    launch(False, nothing, count, nothing)
    counts = count.numpy()
    stop = np.cumsum(counts)
    start = wp.array(stop - counts, dtype=wp.int32, device=device)
    other = wp.empty(int(stop[-1]), dtype=wp.int32, device=device)
    launch(True, start, nothing, other)
    return np.repeat(np.arange(len(begin)), counts), other.numpy().astype(np.int64)
