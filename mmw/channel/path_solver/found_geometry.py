"""Describe traced paths for the field: lengths, directions, names, and what they meet on their way."""

import numpy as np

from mmw.channel.path_solver.path_names import PathNames, path_names
from mmw.channel.path_solver.search import Search
from mmw.channel.path_solver.traced_paths import TracedPaths
from mmw.core.kinematics import Motion, motion_at
from mmw.core.transforms import rotate
from mmw.physics.em.diffraction import WedgeHits
from mmw.physics.em.field import MovingBodies, PathGeometry, path_geometry
from mmw.physics.em.interaction import DIFFRACTION, DIFFUSE
from mmw.physics.em.path_gain import Interactions
from mmw.physics.em.scattering import ScatteringPoints
from mmw.physics.em.vectors import dot, norm


def found_geometry(
    search: Search, found: TracedPaths, motion: Motion | None = None
) -> tuple[PathGeometry, Interactions, PathNames]:
    """Return the geometry of found paths, their interactions, and their names.

    Args:
        search: Input of the search.
        found: The paths.
        motion: Derivatives of all poses of the scene, if they are known.
    """
    links, table, kinds = search.links, search.table, found.kinds
    wedges, rough, edge = _NO_WEDGES, _NO_ROUGH, None
    wedge_material = sides = _NO_SIDES
    if kinds & DIFFRACTION:
        wedges = _wedge_hits(search, found)
        edge = np.zeros_like(found.vertex)
        edge[wedges.path, wedges.step] = wedges.edge
        wedge = found.surface[wedges.path, wedges.step]
        sides = np.stack([table.wedges.surface_0[wedge], table.wedges.surface_n[wedge]], axis=1)
        wedge_material = table.material_id[sides]
    if kinds & DIFFUSE:
        path, step = np.nonzero(found.kind == DIFFUSE)
        rough = ScatteringPoints(path, step, found.normal[path, step], found.solid_angle[path], found.ray[path] < -1)
    width = None
    if table.outlines is not None:
        width = table.outlines.width[table.outlines.of_plane[table.plane[sides]]]
        if table.curved is not None:
            width[table.curved.is_curved[sides]] = np.inf  # a facet is no mirror of its own
    names = path_names(links, found.link, found.kind, found.surface, found.ray, table, search.scene)
    place, velocity = (links.tx.position, links.rx.position), (links.tx.velocity, links.rx.velocity)
    points = found.kind, found.vertex, found.normal, edge
    geometry = path_geometry(found.link, place, velocity, *points, _moving_bodies(search, names.body, motion))
    return geometry, Interactions(names.material_id, wedges, wedge_material, width, rough), names


_NO_WEDGES = WedgeHits(*np.zeros((2, 0), dtype=np.int64), *np.zeros((4, 0, 3)), np.zeros(0), np.zeros(0, dtype=bool))
_NO_SIDES = np.zeros((0, 2), dtype=np.int32)
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


def _moving_bodies(search: Search, body: np.ndarray, motion: Motion | None) -> MovingBodies | None:
    """Return the bodies that carry interactions, `body` of `PathNames`; None if none does."""
    if body.max(initial=-1) < 0:
        return None
    arrays = search.scene.arrays
    motion, at, _ = motion_at(arrays.poses, search.rows, arrays.pose_dt, motion)
    moving = arrays.poses.take(search.rows, axis=0).reshape(-1, 7)
    rates = (values.take(at, axis=0).reshape(-1, 3) for values in (motion.velocity, motion.world_rate))
    return MovingBodies(body, moving, *rates)
