"""Fields of antenna elements in directions, in float64."""

import warp as wp

from mmw.kernels.channel.complex_numbers import ONE, ZERO
from mmw.kernels.channel.path_geometry import azimuth_vector, between, direction_angles, zenith_vector
from mmw.kernels.core.compiler import AS_NUMPY

wp.set_module_options(AS_NUMPY)

ISO, DIPOLE, HW_DIPOLE, TR38901 = wp.constant(0), wp.constant(1), wp.constant(2), wp.constant(3)
"""Patterns of mmw, in the order of `mmw.channel.antennas.patterns.PatternName`."""
ON_AXIS = wp.constant(wp.float64(1e-9))
"""Size below which a sine or a component counts as 0."""
HALF_PI = wp.constant(wp.float64(1.5707963267948966))
"""pi / 2."""
BEAM = wp.constant(wp.float64(1.1344640137963142))
"""Beam width of a sector, 65 degrees [rad]."""


@wp.func
def pattern_amplitude(pattern: int, theta: wp.float64, phi: wp.float64) -> wp.float64:
    """Return the amplitude of an element of a pattern of mmw that is not slanted.

    Source: short dipole and dipole of half a wavelength along z, C. A. Balanis, Antenna Theory, sections 4.2 and 4.6;
    sector, 3GPP TR 38.901, table 7.3-1.
    """
    if pattern == DIPOLE:
        return wp.sqrt(wp.float64(1.5)) * wp.abs(wp.sin(theta))
    if pattern == HW_DIPOLE:
        sine = wp.sin(theta)
        if wp.abs(sine) < ON_AXIS:
            return ZERO
        return wp.sqrt(wp.float64(1.643)) * wp.abs(wp.cos(HALF_PI * wp.cos(theta)) / sine)
    if pattern == TR38901:
        up, across = (theta - HALF_PI) / BEAM, phi / BEAM
        vertical = wp.min(wp.float64(12.0) * up * up, wp.float64(30.0))
        horizontal = wp.min(wp.float64(12.0) * across * across, wp.float64(30.0))
        gain_db = wp.float64(8.0) - wp.min(vertical + horizontal, wp.float64(30.0))
        return wp.pow(wp.float64(10.0), gain_db / wp.float64(20.0))
    return ONE


@wp.func
def slant_components(slant: wp.float64, local: wp.vec2d, is_turned_in_space: bool) -> wp.vec2d:
    """Return the shares of the amplitude along the local theta and phi; `is_turned_in_space` is the model tr38901_1.

    Source: TR 38.901 section 7.3.2, equations 7.3-3 to 7.3-5.
    """
    cosine, sine = wp.cos(slant), wp.sin(slant)
    if not is_turned_in_space:
        return wp.vec2d(cosine, sine)
    sin_t, cos_t = wp.sin(local[0]), wp.cos(local[0])
    sin_p, cos_p = wp.sin(local[1]), wp.cos(local[1])
    along = cosine * cos_t - sine * sin_p * sin_t
    scale = wp.sqrt(wp.max(ONE - along * along, ZERO))
    if scale < ON_AXIS:
        scale = ONE
    return wp.vec2d((cosine * sin_t + sine * sin_p * cos_t) / scale, sine * cos_p / scale)


@wp.func
def local_angles(direction: wp.vec3d, rotation: wp.mat33d) -> wp.vec2d:
    """Return zenith and azimuth of a direction in an antenna's frame."""
    return direction_angles(wp.transpose(rotation) * direction)


@wp.func
def local_turn(local: wp.vec2d, world: wp.vec2d, rotation: wp.mat33d) -> wp.mat22d:
    """Return what turns components in an antenna's frame into those in the world's (theta, phi)."""
    own_0, own_1 = rotation * zenith_vector(local), rotation * azimuth_vector(local)
    return between(zenith_vector(world), azimuth_vector(world), own_0, own_1)


@wp.kernel
def pattern_kernel(
    theta: wp.array[wp.float64], phi: wp.array[wp.float64], pattern: int, amplitude_out: wp.array[wp.float64]
):
    """Write `pattern_amplitude` of each direction. Launch: dim=(N,)."""
    row = wp.tid()
    amplitude_out[row] = pattern_amplitude(pattern, theta[row], phi[row])


@wp.struct
class Directions:
    """Directions away from N antennas."""

    direction: wp.array[wp.vec3d]
    """Unit directions, world frame, shape [N]."""
    zenith: wp.array[wp.float64]
    """Their zenith in the world [rad], shape [N]."""
    azimuth: wp.array[wp.float64]
    """Their azimuth in the world [rad], shape [N]."""
    rotation: wp.array[wp.mat33d]
    """Antenna-to-world rotations, shape [N]."""


@wp.kernel
def pattern_field_kernel(
    away: Directions,
    slant: wp.array[wp.float64],
    pattern: int,
    is_turned_in_space: wp.bool,
    field_out: wp.array2d[wp.vec2d],
):
    """Write the field (theta, phi) in the world's basis of elements of a pattern of mmw, of some slants.

    Launch: dim=(N, elements).
    """
    row, element = wp.tid()
    local = local_angles(away.direction[row], away.rotation[row])
    shares = slant_components(slant[element], local, is_turned_in_space)
    turn = local_turn(local, wp.vec2d(away.zenith[row], away.azimuth[row]), away.rotation[row])
    field_out[row, element] = turn * (pattern_amplitude(pattern, local[0], local[1]) * shares)


@wp.kernel
def local_angles_kernel(
    away: Directions,
    local_out: wp.array[wp.vec2d],
    turn_out: wp.array[wp.mat22d],
):
    """Write `local_angles` and `local_turn` of each direction. Launch: dim=(N,)."""
    row = wp.tid()
    local = local_angles(away.direction[row], away.rotation[row])
    local_out[row] = local
    turn_out[row] = local_turn(local, wp.vec2d(away.zenith[row], away.azimuth[row]), away.rotation[row])


@wp.kernel
def slanted_field_kernel(
    amplitude: wp.array2d[wp.vec2d],
    local: wp.array[wp.vec2d],
    turn: wp.array[wp.mat22d],
    slant: wp.array[wp.float64],
    is_turned_in_space: wp.bool,
    field_out: wp.array3d[wp.vec2d],
):
    """Write the field (theta, phi) in the world's basis of elements of some slants, from the complex amplitudes (theta,
    phi) without a slant. Launch: dim=(N, elements)."""
    row, element = wp.tid()
    shares = slant_components(slant[element], local[row], is_turned_in_space)
    zenith, azimuth = amplitude[row, 0], amplitude[row, 1]
    along_zenith = zenith * shares[0] - azimuth * shares[1]
    along_azimuth = zenith * shares[1] + azimuth * shares[0]
    matrix = turn[row]
    for axis in range(2):
        field_out[row, element, axis] = matrix[axis, 0] * along_zenith + matrix[axis, 1] * along_azimuth
