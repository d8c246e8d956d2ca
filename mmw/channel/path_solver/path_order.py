"""Sort traced paths, and leave out those that stand for another one."""

import numpy as np
import warp as wp

from mmw.channel.links import Links
from mmw.channel.path_solver.search import vector
from mmw.channel.path_solver.traced_paths import TracedPaths
from mmw.core.host_kernels import run_on_host
from mmw.kernels.channel.path_order import order_paths_kernel
from mmw.kernels.channel.surfaces import LIFT


def rows_to_keep(found: TracedPaths, links: Links, area: wp.array, origin: np.ndarray) -> np.ndarray:
    """Return the rows of paths to keep, sorted by (link, order, kinds, surfaces), see `order_paths_kernel`.

    Args:
        found: The paths.
        links: Their links.
        area: Areas of all surfaces [m^2], on the host.
        origin: World position of the scene frame's origin [m], shape [3].
    """
    (count, depth), ends = found.kind.shape, (links.tx.position, links.rx.position)
    inputs = found.link, found.order, found.kind, found.surface, found.vertex, found.normal, found.ray, *ends
    others = count, area, vector(*origin.tolist()), LIFT.value
    each, keys = (count,), ((count, 3 + 2 * depth), (count, 3))
    *_, row, kept = run_on_host(
        order_paths_kernel, (1,), inputs, others, (*keys, each, each, each, each, each, each, (1,))
    )
    return row[: int(kept[0])]
