"""Compute the share of the field of endless mirrors and edges that those of traced paths have, at every carrier."""

import numpy as np
import warp as wp

from mmw.channel.path_solver.curved_candidates import curved_piece_shares, curved_shares
from mmw.channel.path_solver.curved_surfaces import CurvedTable
from mmw.channel.path_solver.edge_table import WedgeTable
from mmw.channel.path_solver.mixed_walls import WEAKEST_PIECE, MixedWalls, join_walls, mix_walls
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

MAX_PIECE_SCALE = 2.0
"""Most that close points of reflection strengthen the parts of pieces of a curved surface [-]; near a null of the whole
the ratio of both has no meaning. Design value."""


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
    curved, mixed = search.table.curved, None
    if curved is not None:
        is_curved = is_specular & curved.is_curved[np.where(is_specular, found.surface, 0)]
        rows = np.flatnonzero(is_curved.any(axis=1))
        if len(rows):
            own, curvature[rows], mixed = _curved_reflections(search, found, rows, curved)
            share[rows] *= own
        is_specular &= ~is_curved
    share, walls = _flat_reflections(search, found, geometry, is_specular, outlines, carriers_hz, share)
    return share, walls if mixed is None else join_walls(walls, mixed), curvature


def _flat_reflections(
    search: Search,
    found: TracedPaths,
    geometry: PathGeometry,
    is_flat: np.ndarray,
    outlines: OutlineTable,
    carriers_hz: tuple[float, ...],
    share: np.ndarray,
) -> tuple[np.ndarray, MixedWalls]:
    """Return the shares of paths with those of their reflections at flat surfaces, and those of several materials.

    Args:
        search: Scene, links and surfaces of the paths.
        found: The paths.
        geometry: Their geometry.
        is_flat: Which interactions are reflections at flat surfaces, shape [P, D].
        outlines: Outlines of the planes.
        carriers_hz: Carrier frequencies [Hz], shape [C].
        share: Product of the shares of all other interactions, shape [P, C].
    """
    path, step = np.nonzero(is_flat)
    plane = search.table.plane[found.surface[path, step]]
    device = search.scene.device
    given = _mirror_columns(search, found, geometry, path, step, outlines)
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
    total, rest = share.copy(), share.copy()
    np.multiply.at(total, path, values)
    np.multiply.at(rest, path[~is_mixed], values[~is_mixed])
    first = np.concatenate([[0], np.cumsum(count[is_mixed[several]])])
    kept, material = is_mixed[hit], outlines.piece_material[piece[is_mixed[hit]]]
    walls = mix_walls(path[is_mixed], step[is_mixed], first, material, parts[kept], rest, found.kind.shape[1])
    return total, walls


def _mirror_columns(
    search: Search,
    found: TracedPaths,
    geometry: PathGeometry,
    path: np.ndarray,
    step: np.ndarray,
    outlines: OutlineTable,
) -> list:
    """Return the arguments of `share_kernel` of reflections at flat surfaces, each with its type."""
    table = search.table
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
    return [
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


def _curved_reflections(
    search: Search, found: TracedPaths, path: np.ndarray, curved: CurvedTable
) -> tuple[np.ndarray, np.ndarray, MixedWalls]:
    """Return the shares of paths whose only interaction is at a curved surface, shape [n, C], its curvature, [n, 6],
    and those at several materials."""
    surface = found.surface[path, 0]
    given = found.link[path], curved.first_facet[surface], found.vertex[path, 0]
    share, curvature = curved_shares(search, *given, curved, is_facet=False)
    own = curved.piece[surface]
    several = np.flatnonzero(own >= 0)
    low, high = (np.searchsorted(curved.piece_group, curved.piece_group[own[several]], s) for s in ("left", "right"))
    count = high - low
    hit, begin = np.repeat(several, count), np.cumsum(count) - count
    piece = np.repeat(low - begin, count) + np.arange(len(hit))
    part = curved_piece_shares(search, *(column[hit] for column in given), piece, piece == own[hit], curved)
    whole = np.zeros(share.shape, dtype=np.complex128)
    np.add.at(whole, hit, part)
    scale = np.divide(share, whole, out=np.zeros_like(share), where=whole != 0.0)
    part = part * (scale * np.minimum(1.0, MAX_PIECE_SCALE / np.maximum(np.abs(scale), 1e-300)))[hit]
    is_part = np.abs(part).max(axis=1, initial=0.0) >= WEAKEST_PIECE
    is_mixed = np.bincount(hit, is_part & (piece != own[hit]), len(path)) > 0
    kept = np.flatnonzero(is_mixed[hit] & is_part)
    material = np.full((len(kept), found.kind.shape[1]), -1)
    material[:, 0] = curved.piece_material[piece[kept]]
    return share, curvature, MixedWalls(path[hit[kept]], material, part[kept])
