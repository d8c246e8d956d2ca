"""Sort traced paths, and leave out those that stand for another one."""

import numpy as np
import warp as wp

from mmw.channel.links import Links
from mmw.channel.path_solver.search import vector
from mmw.channel.path_solver.traced_paths import TracedPaths
from mmw.core.packed_arrays import Layout, borrow_arrays, padded_count
from mmw.core.repeated_launch import launch_again
from mmw.kernels.channel.path_order import PathEnds, PathOrder, UnsortedPaths, order_paths_kernel
from mmw.kernels.channel.surfaces import LIFT


def rows_to_keep(found: TracedPaths, links: Links, area: wp.array, origin: np.ndarray) -> np.ndarray:
    """Return the rows of paths to keep, sorted by (link, order, kinds, surfaces), see `order_paths_kernel`.

    Args:
        found: The paths.
        links: Their links.
        area: Areas of all surfaces [m^2], on the host.
        origin: World position of the scene frame's origin [m], shape [3].
    """
    count = len(found)
    block = borrow_arrays("cpu", *_layouts(padded_count(count), found.kind.shape[1]))
    ends = borrow_arrays("cpu", *(2 * [((len(links),), wp.vec3d)]))
    given = found.link, found.order, found.kind, found.surface, found.vertex, found.normal, found.ray
    for target, values in zip(block.host, given, strict=False):
        target[:count] = values
    ends.host[0][...], ends.host[1][...] = links.tx.position, links.rx.position
    arguments = [
        block.struct(UnsortedPaths, *UnsortedPaths.vars, *len(PathOrder.vars) * (None,)),
        count,
        ends.struct(PathEnds, *PathEnds.vars),
        area,
        vector(*origin.tolist()),
        LIFT.value,
        block.struct(PathOrder, *len(UnsortedPaths.vars) * (None,), *PathOrder.vars),
    ]
    launch_again(order_paths_kernel, (1,), arguments, "cpu")
    *_, row, kept = block.host
    rows = row[: int(kept[0])].copy()
    block.release()
    ends.release()
    return rows


def _layouts(count: int, depth: int) -> list[Layout]:
    """Return the arrays of `UnsortedPaths` and `PathOrder`."""
    ints, numbers = ((count,), wp.int32), ((count,), wp.float64)
    steps, vectors = ((count, depth), wp.int32), ((count, depth), wp.vec3d)
    keys = ((count, 3 + 2 * depth), wp.float64), ((count, 3), wp.float64)
    given = ints, ints, steps, steps, vectors, vectors, ints
    return [*given, *keys, numbers, ints, ((count,), wp.uint8), ints, ints, ints, ((1,), wp.int32)]
