"""Make echoes of the paths of a mirror: where each is for the radar, which of them it resolves, and what they return.

Of a ray's target, four paths go out and come back on the direct leg d and the leg m over a mirror: dd, md, dm and mm.
Each is a point target at half of its length and half of its rate, in the direction of the leg that it comes back on.
Its amplitude is the product of those of its legs, so a target that scatters alike to all sides returns (1 + a)^2 of
what it would without the ground, a being the bounced leg over the direct one: the propagation factor F^4 of power.

Paths of one ray that are less than a resolution cell apart on every axis interfere: their amplitudes add up in the
first of them. The others are echoes of their own.

Source: L. Blake, "Prediction of radar range", in Skolnik, Radar Handbook (propagation factor); D. Barrick, "Rough
surface scattering based on the specular point theory", IEEE Trans. Antennas Propag. 16, 1968 (bistatic facets).
"""

import warp as wp

from mmw.kernels.radar.bounce_paths import BouncePaths
from mmw.kernels.radar.resolution_cells import CellGrid
from mmw.kernels.radar.trace import MIN_COSINE, MIN_RANGE, RadarHits, RadarLink, RadarRays

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})

PATH_DIRECT = wp.constant(0)
"""`RadarRays.path_type` of the direct echo, and of what interferes with it."""
PATH_GROUND = wp.constant(1)
"""Path over the ground that is resolved from the direct one."""
PATH_TYPE_1 = wp.constant(2)
"""Ghost that goes out over the mirror and comes back from the target: type 1, second order."""
PATH_TYPE_2 = wp.constant(3)
"""Ghost that goes out to the target and comes back over the mirror: type 2, second order."""
PATH_TYPE_2_THIRD = wp.constant(4)
"""Ghost that goes out and comes back over the mirror: type 2, third order, the image of the target."""

PATHS = wp.constant(4)
"""Paths of a ray and a mirror: dd, md, dm and mm."""


@wp.struct
class PathColumns:
    """Columns of the echoes of one mirror in `RadarRays`."""

    has_direct: int
    """1 if dd is one of them, in the column of its ray; ghosts have none, for another ray finds their target."""
    first: int
    """Column of the first ray's md; the others of a ray, and those of the next rays, follow."""
    md: int
    """Path types of the three echoes."""
    dm: int
    mm: int


@wp.func
def column_of(columns: PathColumns, ray: int, path: int) -> int:
    """Return the column of a path's echo."""
    column = ray
    if path > 0:
        column = columns.first + 3 * ray + path - 1
    return column


@wp.func
def is_mirrored(path: int, leg: int) -> bool:
    """Return whether a path goes out (leg 0) or comes back (leg 1) over the mirror."""
    return path == 3 or (path == 1 and leg == 0) or (path == 2 and leg == 1)


@wp.func
def leg_at(paths: BouncePaths, view: int, ray: int, is_bounced: bool) -> wp.vec4:
    """Return one of the two legs."""
    leg = paths.direct[view, ray]
    if is_bounced:
        leg = paths.bounced[view, ray]
    return leg


@wp.func
def has_path(paths: BouncePaths, columns: PathColumns, view: int, ray: int, path: int) -> bool:
    """Return whether a ray has a path: its target exists, and the direct leg is open if the path takes it."""
    if paths.object_id[view, ray] < 0 or (path == 0 and columns.has_direct == 0):
        return False
    return path == 3 or paths.direct[view, ray][0] > 0.0


@wp.func
def is_unresolved(a: wp.vec4, b: wp.vec4, grid: CellGrid) -> bool:
    """Return whether two echoes are less than a cell apart in range, velocity and both direction cosines."""
    gap = wp.vec4(wp.abs(a[0] - b[0]), wp.abs(a[1] - b[1]), wp.abs(a[2] - b[2]), wp.abs(a[3] - b[3]))
    is_near = gap[0] < grid.range_step and gap[1] < grid.velocity_step
    return is_near and gap[2] < grid.y_step and gap[3] < grid.z_step


@wp.kernel
def place_kernel(
    hits: RadarHits,
    paths: BouncePaths,
    columns: PathColumns,
    grid: CellGrid,
    merges: int,
    # out
    rays_out: RadarRays,
    lead_out: wp.array2d[wp.vec4i],
):
    """Write where the echoes of a mirror are, and in which of a ray's paths each is counted, -1 for none.

    With `merges` unresolved paths are counted in the first of them, else each in itself. Echoes that are counted
    elsewhere have no object.

    Launch: dim=(A, R).
    """
    view, ray = wp.tid()
    if columns.has_direct == 1:
        rays_out.range[view, ray] = hits.range[view, ray]
        rays_out.azimuth[view, ray] = hits.azimuth[view, ray]
        rays_out.elevation[view, ray] = hits.elevation[view, ray]
        rays_out.velocity[view, ray] = hits.velocity[view, ray]
        rays_out.object_id[view, ray] = hits.object_id[view, ray]
        rays_out.path_type[view, ray] = wp.uint8(PATH_DIRECT)
    lead = wp.vec4i(-1, -1, -1, -1)
    places = wp.matrix(shape=(4, 4), dtype=float)
    for path in range(PATHS):
        is_there = has_path(paths, columns, view, ray, path)
        if is_there:
            out = leg_at(paths, view, ray, is_mirrored(path, 0))
            back = leg_at(paths, view, ray, is_mirrored(path, 1))
            distance = 0.5 * (out[0] + back[0])
            rate = 0.5 * (out[3] + back[3])
            place = wp.vec4(distance, rate, wp.sin(back[1]) * wp.cos(back[2]), wp.sin(back[2]))
            places[path] = place
            lead[path] = path
            if merges == 1:
                for other in range(path):
                    if lead[path] == path and lead[other] == other and is_unresolved(place, places[other], grid):
                        lead[path] = other
            if path > 0:
                column = column_of(columns, ray, path)
                rays_out.range[view, column] = distance
                rays_out.azimuth[view, column] = back[1]
                rays_out.elevation[view, column] = back[2]
                rays_out.velocity[view, column] = rate
        if path > 0:
            column = column_of(columns, ray, path)
            kind = columns.md
            if path == 2:
                kind = columns.dm
            elif path == 3:
                kind = columns.mm
            rays_out.path_type[view, column] = wp.uint8(kind)
            rays_out.object_id[view, column] = -1
            if is_there and lead[path] == path:
                rays_out.object_id[view, column] = paths.object_id[view, ray]
            if not is_there:
                rays_out.range[view, column] = wp.inf
                rays_out.azimuth[view, column] = 0.0
                rays_out.elevation[view, column] = 0.0
                rays_out.velocity[view, column] = 0.0
    lead_out[view, ray] = lead


@wp.func
def product(a: wp.vec2, b: wp.vec2) -> wp.vec2:
    """Return the product of two complex numbers."""
    return wp.vec2(a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0])


@wp.func
def mirror_reflection(mirrors: wp.array2d[wp.vec4], material: int, mirror: wp.vec3) -> wp.vec2:
    """Return the complex reflection coefficient of the vertical polarization, for e^{+jwt}.

    Args:
        mirrors: TE and TM coefficients of the materials at cosines of incidence from 0 to 1, evenly.
        material: Material of the mirror.
        mirror: As `BouncePaths.mirror`.
    """
    last = mirrors.shape[1] - 1
    at = mirror[0] * float(last)
    low = wp.min(int(at), last - 1)
    part = at - float(low)
    both = (1.0 - part) * mirrors[material, low] + part * mirrors[material, low + 1]
    return wp.vec2(mirror[1] * both[0] + mirror[2] * both[2], mirror[1] * both[1] + mirror[2] * both[3])


@wp.func
def leg_amplitude(leg: wp.vec4, turns: float, link: RadarLink) -> wp.vec2:
    """Return antenna gain, spreading, loss and phase of a leg as one complex amplitude.

    The phase grows with the length, as that of the beat signal of an FMCW radar.
    """
    across = leg[1] / link.azimuth_beam
    upward = leg[2] / link.elevation_beam
    # A quarter of the exponent of both antennas' power is that of one antenna's amplitude.
    size = wp.exp(-1.3862943611198906 * (across * across + upward * upward)) / wp.max(leg[0], MIN_RANGE)
    size *= wp.exp(-0.25 * link.loss_per_m * leg[0])
    angle = 2.0 * wp.PI * turns
    return wp.vec2(size * wp.cos(angle), size * wp.sin(angle))


@wp.func
def bistatic_backscatter(surface: wp.vec3, cos_in: float, cos_out: float, cos_bisector: float) -> float:
    """Return the scattering coefficient of a rough surface between two directions, RCS per area [-].

    Facets reflect from one to the other if their normal is the bisector, which the same law of slopes weighs as
    backscatter does; Lambert's part follows both cosines. With both directions the same it is
    `mmw.kernels.radar.trace.backscatter`.
    """
    square = cos_bisector * cos_bisector
    facets = surface[0] * wp.exp(-surface[1] * (1.0 - square) / square) / (square * square)
    return facets + surface[2] * cos_in * cos_out


@wp.kernel
def path_echo_kernel(
    paths: BouncePaths,
    surface: wp.array[wp.vec3],
    mirrors: wp.array2d[wp.vec4],
    link: RadarLink,
    columns: PathColumns,
    lead: wp.array2d[wp.vec4i],
    # out
    rcs_out: wp.array2d[float],
    power_out: wp.array2d[float],
    turns_out: wp.array2d[float],
):
    """Evaluate power, RCS and phase of the echoes of a mirror in one weather.

    The patch of the target is what the ray covers on it: on the direct leg for the ground, on the bounced one for
    ghosts. The RCS is that of a target at the range of the echo which returns its power, without losses of the air.

    Launch: dim=(A, R).
    """
    view, ray = wp.tid()
    if paths.object_id[view, ray] < 0:
        return
    direct = paths.direct[view, ray]
    bounced = paths.bounced[view, ray]
    cosines = paths.cosines[view, ray]
    cos_direct = wp.max(cosines[0], MIN_COSINE)
    cos_bounced = wp.max(cosines[1], MIN_COSINE)
    cos_bisector = wp.max(cosines[2], MIN_COSINE)
    row = surface[paths.material_id[view, ray]]
    gamma = mirror_reflection(mirrors, paths.mirror_id[view, ray], paths.mirror[view, ray])
    turns = paths.turns[view, ray]
    direct_amplitude = leg_amplitude(direct, turns[0], link)
    # The beat signal has the conjugate phase of the wave.
    bounced_amplitude = product(leg_amplitude(bounced, turns[1], link), wp.vec2(gamma[0], -gamma[1]))
    reflected = wp.length_sq(gamma)

    area = link.solid_angle * bounced[0] * bounced[0] / cos_bounced
    if columns.has_direct == 1:
        area = link.solid_angle * direct[0] * direct[0] / cos_direct
    i_sum = wp.vec4()
    q_sum = wp.vec4()
    own_power = wp.vec4()
    own_rcs = wp.vec4()
    for path in range(PATHS):
        at = lead[view, ray][path]
        if at >= 0:
            coefficient = bistatic_backscatter(row, cos_direct, cos_bounced, cos_bisector)
            legs = product(direct_amplitude, bounced_amplitude)
            spread = direct[0] * bounced[0]
            distance = 0.5 * (direct[0] + bounced[0])
            share = reflected
            if path == 0:
                coefficient = bistatic_backscatter(row, cos_direct, cos_direct, cos_direct)
                legs = product(direct_amplitude, direct_amplitude)
                spread = direct[0] * direct[0]
                distance = direct[0]
                share = 1.0
            elif path == 3:
                coefficient = bistatic_backscatter(row, cos_bounced, cos_bounced, cos_bounced)
                legs = product(bounced_amplitude, bounced_amplitude)
                spread = bounced[0] * bounced[0]
                distance = bounced[0]
                share = reflected * reflected
            amplitude = wp.sqrt(link.constant * coefficient * area) * legs
            i_sum[at] += amplitude[0]
            q_sum[at] += amplitude[1]
            own_power[path] = wp.length_sq(amplitude)
            ratio = distance * distance / wp.max(spread, MIN_RANGE * MIN_RANGE)
            own_rcs[path] = coefficient * area * share * ratio * ratio
    for path in range(PATHS):
        if lead[view, ray][path] == path:
            column = column_of(columns, ray, path)
            power = i_sum[path] * i_sum[path] + q_sum[path] * q_sum[path]
            factor = 0.0
            if own_power[path] > 0.0:
                factor = power / own_power[path]
            phase = wp.atan2(q_sum[path], i_sum[path]) / (2.0 * wp.PI)
            power_out[view, column] = power
            rcs_out[view, column] = own_rcs[path] * factor
            turns_out[view, column] = phase - wp.floor(phase)


@wp.kernel
def direct_kernel(
    direct: wp.array2d[float],
    # out
    echo_out: wp.array2d[float],
):
    """Copy values of the direct echoes to their columns. Launch: dim=(A, R)."""
    view, ray = wp.tid()
    echo_out[view, ray] = direct[view, ray]
