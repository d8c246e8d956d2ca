"""Describe traced paths for the field: lengths, directions, and what they meet on their way."""

import numpy as np

from mmw.channel.path_solver.search import Search
from mmw.channel.path_solver.surface_table import SurfaceTable
from mmw.channel.path_solver.traced_paths import TracedPaths
from mmw.core.kinematics import Motion, differentiate_rows
from mmw.core.transforms import rotate
from mmw.physics.em.diffraction import WedgeHits
from mmw.physics.em.field import PathGeometry, path_geometry
from mmw.physics.em.interaction import DIFFRACTION, DIFFUSE
from mmw.physics.em.path_gain import Interactions
from mmw.physics.em.scattering import ScatteringPoints
from mmw.physics.em.vectors import dot, norm


def found_geometry(search: Search, found: TracedPaths) -> tuple[PathGeometry, Interactions]:
    """Return the geometry of found paths, and their interactions."""
    links, table = search.links, search.table
    tx, rx = links.tx.position[found.link], links.rx.position[found.link]
    wedges, rough, edge = _NO_WEDGES, _NO_ROUGH, found.normal
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
    return path_geometry(tx, rx, found.kind, found.vertex, found.normal, edge), Interactions(
        material_id=gather(table.material_id, first_faces(found, table), found.kind != 0),
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


def range_rates(search: Search, found: TracedPaths, geometry: PathGeometry, motion: Motion | None = None) -> np.ndarray:
    """Return d(length)/dt of each path [m/s] from the velocities of both ends and of every vertex, shape [P].

    `motion` has the derivatives of all poses of the scene, if they are known.

    Source: first-order Doppler, Sionna RT 2.2 technical report; the bodies are rigid, so the velocity of a point is
    v + w x r.
    """
    scene, links, table = search.scene, search.links, search.table
    rate = -dot(links.tx.velocity[found.link], geometry.departure)
    rate -= dot(links.rx.velocity[found.link], geometry.arrival)
    if not len(table) or not len(scene.instance_actor):
        return rate
    owner = gather(table.owner, first_faces(found, table), found.kind != 0)
    path, step = (owner >= 0).nonzero()
    if len(path):
        rows = np.array([scene.arrays.frame_row(frame) for frame in scene.batch_frames], dtype=np.int64)
        motion = differentiate_rows(scene.arrays.poses, rows, scene.arrays.pose_dt, motion)
        batch_index = links.batch_index[found.link[path]]
        actor = scene.instance_actor[owner[path, step]]
        arm = found.vertex[path, step] - scene.arrays.poses[rows[batch_index], actor, :3]
        moving = motion.velocity[batch_index, actor] + np.cross(motion.world_rate[batch_index, actor], arm)
        turned = geometry.direction[path, step] - geometry.direction[path, step + 1]
        np.add.at(rate, path, dot(moving, turned))
    return rate


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
