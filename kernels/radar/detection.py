"""Draw random numbers of lists of cells, and rain clutter."""

import warp as wp

from mmw.kernels.core.noise import uniform4
from mmw.kernels.radar.resolution_cells import CellGrid

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})


@wp.struct
class RainLink:
    """Rain clutter of one weather."""

    constant: float
    """Mean power of a cell of 1 sr / m of range step at 1 m, without loss: link constant x backscatter x volume [W]."""
    loss_per_m: float
    """Exponent of the air's loss, both ways [Np of power per meter of distance]."""
    noise: float
    """Noise power of a cell [W]."""
    least: float
    """Rain that returns less than this in all velocity cells together is not drawn [W]."""
    nearest: int
    """First range cell that rain is drawn in."""
    draw: int
    """First draw of the random numbers."""


@wp.kernel
def uniform_kernel(
    key: wp.array[wp.vec2ui],
    view: wp.array[int],
    item: wp.array[int],
    draw: wp.array[int],
    # out
    uniform_out: wp.array[wp.vec4],
):
    """Draw four uniform numbers for each item of a list. Launch: dim=N."""
    i = wp.tid()
    uniform_out[i] = uniform4(key[view[i]], item[i], draw[i])


@wp.func
def normal_below(x: float) -> float:
    """Return the probability that a standard normal number is below a bound."""
    return 0.5 + 0.5 * wp.erf(x * 0.70710678)


@wp.kernel
def rain_kernel(
    key: wp.array[wp.vec2ui],
    grid: CellGrid,
    rain: RainLink,
    gain: wp.array[float],
    mean_velocity: wp.array2d[float],
    spread: wp.array2d[float],
    # out
    power_out: wp.array3d[float],
    velocity_out: wp.array3d[int],
):
    """Draw the strongest velocity cell of rain and noise for each range and direction.

    The echo of rain is spread over the velocity cells within three standard deviations of its mean; each of them is an
    exponential draw with the mean of its share of the rain and the noise. `gain` is the two-way gain over boresight
    times the solid angle of a direction [sr], shape [J]; `mean_velocity` and `spread` are [m/s], shape [A, J]. The
    power is 0 where rain is not drawn.

    Launch: dim=(A, ranges, J).
    """
    view, cell, direction = wp.tid()
    distance = wp.max(float(cell), 0.5) * grid.range_step
    loss = wp.exp(-rain.loss_per_m * distance)
    power = rain.constant * gain[direction] * loss / (distance * distance)
    power_out[view, cell, direction] = 0.0
    velocity_out[view, cell, direction] = 0
    if power < rain.least or cell < rain.nearest:
        return
    middle = mean_velocity[view, direction] / grid.velocity_step
    width = wp.max(spread[view, direction] / grid.velocity_step, 1.0e-3)
    low = int(wp.rint(middle - 3.0 * width))
    top = int(wp.rint(middle + 3.0 * width))
    high = wp.min(top, low + grid.velocities - 1)
    item = cell * gain.shape[0] + direction
    best = wp.float32(0.0)
    best_cell = wp.int32(low)
    u = wp.vec4()
    below = normal_below((float(low) - 0.5 - middle) / width)
    for step in range(low, high + 1):
        index = step - low
        if index % 4 == 0:
            u = uniform4(key[view], item, rain.draw + index // 4)
        next_below = normal_below((float(step) + 0.5 - middle) / width)
        share = next_below - below
        below = next_below
        alias = step + grid.velocities  # velocities that fold into the same cell
        while alias <= top:
            share += normal_below((float(alias) + 0.5 - middle) / width)
            share -= normal_below((float(alias) - 0.5 - middle) / width)
            alias += grid.velocities
        drawn = -wp.log(u[index % 4]) * (rain.noise + power * share)
        if drawn > best:
            best = drawn
            best_cell = step
    power_out[view, cell, direction] = best
    velocity_out[view, cell, direction] = best_cell
