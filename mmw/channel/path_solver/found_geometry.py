"""Describe traced paths for the field: lengths, directions, and what they meet on their way."""

import numpy as np

from mmw.channel.path_solver.search import Search
from mmw.channel.path_solver.surface_table import SurfaceTable
from mmw.channel.path_solver.traced_paths import TracedPaths
from mmw.core.kinematics import Motion, differentiate_rows
from mmw.core.transforms import rotate
from mmw.physics.em.diffraction import WedgeHits
from mmw.physics.em.field import MovingBodies, PathGeometry, path_geometry
from mmw.physics.em.interaction import DIFFRACTION, DIFFUSE
from mmw.physics.em.path_gain import Interactions
from mmw.physics.em.scattering import ScatteringPoints
from mmw.physics.em.vectors import dot, norm


def found_geometry(
    search: Search, found: TracedPaths, motion: Motion | None = None
) -> tuple[PathGeometry, Interactions]:
    """Return the geometry of found paths, and their interactions.

    Args:
        search: Input of the search.
        found: The paths.
        motion: Derivatives of all poses of the scene, if they are known.
    """
    links, table = search.links, search.table
    wedges, rough, edge = _NO_WEDGES, _NO_ROUGH, None
    sides = np.zeros((0, 2), dtype=np.int32)
    if found.kinds & DIFFRACTION:
        wedges = _wedge_hits(search, found)
        edge = np.zeros_like(found.vertex)
        edge[wedges.path, wedges.step] = wedges.edge
        wedge = found.surface[wedges.path, wedges.step]
        sides = np.stack([table.wedges.surface_0[wedge], table.wedges.surface_n[wedge]], axis=1)
    if found.kinds & DIFFUSE:
        path, step = np.nonzero(found.kind == DIFFUSE)
        rough = ScatteringPoints(path, step, found.normal[path, step], found.solid_angle[path], found.ray[path] < -1)
    width = None
    if table.outlines is not None:
        width = table.outlines.width[table.outlines.of_plane[table.plane[sides]]]
        if table.curved is not None:
            width[table.curved.is_curved[sides]] = np.inf  # a facet is no mirror of its own
    face, place, velocity = first_faces(found, table), np.empty((len(links), 2, 3)), np.empty((len(links), 2, 3))
    for column, end in enumerate((links.tx, links.rx)):
        place[:, column], velocity[:, column] = end.position, end.velocity
    bodies = _moving_bodies(search, found, face, motion)
    points = found.kind, found.vertex, found.normal, edge
    return path_geometry(found.link, place, velocity, *points, bodies), Interactions(
        material_id=gather(table.material_id, face, found.kind != 0),
        wedges=wedges,
        wedge_material=table.material_id[sides],
        wedge_width=width,
        rough=rough,
    )


_NO_WEDGES = WedgeHits(*np.zeros((2, 0), dtype=np.int64), *np.zeros((4, 0, 3)), np.zeros(0), np.zeros(0, dtype=bool))
_NO_ROUGH = ScatteringPoints(*np.zeros((2, 0), dtype=np.int64), np.zeros((0, 3)), np.zeros(0), np.zeros(0, dtype=bool))


def _wedge_hits(search: Search, found: TracedPaths) -> WedgeHits:
    path, step = np.nonzero(found.kind == DIFFRACTION)
    wedge, wedges = found.surface[path, step], search.table.wedges
    begin = wedges.begin[wedge]
    vectors = [wedges.end[wedge] - begin, *(v[wedge] for v in (wedges.normal_0, wedges.normal_n, wedges.away)), begin]
    moved = np.nonzero(wedges.carrier[wedge] < len(search.scene.instance_actor))[0]
    if len(moved):
        batch_index = search.links.batch_index[found.link[path[moved]]]
        pose = search.host_pose[batch_index, wedges.carrier[wedge[moved]]]
        for vector in vectors:
            vector[moved] = rotate(pose[:, 3:], vector[moved])
        vectors[-1][moved] += pose[:, :3]
    edge, *normals, begin = vectors
    edge = edge / norm(edge)[:, None]
    at = dot(found.vertex[path, step] - begin, edge)
    return WedgeHits(path, step, edge, *normals, at, wedges.is_curved[wedge])


def _moving_bodies(search: Search, found: TracedPaths, face: np.ndarray, motion: Motion | None) -> MovingBodies | None:
    """Return the bodies that carry the interactions of paths, on the surfaces `face` [P, D]; None if none moves."""
    scene, table = search.scene, search.table
    if not len(table) or not len(scene.instance_actor):
        return None
    owner = gather(table.owner, face, found.kind != 0)
    if owner.max(initial=-1) < 0:
        return None
    arrays = scene.arrays
    rows = np.array([arrays.frame_row(frame) for frame in scene.batch_frames], dtype=np.int64)
    motion = differentiate_rows(arrays.poses, rows, arrays.pose_dt, motion)
    first = search.links.batch_index[found.link] * arrays.poses.shape[1]
    body = np.where(owner >= 0, first[:, None] + scene.instance_actor[owner], -1)
    parts = arrays.poses[rows, :, :3], motion.velocity, motion.world_rate
    return MovingBodies(body, np.stack(parts, axis=2).reshape(-1, 3, 3))


def first_faces(found: TracedPaths, table: SurfaceTable) -> np.ndarray:
    """Return the surface of each interaction, for a diffraction the first face of its wedge, shape [P, D]."""
    if not found.kinds & DIFFRACTION:
        return found.surface
    is_diffracted = found.kind == DIFFRACTION
    return np.where(is_diffracted, table.wedges.surface_0[np.where(is_diffracted, found.surface, 0)], found.surface)


def gather(values: np.ndarray, row: np.ndarray, is_there: np.ndarray) -> np.ndarray:
    """Return values[row] where there is something, -1 elsewhere, int32."""
    if not len(values):
        return np.full(row.shape, -1, dtype=np.int32)
    return np.where(is_there, values[row * is_there], np.int32(-1))
