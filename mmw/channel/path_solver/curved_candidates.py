"""Find candidates of reflections at curved surfaces, and of several close ones on a surface the right one."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import warp as wp

from mmw.channel.path_solver.candidate_output import PAIRS_AT_ONCE, selected_pairs
from mmw.channel.path_solver.curved_surfaces import CurvedTable
from mmw.channel.path_solver.search import Search
from mmw.channel.path_solver.traced_paths import TracedPaths
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.kernels.channel.curved_candidates import cull_curved_kernel, curved_points_kernel
from mmw.kernels.channel.curved_shares import curved_piece_kernel, curved_share_kernel
from mmw.physics.em.vectors import norm

ONE_POINT_M = 0.25
"""Reflections at one curved surface closer than this are one [m]: a few facets. Design value."""

ONE_RIM_M = 1.0
"""Reflections beyond the outline of one curved surface closer than this are one [m]: those of opposite edges of a gap
disagree about what would be there. Design value."""


def curved_candidates(search: Search, curved: CurvedTable) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Yield links, steps and facets of reflections at curved surfaces: each facet with a point for each link."""
    links, count = search.links, len(curved.surface)
    at_once = max(1, PAIRS_AT_ONCE // max(count, 1))
    for begin in range(0, len(links) if count else 0, at_once):
        shape = min(at_once, len(links) - begin), count
        inputs = [search.forward.ends, search.table.device, curved.device, begin, search.outlines.longest_m]
        link, facet = selected_pairs(search, cull_curved_kernel, inputs, shape)
        step = np.full((len(link), search.config.max_depth), -1, dtype=np.int32)
        step[:, 0] = curved.surface[facet]
        yield (link + begin).astype(np.int32), step, facet


def separate_points(
    found: TracedPaths, facet: np.ndarray, point: np.ndarray, strength: np.ndarray, curved: CurvedTable
) -> np.ndarray:
    """Return the rows of reflections at curved surfaces without those near a stronger one on the same surface.

    A convex surface reflects at one point. Normals of a mesh are not those of a convex surface everywhere, and give
    further points next to that; several edges may reach the same point beyond an outline.

    Args:
        found: The paths.
        facet: Facet that reflects each, shape [P].
        point: Point of reflection of each [m], shape [P, 3].
        strength: Share of the field that each reflects over its length [1/m], shape [P]: where one takes over from
            another they are equal, so that the level has no step.
        curved: The curved surfaces.
    """
    wall, is_beyond = curved.largest[curved.surface[facet]], curved.is_beyond[facet]
    order = np.lexsort((-strength, wall, found.link))
    keep = np.ones(len(found), dtype=bool)
    ahead = 1
    while ahead < len(order):
        one, other = order[:-ahead], order[ahead:]
        is_same = (found.link[one] == found.link[other]) & (wall[one] == wall[other])
        if not is_same.any():
            break
        reach = np.where(is_beyond[one] & is_beyond[other], ONE_RIM_M, ONE_POINT_M)
        is_near = is_same & (norm(point[one] - point[other]) < reach)
        keep[other[is_near]] = False
        ahead += 1
    return np.flatnonzero(keep)


def curved_points(search: Search, link: wp.array, facet: wp.array, curved: CurvedTable) -> tuple[wp.array, ...]:
    """Return where paths touch curved surfaces, with normals, shape [C, 1] each, and the points of reflection, [C].

    Args:
        search: The links.
        link: Link of each path, in the order of the transmitters, shape [C].
        facet: Facet of each, shape [C].
        curved: The curved surfaces.
    """
    device, count = search.scene.device, len(facet)
    out = [wp.empty(shape, dtype=wp.vec3d, device=device) for shape in ((count, 1), (count, 1), count)]
    inputs = [search.forward.ends, search.table.device, curved.device, search.pose, link, facet]
    wp.launch(curved_points_kernel, dim=count, inputs=[*inputs, search.outlines.longest_m], outputs=out, device=device)
    return tuple(out)


def curved_shares(
    search: Search, link: np.ndarray, facet: np.ndarray, vertex: np.ndarray, curved: CurvedTable, *, is_facet: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return the share of a flat mirror's field that reflections at curved surfaces have, shape [Q, C], complex128, and
    the curvature there, xx, xy, xz, yy, yz, zz in the world frame [1/m], shape [Q, 6].

    Args:
        search: Links, carriers and outlines.
        link: Link of each reflection, a row of `search.links`, shape [Q].
        facet: Facet that reflects, or else the first one of its surface, shape [Q].
        vertex: Where the path touches the surface [m], shape [Q, 3].
        curved: The curved surfaces.
        is_facet: Whether `facet` is the one that reflects.
    """
    device, count = search.scene.device, len(search.config.carriers_hz)
    out = wp.empty((len(link), count), dtype=wp.vec2d, device=device)
    bent = wp.full(len(link), wp.mat33d(*[np.nan] * 9), dtype=wp.mat33d, device=device)
    fixed, own, ends = _share_inputs(search, link, facet, vertex, curved)
    inputs = [*fixed, is_facet, *own, *ends]
    wp.launch(curved_share_kernel, dim=out.shape, inputs=inputs, outputs=[out, bent], device=device)
    values = out.numpy()
    return values[..., 0] + 1j * values[..., 1], bent.numpy()[:, [0, 0, 0, 1, 1, 2], [0, 1, 2, 1, 2, 2]]


def curved_piece_shares(
    search: Search,
    link: np.ndarray,
    facet: np.ndarray,
    vertex: np.ndarray,
    piece: np.ndarray,
    is_own: np.ndarray,
    curved: CurvedTable,
) -> np.ndarray:
    """Return the part of a piece of one material in the share of each reflection, shape [Q, C], complex128.

    Args:
        search: Links, carriers and outlines.
        link: As in `curved_shares`, like the next two.
        facet: First facet of the surface that reflects, shape [Q].
        vertex: Shape [Q, 3], [m].
        piece: Piece of the surface, shape [Q].
        is_own: Whether the path touches the surface in it, shape [Q].
        curved: The curved surfaces.
    """
    device = search.scene.device
    out = wp.empty((len(link), len(search.config.carriers_hz)), dtype=wp.vec2d, device=device)
    fixed, own, ends = _share_inputs(search, link, facet, vertex, curved)
    own.append(wp.array(curved.first_piece + piece, dtype=wp.int32, device=device))
    own.append(wp.array(is_own, dtype=wp.bool, device=device))
    wp.launch(curved_piece_kernel, dim=out.shape, inputs=[*fixed, *own, *ends], outputs=[out], device=device)
    values = out.numpy()
    return values[..., 0] + 1j * values[..., 1]


def _share_inputs(
    search: Search, link: np.ndarray, facet: np.ndarray, vertex: np.ndarray, curved: CurvedTable
) -> tuple[list[Any], list[wp.array], list[wp.array]]:
    """Return the arguments of kernels of shares: those of all reflections, batch index and facet, and the points."""
    device, links = search.scene.device, search.links
    wavelength = SPEED_OF_LIGHT / np.array(search.config.carriers_hz)
    fixed = [search.table.device, curved.device, search.outlines]
    fixed.append(wp.array(search.host_pose, dtype=wp.transformd, device=device))
    fixed.append(wp.array(wavelength, dtype=wp.float64, device=device))
    own = [wp.array(values, dtype=wp.int32, device=device) for values in (links.batch_index[link], facet)]
    points = links.tx.position[link], links.rx.position[link], vertex
    return fixed, own, [wp.array(values, dtype=wp.vec3d, device=device) for values in points]
