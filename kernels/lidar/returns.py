"""Find the returns of traced LiDAR rays in one weather, and gather them in a list."""

import warp as wp

from mmw.kernels.core.noise import normal2, uniform4
from mmw.kernels.core.structs import Views
from mmw.kernels.lidar.precipitation import Air, air_echoes
from mmw.kernels.lidar.trace import LidarRays, Sweep, firing_offset, firing_pose

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False, "fuse_fp": False})

STEPS_PER_METRE = wp.constant(1024.0)
"""Grid of stored coordinates [1/m]: a power of two, so that float32 holds every grid point and compresses well."""
INTENSITY_STEPS = wp.constant(256.0)
"""Grid of stored intensities."""
NEAREST_M = wp.constant(1.0e-3)
"""Ranges below this count as this [m], so that a sensor on a surface divides by no zero."""

SURFACE_DRAW = wp.constant(100)
FIRST_DRAW = wp.constant(101)
LAST_DRAW = wp.constant(102)
CARLA_DRAW = wp.constant(100)
"""Draws of a ray's key; those below 100 belong to the echoes of the air."""

STRONGEST = wp.constant(0)
LAST = wp.constant(1)
DUAL = wp.constant(2)
"""Selection of the returns of a ray."""


@wp.struct
class LidarReturn:
    """One return of a ray."""

    range: float
    """Distance with its noise [m]."""
    intensity: float
    """Range-compensated power, 0 to 1."""
    label: int
    """0 surface, 1 rain, 2 fog."""


@wp.struct
class Detector:
    """Parameters that decide over a return in `physical`."""

    min_power: float
    """Weakest return [1/m2]."""
    kept_share: float
    """A surface below `min_power` still returns if the weather leaves this share of its power or more; inf: never."""
    range_resolution: float
    """Range noise is this over sqrt(2 SNR) [m]."""
    pulse_length: float
    """Two returns that are nearer than this cannot be told apart [m]."""
    overlap_start: float
    """Distance at which the receiver begins to see the beam [m]."""
    overlap_per_m: float
    """One over the distance in which it comes to see all of it [1/m]."""
    overlap_exponent: float
    """Power with which the share grows there."""
    returns: int
    """STRONGEST, LAST or DUAL."""


@wp.struct
class CarlaLidar:
    """CARLA's attributes."""

    attenuation: float
    """Decay of the intensity [1/m]."""
    general_loss: float
    """Share of rays that are lost before all else."""
    intensity_limit: float
    """Intensity above which nothing more is lost."""
    zero_loss: float
    """Share of returns of intensity 0 that is lost."""
    noise: float
    """Standard deviation of the range [m]."""


@wp.struct
class LidarPoints:
    """The N returns only, view by view, ray by ray, the strongest before the last, in one block of memory.

    x, y, z in the sensor frame on the stored grid [m] and intensity come first, shape [4, N], float32; then the object
    that was hit, -1 for rain and fog, shape [N], int32; for a rolling sweep the time of firing after the frame's
    instant [s], shape [N], float32; then ring, label, and number of the return if there may be two, shape [2 or 3, N],
    uint8. The arrays are three views of the block, as N is known on the device alone.
    """

    numbers: wp.array[float]
    ids: wp.array[int]
    marks: wp.array[wp.uint8]


@wp.func
def overlap(detector: Detector, distance: float) -> float:
    """Return the share of the beam that the receiver sees at a distance; see `mmw.sensors.lidar.precipitation`."""
    seen = wp.clamp((distance - detector.overlap_start) * detector.overlap_per_m, 0.0, 1.0)
    return wp.pow(seen, detector.overlap_exponent)


@wp.func
def range_noise(detector: Detector, key: wp.vec2ui, ray: int, draw: int, power: float) -> float:
    """Return the error of a measured range [m]: normal, of standard deviation resolution / sqrt(2 SNR), SNR >= 1.

    Source: V. Kilic et al., "Lidar Light Scattering Augmentation (LISA)", arXiv 2107.07004.
    """
    u = uniform4(key, ray, draw)
    snr = wp.max(power / detector.min_power, 1.0)
    return normal2(u[0], u[1])[0] * detector.range_resolution / wp.sqrt(2.0 * snr)


@wp.func
def received(
    detector: Detector, key: wp.vec2ui, ray: int, draw: int, range: float, power: float, label: int
) -> LidarReturn:
    """Return what the receiver makes of a power [1/m2] that comes back from a range [m]."""
    found = LidarReturn()
    found.range = wp.max(range + range_noise(detector, key, ray, draw, power), NEAREST_M)
    found.intensity = wp.rint(wp.clamp(power * range * range, 0.0, 1.0) * INTENSITY_STEPS) / INTENSITY_STEPS
    found.label = label
    return found


@wp.kernel
def physical_kernel(
    rays: LidarRays,
    views: Views,
    sweep: Sweep,
    time_s: wp.array[float],
    direction_s: wp.array[wp.vec3],
    reflectance: wp.array2d[float],
    air: Air,
    detector: Detector,
    key: wp.array[wp.vec2ui],
    # out
    returns_out: wp.array3d[LidarReturn],
    count_out: wp.array2d[int],
):
    """Find the returns of every ray in one weather. Launch: dim=(A, R).

    `reflectance` holds each material dry and as it is in the weather, shape [2, M]. A surface sends back
    P = rho cos(incidence) exp(-2 a R) / R^2; echoes of rain and fog before it come from `air_echoes`. These are weighed
    against what the receiver sees of P, as they hold its overlap themselves. Whether a surface returns at all does not
    depend on it: near ones are far above the threshold, and sensors adapt their laser power to them.

    Source: LiDAR equation of a Lambert target that fills the beam; for example W. Wagner, "Radiometric calibration of
    small-footprint full-waveform airborne laser scanner measurements", ISPRS J. Photogramm. 65(6), 2010.
    """
    view, ray = wp.tid()
    distance = rays.range[view, ray]
    own_key = key[view]
    power = wp.float32(0.0)
    is_surface = wp.bool(False)
    if distance < wp.inf:
        material = rays.material_id[view, ray]
        reach = wp.max(distance, NEAREST_M)
        attenuated = reflectance[1, material] * wp.exp(-2.0 * air.extinction * reach)
        power = attenuated * rays.cos_incidence[view, ray] / (reach * reach)
        is_surface = power > detector.min_power or attenuated >= detector.kept_share * reflectance[0, material]
    pose = firing_pose(views, sweep, view, ray)
    echoes = air_echoes(
        air,
        own_key,
        ray,
        distance,
        wp.transform_get_translation(pose),
        wp.transform_vector(pose, direction_s[ray]),
        time_s[view] + firing_offset(sweep, ray),
    )
    is_echo = echoes.strongest_label > 0
    seen = power * overlap(detector, distance)
    is_echo_stronger = is_echo and (echoes.strongest_power > seen or not is_surface)
    count = wp.int32(0)
    if detector.returns != LAST and is_echo_stronger:
        returns_out[view, ray, 0] = received(
            detector,
            own_key,
            ray,
            FIRST_DRAW,
            echoes.strongest_range,
            echoes.strongest_power,
            echoes.strongest_label,
        )
        count = 1
    last_range = echoes.last_range
    if is_surface:
        last_range = distance
    is_last_wanted = count == 0
    if count == 1 and detector.returns == DUAL:
        is_last_wanted = last_range - echoes.strongest_range > detector.pulse_length
    if is_last_wanted and is_surface:
        returns_out[view, ray, count] = received(detector, own_key, ray, SURFACE_DRAW, distance, power, 0)
        count += 1
    elif is_last_wanted and is_echo:
        returns_out[view, ray, count] = received(
            detector, own_key, ray, LAST_DRAW, echoes.last_range, echoes.last_power, echoes.last_label
        )
        count += 1
    count_out[view, ray] = count


@wp.kernel
def carla_kernel(
    rays: LidarRays,
    carla: CarlaLidar,
    key: wp.array[wp.vec2ui],
    # out
    returns_out: wp.array3d[LidarReturn],
    count_out: wp.array2d[int],
):
    """Find the returns of every ray as CARLA has them, in any weather. Launch: dim=(A, R).

    Intensity is exp(-rate d). A return at or below the limit stays with probability alpha I + 1 - zero, with alpha =
    zero / limit.

    Source: CARLA 0.9.15 `sensor.lidar.ray_cast`.
    """
    view, ray = wp.tid()
    distance = rays.range[view, ray]
    count_out[view, ray] = 0
    if distance == wp.inf:
        return
    u = uniform4(key[view], ray, CARLA_DRAW)
    if u[0] < carla.general_loss:
        return
    intensity = wp.exp(-carla.attenuation * distance)
    if intensity <= carla.intensity_limit:
        keep = 1.0 - carla.zero_loss + carla.zero_loss * intensity / carla.intensity_limit
        if u[1] >= keep:
            return
    found = LidarReturn()
    found.range = wp.max(distance + normal2(u[2], u[3])[0] * carla.noise, 0.0)
    found.intensity = wp.rint(intensity * INTENSITY_STEPS) / INTENSITY_STEPS
    found.label = 0
    returns_out[view, ray, 0] = found
    count_out[view, ray] = 1


@wp.kernel
def gather_kernel(
    rays: LidarRays,
    returns: wp.array3d[LidarReturn],
    count: wp.array2d[int],
    returns_up_to: wp.array2d[int],
    direction_s: wp.array[wp.vec3],
    views: Views,
    sweep: Sweep,
    is_deskewed: bool,
    # out
    points_out: LidarPoints,
    ends_out: wp.array[int],
):
    """Copy the returns of each ray to their place in the list, which the running count of returns gives.

    Positions are in the sensor's frame at the ray's firing, or if deskewed at the frame's instant. `ends_out` is the
    number of returns up to the end of each view. Launch: dim=(A, R).
    """
    view, ray = wp.tid()
    own = count[view, ray]
    up_to = returns_up_to[view, ray]
    total = returns_up_to[count.shape[0] - 1, count.shape[1] - 1]
    if ray == count.shape[1] - 1:
        ends_out[view] = up_to
    columns = wp.where(sweep.duration_s > 0.0, 6, 5)
    for k in range(own):
        found = returns[view, ray, k]
        point = up_to - own + k
        position = direction_s[ray] * found.range
        if is_deskewed:
            in_scene = wp.transform_point(firing_pose(views, sweep, view, ray), position)
            position = wp.transform_point(wp.transform_inverse(views.pose[view]), in_scene)
        for axis in range(3):
            points_out.numbers[axis * total + point] = wp.rint(position[axis] * STEPS_PER_METRE) / STEPS_PER_METRE
        points_out.numbers[3 * total + point] = found.intensity
        points_out.ids[4 * total + point] = wp.where(found.label == 0, rays.object_id[view, ray], -1)
        if columns == 6:
            points_out.numbers[5 * total + point] = firing_offset(sweep, ray)
        first = 4 * columns * total + point
        points_out.marks[first] = wp.uint8(ray // sweep.points_per_channel)
        points_out.marks[first + total] = wp.uint8(found.label)
        if returns.shape[2] > 1:
            points_out.marks[first + 2 * total] = wp.uint8(k)
