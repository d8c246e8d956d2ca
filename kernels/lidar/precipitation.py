"""Draw LiDAR returns of rain and fog: drops by order statistics of a Poisson process, fog as a noisy target."""

import warp as wp

from mmw.kernels.core.noise import random_bits, uniform4, unit_interval

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})

RAIN = wp.constant(1)
"""Label of an echo of rain; 0 is no echo."""

FOG = wp.constant(2)
"""Label of an echo of fog."""

MAX_DROPS = wp.constant(16)
"""Drops of a ray that are looked at, from the strongest down."""

PATCHES = wp.constant(64)
"""Patches of fog along each axis before they repeat themselves, a power of two."""

FOG_SAMPLES = wp.constant(24)
"""Samples of the fog on a ray, one a step of the logarithm of range."""

RAIN_DRAW = wp.constant(0)
"""First draw of rain: half of `MAX_DROPS`, two drops a draw."""

FOG_DRAW = wp.constant(32)
"""First draw of fog: one for the ray, then half of `FOG_SAMPLES`, two samples a draw."""


@wp.struct
class Air:
    """One weather to one LiDAR, from `mmw.sensors.lidar.precipitation.make_air`. Power is in 1/m2, see
    `mmw.sensors.lidar.optics`."""

    extinction: float
    """Extinction of the whole weather [1/m]."""
    min_power: float
    """Power below which nothing is detected [1/m2]."""

    drops: float
    """Mean number of detectable rain drops on a ray without a surface; 0 without rain."""
    drops_log_low: float
    """ln of the mean number of drops at the first entry of the tables."""
    drops_entries_per_log: float
    """Entries of the tables for each unit of that logarithm."""
    drop_log_power: wp.array[float]
    """ln power [1/m2] above which a mean number of drops lies, over the logarithm of that number, shape [N]."""
    drop_range: wp.array2d[float]
    """Quantiles of the range [m] of drops of that power, shape [N, Q]; levels (1 - cos(pi q / (Q - 1))) / 2."""

    fog_from: float
    """Nearest range from which fog can be detected [m]; 0 without such fog."""
    fog_step: float
    """Ratio of the far to the near end of a step of range."""
    fog_power: wp.array[float]
    """Mean power of fog [1/m2] at n equal distances inside every step, shape [`FOG_SAMPLES` * n + 1]."""
    fog_noise: float
    """Standard deviation of the receiver's noise from sample to sample [1/m2]."""
    fog_patchiness: float
    """Standard deviation of ln power from patch to patch of the fog."""
    fog_patches_per_m: float
    """One over the size of a patch [1/m]."""
    fog_patch: wp.array3d[wp.vec2]
    """Numbers of mean 0 and variance 1 at lattice points and at the ones above, shape [`PATCHES`] * 3: see
    `patches_kernel`. The lattice repeats itself. One fog serves all sensors and frames of a scenario."""
    wind: wp.vec3
    """Velocity of the fog, scene frame [m/s]."""


@wp.struct
class Echoes:
    """The strongest and the farthest echo of the air on a ray; the same where there is one, label 0 where none."""

    strongest_power: float
    """Normalized received power [1/m2], 0 for none."""
    strongest_range: float
    """Distance [m], 0 for none."""
    strongest_label: int
    """0 none, `RAIN` or `FOG`."""
    last_power: float
    """Power of the farthest echo [1/m2], 0 for none."""
    last_range: float
    """Distance [m], 0 for none."""
    last_label: int
    """0 none, `RAIN` or `FOG`."""


@wp.func
def with_echo(echoes: Echoes, power: float, distance: float, label: int) -> Echoes:
    """Return the echoes and one more."""
    out = echoes
    if power > out.strongest_power:
        out.strongest_power = power
        out.strongest_range = distance
        out.strongest_label = label
    if distance > out.last_range:
        out.last_power = power
        out.last_range = distance
        out.last_label = label
    return out


@wp.func
def rain_echoes(air: Air, key: wp.vec2ui, ray: int, surface_range: float, echoes: Echoes) -> Echoes:
    """Return the echoes and those of rain drops nearer than a surface.

    The drops that a ray sees stronger than a power are Poisson distributed, so that their powers, from the strongest
    down, are where a mean number of drops grows to the arrivals of a unit Poisson process; the range of a drop of known
    power has a known distribution. Drops behind a surface are left out, which thins the process exactly.

    Source: time change of an inhomogeneous Poisson process, L. Devroye, "Non-Uniform Random Variate Generation", 1986,
    chapter VI.1.
    """
    out = echoes
    entries = air.drop_log_power.shape[0]
    levels = air.drop_range.shape[1]
    arrival = wp.float32(0.0)
    u = wp.vec4()
    for drop in range(MAX_DROPS):
        odd = drop % 2
        if odd == 0:
            u = uniform4(key, ray, RAIN_DRAW + drop // 2)
        arrival -= wp.log(u[2 * odd])
        if arrival >= air.drops:
            break
        entry = (wp.log(arrival) - air.drops_log_low) * air.drops_entries_per_log
        entry = wp.clamp(entry, 0.0, float(entries - 1))
        row = wp.min(int(entry), entries - 2)
        level = wp.acos(1.0 - 2.0 * u[2 * odd + 1]) / wp.PI * float(levels - 1)
        column = wp.min(int(level), levels - 2)
        across = entry - float(row)
        along = level - float(column)
        near = wp.lerp(air.drop_range[row, column], air.drop_range[row, column + 1], along)
        far = wp.lerp(air.drop_range[row + 1, column], air.drop_range[row + 1, column + 1], along)
        distance = wp.lerp(near, far, across)
        if distance < surface_range:
            power = wp.exp(wp.lerp(air.drop_log_power[row], air.drop_log_power[row + 1], across))
            out = with_echo(out, power, distance, RAIN)
    return out


@wp.func
def normal_of(bits: wp.uint32) -> float:
    """Return a number of mean 0 and variance 1 from one word, nearly normal and up to 3.5 in size.

    It is the sum of the four bytes; exp(0.4 n) has the mean of a normal n within 0.02 %. Source: J. Irwin and P. Hall,
    Biometrika 19, 1927.
    """
    byte = wp.uint32(255)
    total = (bits & byte) + ((bits >> wp.uint32(8)) & byte) + ((bits >> wp.uint32(16)) & byte) + (bits >> wp.uint32(24))
    return (float(int(total)) - 510.0) * 0.0067658751


@wp.func
def patch_at(key: wp.vec2ui, x: int, y: int, z: int) -> float:
    """Return the number of a lattice point; one hash serves four points above each other."""
    return normal_of(random_bits(key, (x * PATCHES + y) * PATCHES + z // 4, 0)[z % 4])


@wp.kernel
def patches_kernel(
    key: wp.vec2ui,
    # out
    patch_out: wp.array3d[wp.vec2],
):
    """Fill the lattice of patches from its stream. Launch: dim=(PATCHES, PATCHES, PATCHES)."""
    x, y, z = wp.tid()
    patch_out[x, y, z] = wp.vec2(patch_at(key, x, y, z), patch_at(key, x, y, (z + 1) % PATCHES))


@wp.func
def patch_of(air: Air, point: wp.vec3) -> float:
    """Return the number of the patch field at a point in units of patches: mean 0, variance 1.

    The lattice is interpolated linearly and divided by the standard deviation of the interpolation.
    """
    x = int(wp.floor(point[0]))
    y = int(wp.floor(point[1]))
    z = int(wp.floor(point[2]))
    tx = point[0] - float(x)
    ty = point[1] - float(y)
    tz = point[2] - float(z)
    # Of a power of two, & is the remainder for negative numbers too.
    x0 = x & (PATCHES - 1)
    y0 = y & (PATCHES - 1)
    z0 = z & (PATCHES - 1)
    x1 = (x + 1) & (PATCHES - 1)
    y1 = (y + 1) & (PATCHES - 1)
    low = wp.lerp(air.fog_patch[x0, y0, z0], air.fog_patch[x1, y0, z0], tx)
    high = wp.lerp(air.fog_patch[x0, y1, z0], air.fog_patch[x1, y1, z0], tx)
    column = wp.lerp(low, high, ty)
    sx = 1.0 - tx
    sy = 1.0 - ty
    sz = 1.0 - tz
    variance = (tx * tx + sx * sx) * (ty * ty + sy * sy) * (tz * tz + sz * sz)
    return wp.lerp(column[0], column[1], tz) / wp.sqrt(variance)


@wp.func
def fog_echoes(
    air: Air,
    key: wp.vec2ui,
    ray: int,
    surface_range: float,
    origin: wp.vec3,
    direction: wp.vec3,
    time_s: float,
    echoes: Echoes,
) -> Echoes:
    """Return the echoes and those of fog nearer than a surface.

    The mean power of fog over range is multiplied by a log-normal factor of mean 1 from patches of the fog, which drift
    with the wind, and the receiver's noise is added, drawn for every sample. The strongest echo is the maximum of the
    noisy samples, so it is stronger than the maximum of the mean: a receiver that looks for peaks in noise has the same
    bias.

    Samples lie anywhere in steps of the logarithm of range, whose edges differ from ray to ray, or the farthest echoes
    would form rings. They do not depend on the surface, which only hides those behind it.

    Source: mean power, `mmw.sensors.lidar.precipitation.fog_power`; sampling and noise are design values.
    """
    out = echoes
    entries = float((air.fog_power.shape[0] - 1) // FOG_SAMPLES)
    mean_of_patches = 0.5 * air.fog_patchiness * air.fog_patchiness
    start = (origin - air.wind * time_s) * air.fog_patches_per_m
    step = direction * air.fog_patches_per_m
    bits = wp.vec4ui()
    phase = unit_interval(random_bits(key, ray, FOG_DRAW)[0])
    last_place = float(FOG_SAMPLES) - 1.0e-4
    last_edge = air.fog_from
    next_edge = air.fog_from
    for sample in range(FOG_SAMPLES):
        odd = sample % 2
        if odd == 0:
            bits = random_bits(key, ray, FOG_DRAW + 1 + sample // 2)
        u = unit_interval(bits[2 * odd])
        place = wp.where(sample == 0, phase * u, wp.min(float(sample - 1) + phase + u, last_place))
        whole = int(place)
        inside = place - float(whole)
        edge = wp.where(whole == sample, next_edge, last_edge)
        distance = wp.lerp(edge, edge * air.fog_step, inside)
        last_edge = next_edge
        next_edge *= air.fog_step
        if distance >= surface_range:
            break

        entry = inside * entries
        row = int(entry)
        entry -= float(row)
        row += whole * int(entries)
        mean = wp.lerp(air.fog_power[row], air.fog_power[row + 1], entry)
        patch = patch_of(air, start + step * distance)
        power = mean * wp.exp(air.fog_patchiness * patch - mean_of_patches)
        power += air.fog_noise * normal_of(bits[2 * odd + 1])
        if power > air.min_power:
            out = with_echo(out, power, distance, FOG)
    return out


@wp.func
def air_echoes(
    air: Air,
    key: wp.vec2ui,
    ray: int,
    surface_range: float,
    origin: wp.vec3,
    direction: wp.vec3,
    time_s: float,
) -> Echoes:
    """Return what rain and fog return on a ray from nearer than a surface and above the threshold.

    Args:
        air: The weather to the sensor.
        key: Stream of the view; draws 0 to 99 are used.
        ray: Index of the ray.
        surface_range: Distance of the first surface [m], inf for a miss.
        origin: Of the ray, scene frame [m].
        direction: Of the ray, scene frame, unit length.
        time_s: Since the start of the scenario [s]; the fog drifts with it.
    """
    echoes = Echoes()
    if air.drops > 0.0:
        echoes = rain_echoes(air, key, ray, surface_range, echoes)
    if air.fog_from > 0.0:
        echoes = fog_echoes(air, key, ray, surface_range, origin, direction, time_s, echoes)
    return echoes
