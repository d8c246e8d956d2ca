"""Name paths so that a path keeps its name from frame to frame, while its points move on over what carries them."""

import numpy as np

from mmw.channel.links import Links
from mmw.channel.path_solver.surface_table import SurfaceTable
from mmw.channel.path_solver.traced_paths import TracedPaths
from mmw.channel.paths import path_ids, tell_apart
from mmw.physics.em.diffraction import WedgeHits
from mmw.physics.em.interaction import DIFFRACTION, DIFFUSE, SPECULAR, TRANSMISSION


def path_names(
    links: Links,
    found: TracedPaths,
    wedges: WedgeHits,
    table: SurfaceTable,
    rank_by: np.ndarray,
) -> np.ndarray:
    """Return the identifier of each path, shape [P], int64.

    A reflection is named by its wall: all coplanar surfaces, or a curved one. A passage is named by its object, of
    which it may cross one pane after the other: it bends nothing, so that the rest tells the path. A diffraction is
    named by the line that its edge belongs to, with the lines beside it, as the edges of a post; a diffuse one by its
    ray. Paths of a link with one name are numbered by their strength, as several points of
    reflection on one vehicle: not by their places, as points move on over a whole vehicle while they reflect.

    Args:
        links: The traced links.
        found: The paths.
        wedges: Their diffractions.
        table: Surfaces of the scene.
        rank_by: Value by which paths of one name are numbered, lowest first, shape [P].
    """
    named = found.surface
    for kind, names in ((SPECULAR, table.wall), (TRANSMISSION, table.object_id)):
        if found.kinds & kind:
            is_own = found.kind == kind
            named = np.where(is_own, names[np.where(is_own, found.surface, 0)], named)
    if found.kinds & (DIFFUSE | DIFFRACTION):
        rough, step = np.nonzero(found.kind == DIFFUSE)
        named = named.copy()
        named[rough, step] = found.ray[rough]
    if len(wedges.path):
        named[wedges.path, wedges.step] = table.wedges.line[found.surface[wedges.path, wedges.step]]
    ids = path_ids(links.tx_number[found.link], links.rx_number[found.link], found.kind, named)
    return tell_apart(ids, found.link, rank_by)
