"""Far field of antenna arrays in any direction: element pattern, polarization and precoding."""

import warp as wp

from mmw.kernels.core.compiler import DOUBLE_PRECISION

wp.set_module_options(DOUBLE_PRECISION)

PATTERN_DIPOLE = wp.constant(1)
"""Code of the short dipole along z; 0 is isotropic."""
PATTERN_HW_DIPOLE = wp.constant(2)
"""Code of the half-wave dipole along z."""
PATTERN_TR38901 = wp.constant(3)
"""Code of the sector element of 3GPP TR 38.901."""
PATTERN_TABLE = wp.constant(4)
"""Code of a pattern on a grid of directions."""


@wp.struct
class MapSources:
    """Transmitters of a map, all with one kind of array."""

    position: wp.array[wp.vec3d]
    """Middle of the array, scene frame [m], shape [T]."""
    rotation: wp.array[wp.mat33d]
    """Antenna to scene frame, shape [T]."""
    weight: wp.array2d[wp.vec2d]
    """Precoding weight (real, imaginary) of each antenna, of unit norm, shape [T, K]."""
    offset: wp.array[wp.vec3d]
    """Place of each antenna in the antenna's frame [wavelengths], shape [K]."""
    slant: wp.array[wp.float64]
    """Slant angle of each antenna, 0 for vertical [rad], shape [K]."""
    pattern: int
    """0 isotropic, or one of the `PATTERN_` codes."""
    turns_slant: wp.bool
    """True: model 1 of TR 38.901 (a slanted element turned in space); False: model 2 (one slant for all directions)."""
    table: wp.array2d[wp.vec4d]
    """Amplitudes of `PATTERN_TABLE` (real and imaginary of theta, then of phi), shape [R, F]; empty for the others."""
    table_theta: wp.array[wp.float64]
    """Zenith angles of the rows, increasing from 0 to pi [rad], shape [R]."""
    table_phi: wp.array[wp.float64]
    """Azimuths of the columns from the first one on, increasing from 0 to 2 pi [rad], shape [F + 1]."""
    table_start: wp.float64
    """Azimuth of the first column [rad]."""


@wp.struct
class RayField:
    """Field of a ray without spreading, scene frame; the complex vector is `real + j imag`."""

    real: wp.vec3d
    imag: wp.vec3d


@wp.func
def complex_product(a: wp.vec2d, b: wp.vec2d) -> wp.vec2d:
    """Return a b."""
    return wp.vec2d(a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0])


@wp.func
def pattern_amplitude(pattern: int, theta: wp.float64, phi: wp.float64) -> wp.float64:
    """Return the amplitude of an element; the same formulas as `mmw.channel.antennas.patterns.pattern_amplitude`."""
    half_pi = wp.float64(0.5 * wp.PI)
    amplitude = wp.float64(1.0)
    if pattern == PATTERN_DIPOLE:
        amplitude = wp.sqrt(wp.float64(1.5)) * wp.abs(wp.sin(theta))
    elif pattern == PATTERN_HW_DIPOLE:
        sine = wp.sin(theta)
        amplitude = wp.float64(0.0)
        if wp.abs(sine) >= wp.float64(1e-9):
            amplitude = wp.sqrt(wp.float64(1.643)) * wp.abs(wp.cos(half_pi * wp.cos(theta)) / sine)
    elif pattern == PATTERN_TR38901:
        beam = wp.float64(65.0 * wp.PI / 180.0)
        max_loss = wp.float64(30.0)
        up = (theta - half_pi) / beam
        aside = phi / beam
        vertical = wp.min(wp.float64(12.0) * up * up, max_loss)
        horizontal = wp.min(wp.float64(12.0) * aside * aside, max_loss)
        loss = wp.min(vertical + horizontal, max_loss)
        amplitude = wp.pow(wp.float64(10.0), (wp.float64(8.0) - loss) / wp.float64(20.0))
    return amplitude


@wp.func
def table_amplitudes(sources: MapSources, theta: wp.float64, phi: wp.float64) -> wp.vec4d:
    """Return the amplitudes of a pattern on a grid, bilinear as `mmw.channel.antennas.patterns.PatternTable`."""
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    turn = wp.float64(2.0) * wp.float64(wp.PI)
    rows = sources.table_theta.shape[0]
    columns = sources.table_phi.shape[0] - 1
    row = wp.clamp(wp.lower_bound(sources.table_theta, theta) - 1, 0, rows - 2)
    top = sources.table_theta[row]
    v = wp.clamp((theta - top) / (sources.table_theta[row + 1] - top), zero, one)
    turned = phi - sources.table_start
    turned = turned - turn * wp.floor(turned / turn)
    column = wp.clamp(wp.lower_bound(sources.table_phi, turned) - 1, 0, columns - 1)
    left = sources.table_phi[column]
    u = wp.clamp((turned - left) / (sources.table_phi[column + 1] - left), zero, one)
    after = (column + 1) % columns
    upper = (one - u) * sources.table[row, column] + u * sources.table[row, after]
    lower = (one - u) * sources.table[row + 1, column] + u * sources.table[row + 1, after]
    return (one - v) * upper + v * lower


@wp.func
def transmitted_field(sources: MapSources, source: int, direction: wp.vec3d) -> RayField:
    """Return the far field of a transmitter's array in a direction, without spreading.

    Source: 3GPP TR 38.901 section 7.3 for element and polarization; the synthetic array h^T p with the phases
    exp(+j 2 pi k . d / lambda), p not conjugated, as in Sionna RT 2.2.
    """
    rotation = sources.rotation[source]
    local = wp.transpose(rotation) * direction
    across = wp.sqrt(local[0] * local[0] + local[1] * local[1])
    theta = wp.atan2(across, local[2])
    phi = wp.where(across < wp.float64(1e-9), wp.float64(0.0), wp.atan2(local[1], local[0]))
    sin_t = wp.sin(theta)
    cos_t = wp.cos(theta)
    sin_p = wp.sin(phi)
    cos_p = wp.cos(phi)
    theta_hat = rotation * wp.vec3d(cos_t * cos_p, cos_t * sin_p, -sin_t)
    phi_hat = rotation * wp.vec3d(-sin_p, cos_p, wp.float64(0.0))
    amplitude = pattern_amplitude(sources.pattern, theta, phi)
    both = wp.vec4d()
    if sources.pattern == PATTERN_TABLE:
        both = table_amplitudes(sources, theta, phi)
    field = RayField()
    for antenna in range(sources.slant.shape[0]):
        turn = wp.float64(2.0 * wp.PI) * wp.dot(local, sources.offset[antenna])
        value = complex_product(sources.weight[source, antenna], wp.vec2d(wp.cos(turn), wp.sin(turn)))
        sin_s = wp.sin(sources.slant[antenna])
        cos_s = wp.cos(sources.slant[antenna])
        along = cos_s * theta_hat + sin_s * phi_hat
        if sources.turns_slant:
            axis = cos_s * cos_t - sin_s * sin_p * sin_t
            size = wp.sqrt(wp.max(wp.float64(1.0) - axis * axis, wp.float64(0.0)))
            if size < wp.float64(1e-9):
                size = wp.float64(1.0)
            along = ((cos_s * sin_t + sin_s * sin_p * cos_t) * theta_hat + sin_s * cos_p * phi_hat) / size
        if sources.pattern == PATTERN_TABLE:
            theta_part = complex_product(value, wp.vec2d(both[0], both[1]))
            phi_part = complex_product(value, wp.vec2d(both[2], both[3]))
            aside = wp.cross(direction, along)
            field.real = field.real + theta_part[0] * along + phi_part[0] * aside
            field.imag = field.imag + theta_part[1] * along + phi_part[1] * aside
        else:
            field.real = field.real + amplitude * value[0] * along
            field.imag = field.imag + amplitude * value[1] * along
    return field
