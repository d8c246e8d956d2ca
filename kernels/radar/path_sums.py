"""Sum the echoes of a resolution cell by path, and as complex amplitudes: the interference of all that it holds."""

import warp as wp

from mmw.kernels.radar.resolution_cells import OBJECT_BITS, CellGrid, has_own_cell, parts_of, store_place
from mmw.kernels.radar.trace import RadarRays

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})

vec5d = wp.types.vector(length=5, dtype=wp.float64)
"""Powers by path type, `PATH_*` of `mmw.kernels.radar.echo_paths`."""


@wp.struct
class PathSums:
    """Sums over the echoes of every occupied cell, shape [K]; ordered by view, then by cell.

    The arrays that `mmw.kernels.radar.resolution_cells.CellSums` has too hold the same.
    """

    view: wp.array[int]
    cell: wp.array[int]
    power: wp.array[float]
    """Power of the sum of the amplitudes, or sum of the powers [W]."""
    rcs: wp.array[float]
    """Radar cross section that explains the power [m2]."""
    range: wp.array[float]
    velocity: wp.array[float]
    y: wp.array[float]
    z: wp.array[float]
    object_id: wp.array[int]
    """Object of the largest share of the powers by object and path, -1 for none."""
    path_type: wp.array[wp.uint8]
    """Path of that share."""
    count: wp.array[int]
    """Number of occupied cells, whether there is room for them or not, shape [1]."""


@wp.kernel
def path_sum_kernel(
    rays: RadarRays,
    grid: CellGrid,
    key: wp.array[wp.int64],
    ray: wp.array[int],
    start: wp.array[int],
    first_up_to: wp.array[int],
    is_coherent: int,
    # out
    sums_out: PathSums,
):
    """Add up the echoes of each cell, in the order of their keys and then of their numbers.

    Positions are means weighted by the powers of the echoes, whatever their phases are.

    Launch: dim=room for cells; the first K have a cell.
    """
    index = wp.tid()
    if not has_own_cell(first_up_to, sums_out.count, index):
        return
    first = start[index]
    place = key[first] >> wp.int64(OBJECT_BITS)
    total = wp.float64(0.0)
    rcs = wp.float64(0.0)
    i_sum = wp.float64(0.0)
    q_sum = wp.float64(0.0)
    offset = wp.vec4d()
    shares = vec5d()  # of the object that the loop is at
    largest = wp.float64(0.0)
    at = wp.int32(-1)
    object_id = wp.int32(-1)
    path_type = wp.int32(0)
    i = first
    while i < key.shape[0]:
        if (key[i] >> wp.int64(OBJECT_BITS)) != place:
            break
        view = ray[i] // rays.range.shape[1]
        r = ray[i] % rays.range.shape[1]
        power = wp.float64(rays.power[view, r])
        total += power
        rcs += wp.float64(rays.rcs[view, r])
        offset += power * wp.vec4d(parts_of(rays, grid, view, r))
        if is_coherent == 1:
            angle = wp.float64(2.0) * wp.float64(wp.PI) * wp.float64(rays.turns[view, r])
            i_sum += wp.sqrt(power) * wp.cos(angle)
            q_sum += wp.sqrt(power) * wp.sin(angle)
        if rays.object_id[view, r] != at:
            at = rays.object_id[view, r]
            shares = vec5d()
        kind = wp.int32(0)
        if rays.path_type.shape[0] > 0:
            kind = int(rays.path_type[view, r])
        shares[kind] += power
        if shares[kind] > largest:
            largest = shares[kind]
            object_id = at
            path_type = kind
        i += 1
    mean = wp.vec4()
    received = total
    if is_coherent == 1:
        received = i_sum * i_sum + q_sum * q_sum
    if total > wp.float64(0.0):
        mean = wp.vec4(offset / total)
        rcs *= received / total
    store_place(sums_out, index, grid, key[first], mean)
    sums_out.power[index] = wp.float32(received)
    sums_out.rcs[index] = wp.float32(rcs)
    sums_out.object_id[index] = object_id
    sums_out.path_type[index] = wp.uint8(path_type)
