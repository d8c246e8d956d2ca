"""Find the local maxima of the echoes above the threshold, and measure them: float64, on the host, one thread, as there
are a few hundred and each depends on those beside it.
"""

import warp as wp

from mmw.kernels.core.compiler import AS_NUMPY
from mmw.kernels.core.noise import normal2, uniform4
from mmw.kernels.radar.resolution_cells import CellGrid
from mmw.kernels.radar.thresholds import ERROR_DRAW, LABEL_OBJECT, Echoes, Receiver

wp.set_module_options(AS_NUMPY)

BARTON = wp.constant(wp.float64(1.6))
"""Slope of an estimator of a peak: its error is step / (1.6 sqrt(2 SNR)). Source: D. Barton, Modern Radar System
Analysis, 1988, for a beam or a pulse of common shape."""


@wp.struct
class Candidates:
    """Echoes ordered by view and range, in float32, with room for more than there are."""

    order: wp.array[int]
    """Their places in `Echoes`."""
    view: wp.array[int]
    """-1 after the last one."""
    range: wp.array[float]
    velocity: wp.array[float]
    y: wp.array[float]
    z: wp.array[float]
    power: wp.array[float]


@wp.struct
class Detections:
    """Points by view and range, see `RadarPoints`."""

    first: wp.array[int]
    """First point of every view, and their number, shape [A + 1]."""
    range: wp.array[float]
    azimuth: wp.array[float]
    elevation: wp.array[float]
    velocity: wp.array[float]
    power_db: wp.array[float]
    snr_db: wp.array[float]
    rcs_dbsm: wp.array[float]
    object_id: wp.array[int]
    label: wp.array[wp.uint8]
    path_type: wp.array[wp.uint8]


@wp.func
def is_before(echoes: Echoes, a: int, b: int) -> bool:
    """Return whether an echo comes before another: by view, range in float32, label, and place in the list."""
    if echoes.view[a] != echoes.view[b]:
        return echoes.view[a] < echoes.view[b]
    range_a = wp.float32(echoes.range[a])
    range_b = wp.float32(echoes.range[b])
    if range_a != range_b:
        return range_a < range_b
    if echoes.label[a] != echoes.label[b]:
        return echoes.label[a] < echoes.label[b]
    return a < b


@wp.func
def order_echoes(echoes: Echoes, count: int, candidates_out: Candidates) -> int:
    """Write the order of the echoes that count, and return how many these are.

    Source: D. Shell, "A high-speed sorting procedure", 1959, with gaps (3^k - 1) / 2 of D. Knuth.
    """
    found = wp.int32(0)
    for i in range(count):
        if echoes.view[i] >= 0:
            candidates_out.order[found] = i
            found += 1
    gap = wp.int32(1)
    while 3 * gap + 1 < found:
        gap = 3 * gap + 1
    while gap > 0:
        for i in range(gap, found):
            own = candidates_out.order[i]
            j = wp.int32(i)
            while j >= gap and is_before(echoes, own, candidates_out.order[j - gap]):
                candidates_out.order[j] = candidates_out.order[j - gap]
                j -= gap
            candidates_out.order[j] = own
        gap = gap // 3
    return found


@wp.func
def is_within(a: float, b: float, step: float) -> bool:
    """Return whether two positions are less than a step apart; a ten-thousandth of a step allows for rounding."""
    return wp.abs(a - b) < 0.9999 * step


@wp.func
def is_within_ring(a: float, b: float, step: float, count: int) -> bool:
    """Return the same on an axis of `count` cells that wraps around; on an axis of one cell all positions are one."""
    ring = step * float(count)
    gap = wp.abs(a - b)
    return count == 1 or wp.min(gap, ring - gap) < 0.9999 * step


@wp.func
def is_closer_and_stronger(candidates: Candidates, grid: CellGrid, other: int, own: int) -> bool:
    """Return whether `other` is less than a cell from `own` on every axis and stronger, or as strong and before it."""
    if not is_within(candidates.range[other], candidates.range[own], grid.range_step):
        return False
    if not is_within_ring(candidates.velocity[other], candidates.velocity[own], grid.velocity_step, grid.velocities):
        return False
    if not is_within_ring(candidates.y[other], candidates.y[own], grid.y_step, grid.ys):
        return False
    if not is_within_ring(candidates.z[other], candidates.z[own], grid.z_step, grid.zs):
        return False
    if candidates.power[other] == candidates.power[own]:
        return other < own
    return candidates.power[other] > candidates.power[own]


@wp.func
def is_peak(candidates: Candidates, grid: CellGrid, own: int) -> bool:
    """Return whether a candidate has no stronger one less than a cell away on every axis."""
    other = own - 1
    while other >= 0 and candidates.view[other] == candidates.view[own]:
        if candidates.range[own] - candidates.range[other] >= grid.range_step:
            break
        if is_closer_and_stronger(candidates, grid, other, own):
            return False
        other -= 1
    other = own + 1
    while candidates.view[other] == candidates.view[own]:
        if candidates.range[other] - candidates.range[own] >= grid.range_step:
            break
        if is_closer_and_stronger(candidates, grid, other, own):
            return False
        other += 1
    return True


@wp.func
def folded(value: wp.float64, half: wp.float64) -> wp.float64:
    """Return a value in [-half, half)."""
    whole = wp.float64(2.0) * half
    rest = wp.mod(value + half, whole)
    if rest < wp.float64(0.0):
        rest += whole
    return rest - half


@wp.func
def decibels(value: wp.float64) -> float:
    """Return 10 log10 of a value."""
    return wp.float32(wp.float64(10.0) * wp.log10(value))


@wp.kernel
def estimate_kernel(
    key: wp.array[wp.vec2ui],
    grid: CellGrid,
    receiver: Receiver,
    echoes: Echoes,
    count: int,
    # out
    candidates_out: Candidates,
    detections_out: Detections,
):
    """Measure the echoes without a stronger one less than a cell away: by view and range, with normal errors.

    Launch: dim=1.
    """
    found = order_echoes(echoes, count, candidates_out)
    for i in range(found):
        own = candidates_out.order[i]
        candidates_out.view[i] = echoes.view[own]
        candidates_out.range[i] = wp.float32(echoes.range[own])
        candidates_out.velocity[i] = wp.float32(echoes.velocity[own])
        candidates_out.y[i] = wp.float32(echoes.y[own])
        candidates_out.z[i] = wp.float32(echoes.z[own])
        candidates_out.power[i] = wp.float32(echoes.power[own])
    candidates_out.view[found] = -1
    one = wp.float64(1.0)
    half = wp.float64(0.5)
    view = wp.int32(0)
    points = wp.int32(0)
    detections_out.first[0] = 0
    for i in range(found):
        own = candidates_out.order[i]
        while view < echoes.view[own]:
            view += 1
            detections_out.first[view] = points
        if not is_peak(candidates_out, grid, i):
            continue
        power = echoes.power[own] - receiver.noise
        snr = power / receiver.noise
        # Rain and false alarms are anywhere in their cell already.
        scale = wp.float64(0.0)
        if echoes.label[own] == wp.uint8(LABEL_OBJECT):
            scale = one
        u = uniform4(key[view], echoes.cell[own], ERROR_DRAW)
        first = normal2(u[0], u[1])
        second = normal2(u[2], u[3])
        spread = BARTON * wp.sqrt(wp.float64(2.0) * snr)
        range_error = wp.clamp(wp.float64(first[0]) / spread, -half, half) * scale
        velocity_error = wp.clamp(wp.float64(first[1]) / spread, -half, half) * scale
        y = echoes.y[own]
        z = echoes.z[own]
        if grid.ys > 1:
            y = folded(y + wp.clamp(wp.float64(second[0]) / spread, -half, half) * scale * receiver.y_step, one)
        if grid.zs > 1:
            z = folded(z + wp.clamp(wp.float64(second[1]) / spread, -half, half) * scale * receiver.z_step, one)
        z = wp.clamp(z, -one, one)
        x = wp.sqrt(wp.max(one - y * y - z * z, wp.float64(0.0)))
        velocity = echoes.velocity[own] + velocity_error * receiver.velocity_step
        detections_out.range[points] = wp.float32(wp.abs(echoes.range[own] + range_error * receiver.range_step))
        detections_out.azimuth[points] = wp.float32(wp.atan2(y, x))
        detections_out.elevation[points] = wp.float32(wp.asin(z))
        detections_out.velocity[points] = wp.float32(folded(velocity, receiver.max_velocity))
        detections_out.power_db[points] = decibels(power * wp.float64(1000.0))
        detections_out.snr_db[points] = decibels(snr)
        detections_out.rcs_dbsm[points] = decibels(echoes.rcs[own])
        detections_out.object_id[points] = echoes.object_id[own]
        detections_out.label[points] = echoes.label[own]
        detections_out.path_type[points] = echoes.path_type[own]
        points += 1
    while view < key.shape[0]:
        view += 1
        detections_out.first[view] = points
