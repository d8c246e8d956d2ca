"""Compute the share of a mirror's field that the finite surfaces of traced paths reflect, at every carrier."""

import numpy as np
import warp as wp

from mmw.channel.path_solver.outlines import OutlineTable
from mmw.channel.path_solver.search import Search
from mmw.channel.path_solver.traced_paths import TracedPaths
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.kernels.channel.finite_surfaces import share_kernel
from mmw.physics.em.field import PathGeometry
from mmw.physics.em.interaction import SPECULAR
from mmw.physics.em.vectors import dot


def reflected_shares(
    search: Search, found: TracedPaths, geometry: PathGeometry, outlines: OutlineTable, carriers_hz: tuple[float, ...]
) -> np.ndarray:
    """Return the product of the shares of all reflections of each path, shape [P, C], complex128.

    Args:
        search: Scene, links and surfaces of the paths.
        found: The paths.
        geometry: Their geometry.
        outlines: Outlines of the planes.
        carriers_hz: Carrier frequencies [Hz], shape [C].
    """
    share = np.ones((len(found), len(carriers_hz)), dtype=np.complex128)
    path, step = np.nonzero(found.kind == SPECULAR)
    if not len(path):
        return share
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
    out = wp.empty((len(path), len(carriers_hz)), dtype=wp.vec2d, device=device)
    given = [
        (search.host_pose, wp.transformd),
        (SPEED_OF_LIGHT / np.array(carriers_hz), wp.float64),
        (search.links.batch_index[found.link[path]], wp.int32),
        (outlines.of_plane[plane], wp.int32),
        (carrier, wp.int32),
        (point, wp.vec3d),
        (vertex, wp.vec3d),
        (incoming, wp.vec3d),
        (before, wp.float64),
        (behind, wp.float64),
    ]
    inputs = [search.outlines, *(wp.array(values, dtype=dtype, device=device) for values, dtype in given)]
    wp.launch(share_kernel, dim=out.shape, inputs=inputs, outputs=[out], device=device)
    values = out.numpy()
    np.multiply.at(share, path, values[..., 0] + 1j * values[..., 1])
    return share
