"""Trace the rays of CARLA's radar or of a grid over the field of view, and evaluate the power that returns."""

import warp as wp

from mmw.kernels.core.compiler import FINITE
from mmw.kernels.core.first_hits import store_hit
from mmw.kernels.core.noise import uniform4
from mmw.kernels.core.rigid_motion import surface_velocity
from mmw.kernels.core.structs import Scene, Views
from mmw.kernels.core.trace import TRACE_REGISTERS, closest_hit

wp.set_module_options(
    {"enable_backward": False, "default_grid_stride": False, "fast_math": False, "cpu_compiler_flags": FINITE}
)


@wp.struct
class RadarHits:
    """First hits of every ray of every view, shape [A, R]: geometry and motion, the same in every weather."""

    range: wp.array2d[float]
    """Distance [m], inf for none."""
    azimuth: wp.array2d[float]
    """Direction of the ray in the sensor frame, positive toward y, left [rad]."""
    elevation: wp.array2d[float]
    """Direction of the ray in the sensor frame, positive toward z, up [rad]."""
    velocity: wp.array2d[float]
    """Radial velocity relative to the sensor, positive while the distance grows [m/s]; 0 for none."""
    cos_incidence: wp.array2d[float]
    """Cosine of the angle between ray and surface normal, 0 to 1; 0 for none."""
    object_id: wp.array2d[int]
    """Object that is hit, -1 for none."""
    material_id: wp.array2d[int]
    """Its material, -1 for none."""


@wp.struct
class RadarRays:
    """The echoes of every ray in one weather, shape [A, R]. All but power and RCS is shared with `RadarHits`.

    With multipath a ray has further echoes, in the columns from R on; see `mmw.kernels.radar.echo_paths`.
    """

    range: wp.array2d[float]
    azimuth: wp.array2d[float]
    elevation: wp.array2d[float]
    velocity: wp.array2d[float]
    object_id: wp.array2d[int]
    power: wp.array2d[float]
    """Received power [W], both ways' losses by rain, fog, gas and wet radome included; 0 for none."""
    rcs: wp.array2d[float]
    """The ray's share of the radar cross section [m2], no losses included; 0 for none. An object's RCS is the sum."""
    turns: wp.array2d[float]
    """Phase of the echo in turns, which grows with the length of the path; no array where phases are not asked for."""
    path_type: wp.array2d[wp.uint8]
    """Path of the echo, a `PATH_*` of `mmw.kernels.radar.echo_paths`; no array without multipath."""


@wp.struct
class RadarGrid:
    """The field of view of `physical` in equal cells: even in azimuth and in the sine of elevation, one ray a cell."""

    columns: int
    """Cells side by side."""
    rows: int
    """Cells one above the other."""
    half_azimuth: float
    """Half of the horizontal field of view [rad]."""
    half_sine: float
    """Sine of half of the vertical field of view."""


@wp.struct
class RadarLink:
    """The radar equation of one weather, the same for every ray."""

    constant: float
    """Pt Gt Gr wavelength^2 / (4 pi)^3 on boresight, times what a wet radome lets through [W m2]."""
    solid_angle: float
    """Solid angle of a ray [sr]."""
    loss_per_m: float
    """Exponent of the air's loss, both ways [Np of power per meter of distance]."""
    azimuth_beam: float
    """Half-power width of an antenna [rad]."""
    elevation_beam: float
    """Half-power width of an antenna [rad]."""


MIN_COSINE = wp.constant(1.0e-3)
"""Cosine of incidence that grazing rays are raised to: 0.06 deg from the surface, where its echo is nothing anyway."""

MIN_RANGE = wp.constant(0.01)
"""Distance that shorter ones are raised to [m], so that the power stays finite."""


@wp.func
def trace_ray(
    scene: Scene,
    views: Views,
    velocity: wp.array[wp.vec3],
    is_rigid: bool,
    view: int,
    ray: int,
    direction_s: wp.vec3,
    t_max: float,
    hits_out: RadarHits,
):
    """Trace one ray and store what it hits.

    Args:
        scene: Town and vehicles.
        views: Sensor poses.
        velocity: Velocity of each view's sensor, scene frame [m/s].
        is_rigid: Whether a surface moves as the point of a rigid body or wheel that it is, or as its actor's origin.
        view: View of the ray.
        ray: Number of the ray.
        direction_s: Unit direction, sensor frame.
        t_max: Length of the ray [m].
        hits_out: Where to store.
    """
    pose = views.pose[view]
    batch_index = views.batch_index[view]
    origin = wp.transform_get_translation(pose)
    direction = wp.transform_vector(pose, direction_s)
    hit = closest_hit(scene, batch_index, origin, direction, t_max, views.ignore[view])
    store_hit(hits_out, view, ray, hit, direction)
    radial = 0.0
    if hit.object_id >= 0:
        surface = wp.vec3()
        if is_rigid:
            surface = surface_velocity(scene, batch_index, hit.instance, hit.face, origin + hit.t * direction)
        elif hit.instance >= 0:
            surface = scene.instance_velocity[batch_index, hit.instance]
        radial = wp.dot(surface - velocity[view], direction)
    hits_out.azimuth[view, ray] = wp.atan2(direction_s[1], direction_s[0])
    hits_out.elevation[view, ray] = wp.asin(wp.clamp(direction_s[2], -1.0, 1.0))
    hits_out.velocity[view, ray] = radial


@wp.kernel(cuda_max_registers=TRACE_REGISTERS)
def carla_kernel(
    scene: Scene,
    views: Views,
    velocity: wp.array[wp.vec3],
    key: wp.array[wp.vec2ui],
    plane: wp.vec3,
    # out
    hits_out: RadarHits,
):
    """Trace CARLA's rays: to points of the plane x = range, at radius u of an ellipse, so dense in its middle.

    `plane` is the distance of the plane and the half axes of the ellipse along y and z [m]. A ray ends at the plane.
    CARLA's y points right; the angle is uniform, so the mirrored y has the same distribution.

    Launch: dim=(A, R), block_dim=64.
    """
    view, ray = wp.tid()
    u = uniform4(key[view], ray, 0)
    angle = 2.0 * wp.PI * u[1]
    end = wp.vec3(plane[0], -plane[1] * u[0] * wp.cos(angle), plane[2] * u[0] * wp.sin(angle))
    t_max = wp.length(end)
    trace_ray(scene, views, velocity, False, view, ray, end / t_max, t_max, hits_out)


@wp.func
def grid_direction(key: wp.vec2ui, grid: RadarGrid, ray: int) -> wp.vec3:
    """Return the unit direction of a ray, somewhere in its cell of the grid, in the sensor frame."""
    u = uniform4(key, ray, 0)
    column = (float(ray % grid.columns) + u[0]) / float(grid.columns)
    row = (float(ray // grid.columns) + u[1]) / float(grid.rows)
    # Azimuth grows to the left, the columns to the right.
    azimuth = grid.half_azimuth * (1.0 - 2.0 * column)
    sine = grid.half_sine * (2.0 * row - 1.0)
    level = wp.sqrt(1.0 - sine * sine)
    return wp.vec3(level * wp.cos(azimuth), level * wp.sin(azimuth), sine)


@wp.kernel(cuda_max_registers=TRACE_REGISTERS)
def grid_kernel(
    scene: Scene,
    views: Views,
    velocity: wp.array[wp.vec3],
    key: wp.array[wp.vec2ui],
    grid: RadarGrid,
    t_max: float,
    # out
    hits_out: RadarHits,
):
    """Trace one ray somewhere in each cell of the grid, row by row from below. Launch: dim=(A, R), block_dim=64."""
    view, ray = wp.tid()
    direction = grid_direction(key[view], grid, ray)
    trace_ray(scene, views, velocity, True, view, ray, direction, t_max, hits_out)


@wp.func
def backscatter(surface: wp.vec3, cosine: float) -> float:
    """Return the backscatter coefficient s0 of a rough surface, RCS per area [-].

    |G|^2 exp(-tan^2 / 2 s^2) / (2 s^2 cos^4) of facets that reflect the wave, and 4 rho cos^2 of a Lambert surface.

    Args:
        surface: |G|^2 / 2 s^2, 1 / 2 s^2 and 4 rho, from `mmw.sensors.radar.reflectivity`.
        cosine: Cosine of incidence, above 0.

    Source: D. Barrick, "Rough surface scattering based on the specular point theory", IEEE Trans. Antennas Propag. 16,
    1968; the second term is Lambert's law in both directions.
    """
    square = cosine * cosine
    facets = surface[0] * wp.exp(-surface[1] * (1.0 - square) / square) / (square * square)
    return facets + surface[2] * square


@wp.kernel
def echo_kernel(
    hits: RadarHits,
    surface: wp.array[wp.vec3],
    link: RadarLink,
    # out
    rcs_out: wp.array2d[float],
    power_out: wp.array2d[float],
):
    """Evaluate the radar equation of every ray in one weather, for beams of Gaussian shape.

    Launch: dim=(A, R), block_dim=64.
    """
    view, ray = wp.tid()
    rcs = 0.0
    power = 0.0
    if hits.object_id[view, ray] >= 0:
        distance = wp.max(hits.range[view, ray], MIN_RANGE)
        cosine = wp.max(hits.cos_incidence[view, ray], MIN_COSINE)
        area = distance * distance * link.solid_angle / cosine
        rcs = backscatter(surface[hits.material_id[view, ray]], cosine) * area
        across = hits.azimuth[view, ray] / link.azimuth_beam
        upward = hits.elevation[view, ray] / link.elevation_beam
        # exp(-4 ln 2 x^2) is one half at half the width; once for the transmitter and once for the receiver.
        gains = wp.exp(-5.545177444479562 * (across * across + upward * upward))
        power = link.constant * gains * rcs / wp.pow(distance, 4.0) * wp.exp(-link.loss_per_m * distance)
    rcs_out[view, ray] = rcs
    power_out[view, ray] = power
