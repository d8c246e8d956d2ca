"""Sort traced paths, and leave out those that stand for another one."""

import numpy as np
import warp as wp

from mmw.channel.links import Links
from mmw.channel.path_solver.search import vector
from mmw.channel.path_solver.traced_paths import TracedPaths
from mmw.core.host_kernels import run_on_host
from mmw.kernels.channel.path_order import order_paths_kernel
from mmw.kernels.channel.surfaces import LIFT


def paths_to_keep(
    found: TracedPaths, number: np.ndarray, links: Links, area: wp.array, origin: np.ndarray
) -> TracedPaths:
    """Return the paths to keep, sorted by (link, order, kinds, surfaces), see `order_paths_kernel`.

    Args:
        found: The paths.
        number: Link that each number in `found.link` stands for, shape [L].
        links: The links.
        area: Areas of all surfaces [m^2], on the host.
        origin: World position of the scene frame's origin [m], shape [3].
    """
    (count, depth), ends = found.kind.shape, (number, links.tx.position, links.rx.position)
    others = count, area, vector(*origin.tolist()), LIFT.value
    each, steps = (count,), (count, depth)
    scratch = (count, 3 + 2 * depth), (count, 3), each, each, each, each, each, each
    outputs = *scratch, (1,), each, each, steps, steps, steps, steps, each, each
    inputs = *found.columns, *ends
    kept, *rows = run_on_host(order_paths_kernel, (1,), inputs, others, outputs, len(scratch))
    return TracedPaths(*[values[: int(kept[0])] for values in rows])
