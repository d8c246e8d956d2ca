"""Join the edges of a mesh that go on from one to the next: a rim, a curb, the outline of a roof.

A wave that is diffracted at one of them moves on over the others as the ends move, so they share its identity, and the
length over which it is formed.
"""

from dataclasses import dataclass

import numpy as np

from mmw.core.planar_surfaces import components, weld
from mmw.physics.em.vectors import dot, norm

MAX_TURN_COS = np.cos(np.radians(30.0))
"""Edges that turn by less than 30 degrees where they meet go on. Design value."""

POST_LENGTH_M = 0.5
"""Edges of a line longer than this may run along a post [m]."""

POST_WIDTH_M = 0.6
"""Posts are narrower than this [m]. Design values."""

PARALLEL_COS = np.cos(np.radians(15.0))
"""Edges along one post, which may taper, have a larger cosine between them."""

LONGEST_M = 1e4
"""A line that closes on itself goes on for this long [m]: without end, against every Fresnel zone."""


@dataclass(frozen=True)
class EdgeLines:
    """Lines of E edges."""

    name: np.ndarray
    """Lowest edge of the line of each edge, shape [E]."""
    ahead: np.ndarray
    """Length of the line before the begin and behind the end of each edge [m], shape [E, 2]."""
    post: np.ndarray
    """Lowest edge of the post that each runs along, -1 for none, shape [E]."""


def join_edges(begin: np.ndarray, end: np.ndarray, away: np.ndarray, object_id: np.ndarray | None = None) -> EdgeLines:
    """Return the lines of edges; each end goes on into the edge that turns the least, if that edge chooses it too.

    Args:
        begin: Begin of each edge [m], shape [E, 3].
        end: End of each edge [m], shape [E, 3].
        away: Unit vector across each edge into the open, shape [E, 3]; edges that face different ways do not join.
        object_id: Object that each belongs to, shape [E], of which some are posts; None where there are no posts.
    """
    count = len(begin)
    if not count:
        nothing = np.zeros(0, dtype=np.int64)
        return EdgeLines(nothing, np.zeros((0, 2)), nothing)
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
    name = components(count, row % count, chosen[row] % count)
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
    has_posts = object_id is not None
    post = _posts(begin, end, along, ahead, object_id) if has_posts else np.full(count, -1)
    return EdgeLines(name, ahead, post)


def line_lengths(begin: np.ndarray, end: np.ndarray, ahead: np.ndarray) -> np.ndarray:
    """Return the length of the line of each edge, from its ends and `EdgeLines.ahead` [m], shape [E]."""
    return norm(end - begin) + ahead.sum(axis=1)


def _posts(
    begin: np.ndarray, end: np.ndarray, along: np.ndarray, ahead: np.ndarray, object_id: np.ndarray
) -> np.ndarray:
    """Return the lowest of the long parallel edges of one object that are close to each other, -1 for others, [E]."""
    post = np.full(len(begin), -1)
    length = norm(end - begin)
    long = np.flatnonzero(line_lengths(begin, end, ahead) > POST_LENGTH_M)
    order = long[np.argsort(object_id[long], kind="stable")]
    first, other = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    step = 1
    while step < len(order):
        a, b = order[:-step], order[step:]
        near = object_id[a] == object_id[b]
        if not near.any():
            break
        a, b = a[near], b[near]
        is_near, _ = _across(begin, along, length, a, b)
        first.append(a[is_near])
        other.append(b[is_near])
        step += 1
    a, b = np.concatenate(first), np.concatenate(other)
    label = components(len(begin), a, b)
    member = np.unique(np.concatenate([a, b]))
    _, spread = _across(begin, along, length, label[member], member)
    widest = np.zeros(len(begin))
    np.maximum.at(widest, label[member], spread)
    is_post = widest[label[member]] < POST_WIDTH_M
    post[member[is_post]] = label[member[is_post]]
    return post


def _across(
    begin: np.ndarray, along: np.ndarray, length: np.ndarray, one: np.ndarray, other: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return whether pairs of edges are parallel neighbors, side by side, and how far they are apart [m]."""
    middle = begin[other] + 0.5 * length[other, None] * along[other] - begin[one]
    at = dot(middle, along[one])
    apart = norm(middle - at[:, None] * along[one])
    reach = 0.5 * length[other] + POST_LENGTH_M
    is_beside = (at > -reach) & (at < length[one] + reach)
    return is_beside & (apart < POST_WIDTH_M) & (np.abs(dot(along[one], along[other])) > PARALLEL_COS), apart
