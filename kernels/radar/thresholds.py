"""Draw what resolution cells receive, echoes in noise, and list the cells above the threshold: float64, on the host."""

import warp as wp

from mmw.kernels.core.compiler import AS_NUMPY
from mmw.kernels.core.noise import normal2, uniform4
from mmw.kernels.radar.resolution_cells import CellGrid, centred, wrapped

wp.set_module_options(AS_NUMPY)

ECHO_DRAW = wp.constant(0)
ERROR_DRAW = wp.constant(1)
RAIN_PLACE_DRAW = wp.constant(2)
ALARM_DRAW = wp.constant(3)
ALARM_PLACE_DRAW = wp.constant(4)
"""Draws of a view's random numbers: by cell the first three, by number of the false alarm the others."""

LABEL_OBJECT = wp.constant(0)
LABEL_RAIN = wp.constant(1)
LABEL_FALSE_ALARM = wp.constant(2)
"""Values of `RadarPoints.label`."""


@wp.struct
class Receiver:
    """Limits of a detection, and the scales of what is measured."""

    noise: wp.float64
    """Noise power of a cell [W]."""
    threshold: wp.float64
    """Power above which a cell is a detection [W]."""
    log_miss: wp.float64
    """Logarithm of the probability that noise alone stays below the threshold."""
    link_constant: wp.float64
    """Received power times R^4 over RCS, on boresight [W m2]."""
    max_velocity: wp.float64
    """Half the unambiguous interval [m/s]."""
    range_step: wp.float64
    velocity_step: wp.float64
    y_step: wp.float64
    z_step: wp.float64
    """Widths of a cell, those of `CellGrid` [m, m/s, -, -]."""
    is_coherent: wp.bool
    """Whether cells hold the power of a sum of amplitudes, in place of a mean power."""
    most: int
    """Most false alarms of a view."""
    y_cell: wp.array[int]
    """Centered cells along y in the field of view."""
    z_cell: wp.array[int]
    """Centered cells along z in the field of view."""


@wp.struct
class Cells:
    """Echoes of the occupied cells, K by view and number, with room for more; see `RadarCells`."""

    first: wp.array[int]
    """First cell of every view, and K, shape [A + 1]."""
    view: wp.array[int]
    cell: wp.array[int]
    power: wp.array[float]
    rcs: wp.array[float]
    range: wp.array[float]
    velocity: wp.array[float]
    y: wp.array[float]
    z: wp.array[float]
    object_id: wp.array[int]
    path_type: wp.array[wp.uint8]


@wp.struct
class Echoes:
    """Cells above the threshold: where they are, and what was received; echoes, false alarms, rain."""

    view: wp.array[int]
    """-1 for one that does not count."""
    range: wp.array[wp.float64]
    velocity: wp.array[wp.float64]
    y: wp.array[wp.float64]
    z: wp.array[wp.float64]
    power: wp.array[wp.float64]
    """Echo and noise [W]."""
    rcs: wp.array[wp.float64]
    """RCS that explains the power without the noise [m2]."""
    object_id: wp.array[int]
    label: wp.array[wp.uint8]
    cell: wp.array[int]
    """Number of the cell: the item of the random numbers."""
    path_type: wp.array[wp.uint8]
    place: wp.array[wp.vec4i]
    """Range cell, and centered cells of velocity, y and z, of false alarms."""
    count: wp.array[int]
    """Number of echoes of objects, and of these and false alarms, shape [2]."""


@wp.func
def cell_echo(receiver: Receiver, u: wp.vec4, power: wp.float64) -> wp.float64:
    """Return what a cell receives, echo and noise [W]: an exponential number, or a steady echo in complex noise."""
    if receiver.is_coherent:
        normal = normal2(u[0], u[1])
        scale = wp.sqrt(receiver.noise / wp.float64(2.0))
        i = wp.sqrt(power) + wp.float64(normal[0]) * scale
        q = wp.float64(normal[1]) * scale
        return i * i + q * q
    return -wp.log(wp.float64(u[0])) * (receiver.noise + power)


@wp.func
def is_surely_below(receiver: Receiver, u: wp.vec4, power: wp.float64) -> bool:
    """Return whether no logarithm is needed to know that a cell is below the threshold: -ln u is at most 1 / u - 1."""
    if receiver.is_coherent:
        return False
    bound = wp.float64(1.0) / wp.float64(u[0]) - wp.float64(1.0)
    return wp.float64(1.000001) * bound * (receiver.noise + power) < receiver.threshold


@wp.kernel
def echo_kernel(
    key: wp.array[wp.vec2ui],
    receiver: Receiver,
    cells: Cells,
    # out
    echo_out: wp.array[wp.float64],
):
    """Draw what each cell receives [W]. Launch: dim=K."""
    i = wp.tid()
    u = uniform4(key[cells.view[i]], cells.cell[i], ECHO_DRAW)
    echo_out[i] = cell_echo(receiver, u, wp.float64(cells.power[i]))


@wp.func
def has_cell(cells: Cells, view: int, cell: int) -> bool:
    """Return whether a view has echoes in a cell."""
    low = cells.first[view]
    end = cells.first[view + 1]
    high = end
    while low < high:
        middle = (low + high) // 2
        if cells.cell[middle] < cell:
            low = middle + 1
        else:
            high = middle
    return low < end and cells.cell[low] == cell


@wp.func
def shift(u: float) -> wp.float64:
    """Return a place in a cell by a uniform number, -1/2 to 1/2 steps from the middle."""
    return wp.float64(u) - wp.float64(0.5)


@wp.func
def measured_step(step: wp.float64, cells: int) -> wp.float64:
    """Return the width of a cell of a direction cosine; 0 for one antenna, which measures none."""
    return wp.where(cells > 1, step, wp.float64(0.0))


@wp.kernel
def threshold_kernel(
    key: wp.array[wp.vec2ui],
    grid: CellGrid,
    receiver: Receiver,
    cells: Cells,
    # out
    echoes_out: Echoes,
):
    """List the cells above the threshold: those with echoes, then those with noise alone, false alarms.

    The cells of the field of view form a line; from one false alarm to the next it is a geometric number of cells.
    Cells that echoes were drawn for have had their noise. What there is no room for is counted, and overwrites the last
    place. Launch: dim=1.
    """
    count = wp.int32(0)
    last = echoes_out.view.shape[0] - 1
    views = key.shape[0]
    for i in range(cells.first[views]):
        power = wp.float64(cells.power[i])
        u = uniform4(key[cells.view[i]], cells.cell[i], ECHO_DRAW)
        if is_surely_below(receiver, u, power):
            continue
        received = cell_echo(receiver, u, power)
        if received > receiver.threshold:
            slot = wp.min(count, last)
            echoes_out.view[slot] = cells.view[i]
            echoes_out.range[slot] = wp.float64(cells.range[i])
            echoes_out.velocity[slot] = wp.float64(cells.velocity[i])
            echoes_out.y[slot] = wp.float64(cells.y[i])
            echoes_out.z[slot] = wp.float64(cells.z[i])
            echoes_out.power[slot] = received
            echoes_out.rcs[slot] = wp.float64(cells.rcs[i]) * (received - receiver.noise) / power
            echoes_out.object_id[slot] = cells.object_id[i]
            echoes_out.label[slot] = wp.uint8(LABEL_OBJECT)
            echoes_out.cell[slot] = cells.cell[i]
            echoes_out.path_type[slot] = cells.path_type[i]
            count += 1
    echoes_out.count[0] = count
    ys = wp.int64(receiver.y_cell.shape[0])
    zs = wp.int64(receiver.z_cell.shape[0])
    velocities = wp.int64(grid.velocities)
    all_cells = wp.float64(wp.int64(grid.ranges) * velocities * ys * zs)
    for view in range(views):
        end = wp.float64(0.0)
        for item in range(receiver.most):
            u = uniform4(key[view], item, ALARM_DRAW)
            end += wp.floor(wp.log(wp.float64(u[0])) / receiver.log_miss) + wp.float64(1.0)
            if end > all_cells:
                break
            at = wp.int64(end) - wp.int64(1)
            r = int(at // (zs * ys * velocities))
            v = centred(int((at // (zs * ys)) % velocities), grid.velocities)
            y = receiver.y_cell[int((at // zs) % ys)]
            z = receiver.z_cell[int(at % zs)]
            cell = (r * grid.velocities + wrapped(v, grid.velocities)) * grid.ys + wrapped(y, grid.ys)
            cell = cell * grid.zs + wrapped(z, grid.zs)
            across = wp.float64(y) * receiver.y_step
            up = wp.float64(z) * receiver.z_step
            if across * across + up * up <= wp.float64(1.0) and not has_cell(cells, view, cell):
                slot = wp.min(count, last)
                part = uniform4(key[view], item, ALARM_PLACE_DRAW)
                distance = wp.abs(wp.float64(r) + shift(part[0])) * receiver.range_step
                power = receiver.threshold - receiver.noise * wp.log(wp.float64(u[1]))
                echoes_out.view[slot] = view
                echoes_out.range[slot] = distance
                echoes_out.velocity[slot] = (wp.float64(v) + shift(part[1])) * receiver.velocity_step
                echoes_out.y[slot] = (wp.float64(y) + shift(part[2])) * measured_step(receiver.y_step, grid.ys)
                echoes_out.z[slot] = (wp.float64(z) + shift(part[3])) * measured_step(receiver.z_step, grid.zs)
                echoes_out.power[slot] = power
                fourth = wp.pow(distance, wp.float64(4.0))
                echoes_out.rcs[slot] = (power - receiver.noise) * fourth / receiver.link_constant
                echoes_out.object_id[slot] = -1
                echoes_out.label[slot] = wp.uint8(LABEL_FALSE_ALARM)
                echoes_out.cell[slot] = cell
                echoes_out.path_type[slot] = wp.uint8(0)
                echoes_out.place[slot] = wp.vec4i(r, v, y, z)
                count += 1
    echoes_out.count[1] = count
