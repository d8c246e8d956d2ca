"""Find the resolution cell of each ray's echo, and sum the rays of a cell.

A cell is a whole number along each of four axes: range, radial velocity, and the direction cosines along y (left) and z
(up), which is what an array of antennas measures. Cell i of an axis covers (i - 1/2, i + 1/2) steps, as the bins of a
Fourier transform do; all axes but range wrap around.
"""

from typing import Any

import warp as wp

from mmw.kernels.radar.trace import RadarRays

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})

OBJECT_BITS = wp.constant(24)
"""Bits of a key that hold the object: rows of `objects`, counted from 0, with one more for none."""
NO_KEY = wp.constant(wp.int64(0x7FFFFFFFFFFFFFFF))
"""Key of a ray without an echo: it sorts last."""


@wp.struct
class CellGrid:
    """The cells of one radar; a cell has the number ((range * V + velocity) * Y + y) * Z + z."""

    range_step: float
    """Width of a range cell [m]."""
    velocity_step: float
    """Width of a velocity cell [m/s]."""
    y_step: float
    """Width of a cell of the direction cosine along y [-]."""
    z_step: float
    """Width of a cell of the direction cosine along z [-]."""
    ranges: int
    velocities: int
    """Velocity cells V; they wrap around."""
    ys: int
    """Cells Y of the direction cosine along y; they wrap around."""
    zs: int
    """Cells Z of the direction cosine along z; they wrap around."""


@wp.struct
class CellSums:
    """Sums over the rays of every occupied cell, shape [K]; ordered by view, then by cell."""

    view: wp.array[int]
    cell: wp.array[int]
    """Number of the cell."""
    power: wp.array[float]
    """Sum of the rays' powers [W]."""
    rcs: wp.array[float]
    """Sum of the rays' radar cross sections [m2]."""
    range: wp.array[float]
    """Mean weighted by power, as are the next three [m]."""
    velocity: wp.array[float]
    """Folded into the unambiguous interval [m/s]."""
    y: wp.array[float]
    """Direction cosine along y; 0 where one antenna measures nothing [-]."""
    z: wp.array[float]
    """Direction cosine along z; 0 where one antenna measures nothing [-]."""
    object_id: wp.array[int]
    """Object with the largest share of the power, -1 for none."""
    count: wp.array[int]
    """Number of occupied cells, whether there is room for them or not, shape [1]."""


@wp.func
def wrapped(step: int, count: int) -> int:
    """Return a cell in 0 to count - 1."""
    return ((step % count) + count) % count


@wp.func
def centred(cell: int, count: int) -> int:
    """Return a wrapped cell in -(count / 2) to (count - 1) / 2."""
    return wp.where(2 * cell < count, cell, cell - count)


@wp.func
def part_of(position: float) -> float:
    """Return where in its cell a position lies, -1/2 to 1/2 steps from the middle."""
    return position - wp.rint(position)


@wp.func
def parts_of(rays: RadarRays, grid: CellGrid, view: int, r: int) -> wp.vec4:
    """Return where in its cell an echo lies on the four axes, -1/2 to 1/2 steps from the middle."""
    elevation = rays.elevation[view, r]
    y = wp.sin(rays.azimuth[view, r]) * wp.cos(elevation)
    return wp.vec4(
        part_of(rays.range[view, r] / grid.range_step),
        part_of(rays.velocity[view, r] / grid.velocity_step),
        part_of(y / grid.y_step),
        part_of(wp.sin(elevation) / grid.z_step),
    )


@wp.func
def place_of(grid: CellGrid, key: wp.int64) -> tuple[int, int]:
    """Return the view and the number of the cell of a key."""
    place = key >> wp.int64(OBJECT_BITS)
    cells = wp.int64(grid.ranges) * wp.int64(grid.velocities) * wp.int64(grid.ys) * wp.int64(grid.zs)
    return int(place // cells), int(place % cells)


@wp.func
def store_place(sums_out: Any, index: int, grid: CellGrid, key: wp.int64, mean: wp.vec4):
    """Write view, cell and mean position of an occupied cell; `mean` is from the cell's middle, in steps."""
    view, cell = place_of(grid, key)
    z_cell = cell % grid.zs
    y_cell = (cell // grid.zs) % grid.ys
    velocity_cell = (cell // (grid.zs * grid.ys)) % grid.velocities
    range_cell = cell // (grid.zs * grid.ys * grid.velocities)
    sums_out.view[index] = view
    sums_out.cell[index] = cell
    sums_out.range[index] = (float(range_cell) + mean[0]) * grid.range_step
    sums_out.velocity[index] = (float(centred(velocity_cell, grid.velocities)) + mean[1]) * grid.velocity_step
    # one antenna measures no angle, whatever the rays carry
    sums_out.y[index] = wp.where(grid.ys > 1, (float(centred(y_cell, grid.ys)) + mean[2]) * grid.y_step, 0.0)
    sums_out.z[index] = wp.where(grid.zs > 1, (float(centred(z_cell, grid.zs)) + mean[3]) * grid.z_step, 0.0)


@wp.kernel
def cell_key_kernel(
    rays: RadarRays,
    grid: CellGrid,
    # out
    key_out: wp.array[wp.int64],
    ray_out: wp.array[int],
):
    """Give every ray the key (view, cell, object) that it is sorted by, and its own number. Launch: dim=(A, R)."""
    view, ray = wp.tid()
    index = view * rays.range.shape[1] + ray
    ray_out[index] = index
    key_out[index] = NO_KEY
    distance = rays.range[view, ray]
    if rays.object_id[view, ray] < 0 or not wp.isfinite(distance):
        return
    range_cell = int(wp.rint(distance / grid.range_step))
    if range_cell >= grid.ranges:
        return
    elevation = rays.elevation[view, ray]
    y = wp.sin(rays.azimuth[view, ray]) * wp.cos(elevation)
    velocity_cell = wrapped(int(wp.rint(rays.velocity[view, ray] / grid.velocity_step)), grid.velocities)
    y_cell = wrapped(int(wp.rint(y / grid.y_step)), grid.ys)
    z_cell = wrapped(int(wp.rint(wp.sin(elevation) / grid.z_step)), grid.zs)
    cell = ((range_cell * grid.velocities + velocity_cell) * grid.ys + y_cell) * grid.zs + z_cell
    cells = wp.int64(grid.ranges) * wp.int64(grid.velocities) * wp.int64(grid.ys) * wp.int64(grid.zs)
    place = wp.int64(view) * cells + wp.int64(cell)
    key_out[index] = (place << wp.int64(OBJECT_BITS)) | wp.int64(rays.object_id[view, ray])


@wp.kernel
def is_first_kernel(
    key: wp.array[wp.int64],
    # out
    is_first_out: wp.array[int],
):
    """Mark the first ray of every cell in sorted keys. Launch: dim=A * R."""
    i = wp.tid()
    place = key[i] >> wp.int64(OBJECT_BITS)
    is_echo = key[i] != NO_KEY
    is_new = i == 0
    if i > 0:
        is_new = (key[i - 1] >> wp.int64(OBJECT_BITS)) != place
    is_first_out[i] = wp.where(is_echo and is_new, 1, 0)


@wp.kernel
def cell_start_kernel(
    is_first: wp.array[int],
    first_up_to: wp.array[int],
    # out
    start_out: wp.array[int],
):
    """Write where each cell starts in the sorted rays. Launch: dim=A * R."""
    i = wp.tid()
    if is_first[i] == 1:
        start_out[first_up_to[i] - 1] = i


@wp.func
def has_own_cell(first_up_to: wp.array[int], count_out: wp.array[int], index: int) -> bool:
    """Return whether a thread has one of the occupied cells; the first thread writes how many these are."""
    count = first_up_to[first_up_to.shape[0] - 1]
    if index == 0:
        count_out[0] = count
    return index < count


@wp.kernel
def cell_sum_kernel(
    rays: RadarRays,
    grid: CellGrid,
    key: wp.array[wp.int64],
    ray: wp.array[int],
    start: wp.array[int],
    first_up_to: wp.array[int],
    # out
    sums_out: CellSums,
):
    """Add up the rays of each cell, in the order of their keys and then of their numbers.

    Launch: dim=room for cells; the first K have a cell.
    """
    index = wp.tid()
    if not has_own_cell(first_up_to, sums_out.count, index):
        return
    first = start[index]
    place = key[first] >> wp.int64(OBJECT_BITS)
    total = wp.float64(0.0)
    rcs = wp.float64(0.0)
    offset = wp.vec4d()
    shared = wp.float64(0.0)  # power of the object that the loop is at
    largest = wp.float64(0.0)
    at = wp.int32(-1)
    object_id = wp.int32(-1)
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
        if rays.object_id[view, r] != at:
            at = rays.object_id[view, r]
            shared = wp.float64(0.0)
        shared += power
        if shared > largest:
            largest = shared
            object_id = at
        i += 1
    mean = wp.vec4()
    if total > wp.float64(0.0):
        mean = wp.vec4(offset / total)
    store_place(sums_out, index, grid, key[first], mean)
    sums_out.power[index] = wp.float32(total)
    sums_out.rcs[index] = wp.float32(rcs)
    sums_out.object_id[index] = object_id
