"""Compute the share of the field of endless mirrors and edges that those of traced paths have, at every carrier."""

import numpy as np
import warp as wp

from mmw.channel.path_solver.curved_candidates import curved_shares
from mmw.channel.path_solver.curved_surfaces import CurvedTable
from mmw.channel.path_solver.edge_table import WedgeTable
from mmw.channel.path_solver.mixed_walls import WEAKEST_PIECE, MixedWalls, mix_walls
from mmw.channel.path_solver.outlines import OutlineTable
from mmw.channel.path_solver.search import Search
from mmw.channel.path_solver.surface_table import SurfaceTable
from mmw.channel.path_solver.traced_paths import TracedPaths
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.kernels.channel.finite_surfaces import share_kernel
from mmw.physics.em.diffraction import WedgeHits
from mmw.physics.em.field import PathGeometry
from mmw.physics.em.finite_surfaces import WEAKEST_CURVED_SHARE, WEAKEST_SHARE, finite_edge_share
from mmw.physics.em.interaction import SPECULAR
from mmw.physics.em.vectors import dot, norm


def finite_shares(
    search: Search,
    found: TracedPaths,
    geometry: PathGeometry,
    wedges: WedgeHits,
    outlines: OutlineTable,
    carriers_hz: tuple[float, ...],
) -> tuple[np.ndarray, MixedWalls, np.ndarray]:
    """Return the product of the shares of all reflections and diffractions of each path, shape [P, C], complex128, the
    parts of panes of different materials in them, and the curvature of the surface that reflects, see `PathSet`, NaN
    for flat ones, shape [P, 6].

    Args:
        search: Scene, links and surfaces of the paths.
        found: The paths.
        geometry: Their geometry.
        wedges: Their diffractions.
        outlines: Outlines of the planes.
        carriers_hz: Carrier frequencies [Hz], shape [C].
    """
    share = _edge_shares(search.table.wedges, found, geometry, wedges, carriers_hz)
    curvature = np.full((len(found), 6), np.nan)
    is_specular = found.kind == SPECULAR
    curved = search.table.curved
    if curved is not None:
        is_curved = is_specular & curved.is_curved[np.where(is_specular, found.surface, 0)]
        rows = np.flatnonzero(is_curved.any(axis=1))
        if len(rows):
            own, curvature[rows] = _curved_shares(search, found, rows, curved, carriers_hz)
            share[rows] *= own
        is_specular &= ~is_curved
    path, step = np.nonzero(is_specular)
    table, device = search.table, search.scene.device
    vertex, normal = found.vertex[path, step], found.normal[path, step]
    ends = np.concatenate([search.links.tx.position[found.link][:, None], found.vertex], axis=1)
    before_at = ends[path, step]
    is_last = step + 1 == found.order[path]
    next_at = np.where(
        is_last[:, None],
        search.links.rx.position[found.link[path]],
        found.vertex[path, np.minimum(step + 1, found.vertex.shape[1] - 1)],
    )
    heights = dot(before_at - vertex, normal), dot(next_at - vertex, normal)
    feet = before_at - heights[0][:, None] * normal, next_at - heights[1][:, None] * normal
    point = (heights[1][:, None] * feet[0] + heights[0][:, None] * feet[1]) / (heights[0] + heights[1])[:, None]
    incoming = point - before_at
    incoming /= np.linalg.norm(incoming, axis=1)[:, None]
    before, behind = geometry.lengths_around(path, step)
    plane = table.plane[found.surface[path, step]]
    owner = table.owner[table.lead[plane]]
    carrier = np.where(owner < 0, search.host_pose.shape[1], owner)
    given = [
        (search.links.batch_index[found.link[path]], wp.int32),
        (outlines.of_plane[plane], wp.int32),
        (carrier, wp.int32),
        (point, wp.vec3d),
        (vertex, wp.vec3d),
        (incoming, wp.vec3d),
        (before, wp.float64),
        (behind, wp.float64),
        (np.ones(len(path), dtype=bool), wp.bool),
    ]
    whole = [
        wp.array(search.host_pose, dtype=wp.transformd, device=device),
        wp.array(SPEED_OF_LIGHT / np.array(carriers_hz), dtype=wp.float64, device=device),
    ]

    def shares(columns: list) -> np.ndarray:
        out = wp.empty((len(columns[0][0]), len(carriers_hz)), dtype=wp.vec2d, device=device)
        inputs = [search.outlines, *whole, *(wp.array(v, dtype=dtype, device=device) for v, dtype in columns)]
        wp.launch(share_kernel, dim=out.shape, inputs=inputs, outputs=[out], device=device)
        return out.numpy()[..., 0] + 1j * out.numpy()[..., 1]

    values = shares(given)
    own = outlines.piece_of[found.surface[path, step]]
    several = np.flatnonzero(own >= 0)
    piece, count = outlines.pieces(outlines.of_plane[plane[several]])
    hit = np.repeat(several, count)
    columns = [(column[hit], dtype) for column, dtype in given]
    columns[1], columns[-1] = (piece, wp.int32), (piece == own[hit], wp.bool)
    parts = shares(columns)
    is_part = (np.abs(parts).max(axis=1) >= WEAKEST_PIECE) & (piece != own[hit])
    is_mixed = np.bincount(hit, is_part, len(path)) > 0
    rest = share.copy()
    np.multiply.at(share, path, values)
    np.multiply.at(rest, path[~is_mixed], values[~is_mixed])
    first = np.concatenate([[0], np.cumsum(count[is_mixed[several]])])
    kept, material = is_mixed[hit], outlines.piece_material[piece[is_mixed[hit]]]
    walls = mix_walls(path[is_mixed], step[is_mixed], first, material, parts[kept], rest, found.kind.shape[1])
    return share, walls, curvature


def _edge_shares(
    table: WedgeTable, found: TracedPaths, geometry: PathGeometry, wedges: WedgeHits, carriers_hz: tuple[float, ...]
) -> np.ndarray:
    """Return the product of the shares of the diffractions of each path, along the lines of their edges, [P, C]."""
    share = np.ones((len(found), len(carriers_hz)), dtype=np.complex128)
    if not len(wedges.path):
        return share
    own = found.surface[wedges.path, wedges.step]
    before, behind = geometry.lengths_around(wedges.path, wedges.step)
    along = dot(geometry.direction[wedges.path, wedges.step], wedges.edge)
    scale = np.sqrt(np.maximum(1.0 - along**2, 0.0) * (before + behind) / (before * behind))
    length = norm(table.end[own] - table.begin[own])
    at = np.clip(wedges.at, 0.0, length)
    ahead = table.ahead[own]
    values = finite_edge_share(at + ahead[:, 0], length - at + ahead[:, 1], scale, carriers_hz)
    np.multiply.at(share, wedges.path, values)
    return share


def weakest_shares(found: TracedPaths, table: SurfaceTable) -> np.ndarray:
    """Return the share below which each path is left out, shape [P]."""
    out = np.full(len(found), WEAKEST_SHARE)
    if table.curved is not None:
        is_specular = found.kind == SPECULAR
        out[(is_specular & table.curved.is_curved[np.where(is_specular, found.surface, 0)]).any(axis=1)] = (
            WEAKEST_CURVED_SHARE
        )
    return out


def _curved_shares(
    search: Search, found: TracedPaths, path: np.ndarray, curved: CurvedTable, carriers_hz: tuple[float, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Return the shares of paths whose only interaction is at a curved surface, [n, C], and its curvature, [n, 6]."""
    step = np.argmax(found.kind[path] == SPECULAR, axis=1)
    facet = curved.first_facet[found.surface[path, step]]
    return curved_shares(search, found.link[path], facet, found.vertex[path, step], curved, is_facet=False)
