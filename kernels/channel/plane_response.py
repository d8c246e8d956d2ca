"""Reflection and transmission of flat surfaces: half-space, slab or perfect conductor, smooth or rough, in float64."""

import warp as wp

from mmw.kernels.channel.complex_numbers import ONE, ZERO, divide, exponential, multiply, real, square_root
from mmw.kernels.core.compiler import AS_NUMPY

wp.set_module_options(AS_NUMPY)

OPAQUE_NEPER = wp.constant(wp.float64(100.0))
"""A slab that weakens a wave more than this on one crossing, by 869 dB, lets nothing through [Np]: products of such
numbers would underflow."""


@wp.struct
class PlaneMaterials:
    """Materials of surfaces without layers, M of them, at C carriers."""

    permittivity: wp.array2d[wp.vec2d]
    """Complex relative permittivity, shape [M, C]."""
    thickness: wp.array[wp.float64]
    """Thickness of the slab [m], 0 for a half-space, shape [M]."""
    scattering: wp.array[wp.float64]
    """Scattering coefficient, shape [M]."""
    rms_height: wp.array[wp.float64]
    """Standard deviation of the heights [m], shape [M]."""
    wave_number: wp.array[wp.float64]
    """2 pi over the wavelength in vacuum [1/m], shape [C]."""


@wp.func
def interface_reflection(outside: wp.vec2d, inner: wp.vec2d) -> wp.vec2d:
    """Return the reflection r at an interface from the wave numbers across it on both sides."""
    total = outside + inner
    if total[0] == ZERO and total[1] == ZERO:  # vacuum at grazing incidence: nothing reflects
        total = real(ONE)
    return divide(outside - inner, total)


@wp.func
def interface_crossing(outside: wp.vec2d, inner: wp.vec2d) -> wp.vec2d:
    """Return 1 - r^2 of an interface: r^2 itself is too close to 1 at grazing angles."""
    total = outside + inner
    if total[0] == ZERO and total[1] == ZERO:
        total = real(ONE)
    return divide(multiply(wp.float64(4.0) * outside, inner), multiply(total, total))


@wp.func
def slab_coefficient(outside: wp.vec2d, inner: wp.vec2d, trip: wp.vec2d, is_through: bool) -> wp.vec2d:
    """Return the reflection of a slab, or its transmission, of one polarization.

    `outside` and `inner` are wave numbers across the surface over that of vacuum, for TM times the permittivity of the
    other side; `trip` is the factor e^{-jq} of one crossing.
    """
    crossing = interface_crossing(outside, inner)
    round_trip = multiply(trip, trip)
    lost = real(ONE) - round_trip
    echoes = lost + multiply(crossing, round_trip)
    if is_through:
        return divide(multiply(crossing, trip), echoes)
    return divide(multiply(interface_reflection(outside, inner), lost), echoes)


@wp.func
def slab_coefficients(
    permittivity: wp.vec2d, cosine: wp.float64, thickness: wp.float64, wave_number: wp.float64, is_through: bool
) -> wp.vec4d:
    """Return the reflection coefficients TE and TM, or those of transmission: real, imaginary part of each."""
    if wp.isinf(permittivity[0]) or wp.isinf(permittivity[1]):  # a perfect conductor
        if is_through:
            return wp.vec4d(ZERO, ZERO, ZERO, ZERO)
        return wp.vec4d(-ONE, ZERO, ONE, ZERO)
    inner = square_root(permittivity - real(ONE - cosine * cosine))
    if inner[1] > ZERO:  # the wave dies out inside, also without any loss
        inner = -inner
    if permittivity[0] == ONE and permittivity[1] == ZERO:
        inner = real(cosine)  # vacuum reflects exactly nothing: 1 - (1 - c^2) is only close to c^2
    phase = wave_number * thickness
    trip = real(ZERO)
    if thickness > ZERO and phase * inner[1] >= -OPAQUE_NEPER:
        trip = exponential(wp.vec2d(phase * inner[1], -phase * inner[0]))
    te = slab_coefficient(real(cosine), inner, trip, is_through)
    tm = slab_coefficient(cosine * permittivity, inner, trip, is_through)
    return wp.vec4d(te[0], te[1], tm[0], tm[1])


@wp.func
def mirror_share(
    scattering: wp.float64, rms_height: wp.float64, cosine: wp.float64, wave_number: wp.float64
) -> wp.float64:
    """Return the share of the reflected amplitude that a mirror keeps: sqrt(1 - S^2) exp(-2 (k s cos)^2)."""
    phase = wave_number * rms_height * cosine
    return wp.sqrt(ONE - scattering * scattering) * wp.exp(wp.float64(-2.0) * phase * phase)


@wp.kernel
def slab_kernel(
    permittivity: wp.array[wp.vec2d],
    cosine: wp.array[wp.float64],
    thickness: wp.array[wp.float64],
    wave_number: wp.array[wp.float64],
    is_through: wp.bool,
    coefficient_out: wp.array[wp.vec4d],
):
    """Write `slab_coefficients` of each row. Launch: dim=(N,)."""
    row = wp.tid()
    coefficient_out[row] = slab_coefficients(
        permittivity[row], cosine[row], thickness[row], wave_number[row], is_through
    )


@wp.kernel
def mirror_share_kernel(
    scattering: wp.array[wp.float64],
    rms_height: wp.array[wp.float64],
    cosine: wp.array[wp.float64],
    wave_number: wp.array[wp.float64],
    share_out: wp.array[wp.float64],
):
    """Write `mirror_share` of each row. Launch: dim=(N,)."""
    row = wp.tid()
    share_out[row] = mirror_share(scattering[row], rms_height[row], cosine[row], wave_number[row])
