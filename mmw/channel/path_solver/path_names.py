"""Name paths so that a path keeps its name from frame to frame, while its points move on over what carries them."""

import numpy as np

from mmw.channel.links import Links
from mmw.channel.path_solver.search import Search
from mmw.channel.path_solver.surface_table import SurfaceTable
from mmw.channel.path_solver.traced_paths import TracedPaths
from mmw.channel.paths import path_ids, tell_apart, with_sections
from mmw.core.transforms import invert, transform_points
from mmw.physics.em.diffraction import WedgeHits
from mmw.physics.em.field import PathGeometry
from mmw.physics.em.interaction import DIFFUSE, SPECULAR, TRANSMISSION
from mmw.physics.em.vectors import dot

SECTION_M = 1.5
"""Length of the sections of a moving body that name points of reflection [m]: a car has front, middle and rear. Design
value: with 1 m hardly fewer names go from one point to another, and nearly twice as many change as points move on."""


def body_sections(search: Search, found: TracedPaths) -> np.ndarray:
    """Return the section of a moving body, along its x axis, that each path reflects at, shape [P], int64.

    Bodies such as cars reflect at several points at once, a bumper and a fender, and these stay where they are while
    the vehicle moves. 0 is the middle, and stands for all paths but single reflections at curved surfaces, too.

    Args:
        search: Links, surfaces and poses.
        found: The paths.
    """
    out, table = np.zeros(len(found), dtype=np.int64), search.table
    if table.curved is None or not len(found):
        return out
    is_specular = found.kind[:, 0] == SPECULAR
    surface = np.where(is_specular, found.surface[:, 0], 0)
    rows = np.flatnonzero(is_specular & table.curved.is_curved[surface] & (table.owner[surface] >= 0))
    pose = search.host_pose[search.links.batch_index[found.link[rows]], table.owner[surface[rows]]]
    local = transform_points(invert(pose), found.vertex[rows, 0])
    out[rows] = np.floor(local[:, 0] / SECTION_M + 0.5)
    return out


def path_names(
    links: Links,
    found: TracedPaths,
    geometry: PathGeometry,
    wedges: WedgeHits,
    table: SurfaceTable,
    section: np.ndarray,
    rank_by: np.ndarray,
) -> np.ndarray:
    """Return the identifier of each path, shape [P], int64.

    A reflection is named by its wall: all coplanar surfaces, or a section of a curved one. A passage is named by its
    object, of which it may cross one pane after the other: it bends nothing, so that the rest tells the path. A
    diffraction is named by the line that its edge belongs to, along a round post by the post and the side that the path
    passes; a diffuse one by its ray. Paths of a link with one name are numbered, as several points of reflection on one
    vehicle.

    Args:
        links: The traced links.
        found: The paths.
        geometry: Their geometry.
        wedges: Their diffractions.
        table: Surfaces of the scene.
        section: `body_sections` of the paths.
        rank_by: Value by which paths of one name are numbered, lowest first, shape [P].
    """
    named = found.surface
    for kind, names in ((SPECULAR, table.wall), (TRANSMISSION, table.object_id)):
        is_own = found.kind == kind
        if is_own.any():
            named = np.where(is_own, names[np.where(is_own, found.surface, 0)], named)
    rough, step = np.nonzero(found.kind == DIFFUSE)
    if len(rough) or len(wedges.path):
        named = named.copy()
        named[rough, step] = found.ray[rough]
    if len(wedges.path):
        own = found.surface[wedges.path, wedges.step]
        post = table.wedges.post[own]
        forward = geometry.direction[wedges.path, wedges.step] + geometry.direction[wedges.path, wedges.step + 1]
        side = dot(np.cross(forward, _upward(wedges.edge)), wedges.away) > 0.0
        named[wedges.path, wedges.step] = np.where(post < 0, table.wedges.line[own], -2 - 2 * post - side)
    ids = path_ids(links.tx_number[found.link], links.rx_number[found.link], found.kind, named)
    return tell_apart(with_sections(ids, section), found.link, rank_by)


def _upward(direction: np.ndarray) -> np.ndarray:
    """Return directions, or their opposites, whose largest component is positive, shape [N, 3]."""
    largest = np.take_along_axis(direction, np.abs(direction).argmax(axis=1)[:, None], axis=1)
    return np.where(largest < 0.0, -direction, direction)
