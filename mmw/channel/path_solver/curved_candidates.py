"""Find candidates of reflections at curved surfaces, and of several close ones on a surface the right one."""

from collections.abc import Iterator

import numpy as np

from mmw.channel.path_solver.candidate_output import PAIRS_AT_ONCE, selected_pairs
from mmw.channel.path_solver.curved_surfaces import CurvedTable
from mmw.channel.path_solver.search import Search
from mmw.channel.path_solver.traced_paths import TracedPaths
from mmw.kernels.channel.curved_surfaces import cull_curved_kernel
from mmw.physics.em.interaction import SPECULAR
from mmw.physics.em.vectors import norm

ONE_POINT_M = 0.25
"""Reflections at one curved surface closer than this are one [m]: a few facets. Design value."""


def curved_candidates(search: Search, curved: CurvedTable) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Yield links, steps and facets of reflections at curved surfaces: each facet with a point for each link."""
    links, count = search.links, len(curved.surface)
    at_once = max(1, PAIRS_AT_ONCE // max(count, 1))
    for begin in range(0, len(links) if count else 0, at_once):
        shape = min(at_once, len(links) - begin), count
        inputs = [search.forward.ends, search.table.device, curved.device, begin]
        link, facet = selected_pairs(search, cull_curved_kernel, inputs, shape)
        step = np.full((len(link), search.config.max_depth), -1, dtype=np.int32)
        step[:, 0] = curved.surface[facet]
        yield (link + begin).astype(np.int32), step, facet


def separate_points(found: TracedPaths, length: np.ndarray, curved: CurvedTable) -> np.ndarray:
    """Return the rows of reflections at curved surfaces without those near a shorter one on the same surface.

    The reflection at a convex surface is the shortest way over it. Normals of a mesh are not those of a convex surface
    everywhere, and give further points next to that.
    """
    step = np.argmax(found.kind == SPECULAR, axis=1)
    every = np.arange(len(found))
    wall, point = curved.largest[found.surface[every, step]], found.vertex[every, step]
    order = np.lexsort((length, wall, found.link))
    keep = np.ones(len(found), dtype=bool)
    ahead = 1
    while ahead < len(order):
        one, other = order[:-ahead], order[ahead:]
        is_same = (found.link[one] == found.link[other]) & (wall[one] == wall[other])
        if not is_same.any():
            break
        is_near = is_same & (norm(point[one] - point[other]) < ONE_POINT_M)
        keep[other[is_near]] = False
        ahead += 1
    return np.flatnonzero(keep)
