"""Polarimetric transfer of paths, and coefficients between antennas, in float64."""

import warp as wp

from mmw.kernels.channel.complex_numbers import ZERO, multiply
from mmw.kernels.channel.plane_response import PlaneMaterials, mirror_share, slab_coefficients
from mmw.kernels.channel.segments import SPECULAR, TRANSMISSION
from mmw.kernels.core.compiler import AS_NUMPY

wp.set_module_options(AS_NUMPY)


@wp.struct
class ComplexMatrix:
    """A complex 2x2 matrix."""

    re: wp.mat22d
    im: wp.mat22d


@wp.func
def turned(matrix: wp.mat22d, other: ComplexMatrix) -> ComplexMatrix:
    """Return the product of a real and a complex matrix."""
    out = ComplexMatrix()
    out.re = matrix * other.re
    out.im = matrix * other.im
    return out


@wp.func
def product(one: ComplexMatrix, other: ComplexMatrix) -> ComplexMatrix:
    """Return the product of two complex matrices."""
    out = ComplexMatrix()
    out.re = one.re * other.re - one.im * other.im
    out.im = one.re * other.im + one.im * other.re
    return out


@wp.func
def matrix_at(values: wp.array4d[wp.vec2d], path: int, carrier: int, step: int) -> ComplexMatrix:
    """Return a matrix of four numbers in the order of its rows."""
    out = ComplexMatrix()
    a, b = values[path, carrier, step, 0], values[path, carrier, step, 1]
    c, d = values[path, carrier, step, 2], values[path, carrier, step, 3]
    out.re = wp.mat22d(a[0], b[0], c[0], d[0])
    out.im = wp.mat22d(a[1], b[1], c[1], d[1])
    return out


@wp.func
def plane_matrix(
    kind: int, material: int, carrier: int, cosine: wp.float64, materials: PlaneMaterials
) -> ComplexMatrix:
    """Return the matrix of a reflection or transmission, 0 of another interaction.

    Source: ITU-R P.2040-4, equations 37, 43, 44; S after V. Degli-Esposti et al., IEEE Trans. AP 55(1), 2007.
    """
    out = ComplexMatrix()
    if kind & (SPECULAR | TRANSMISSION):
        pair = slab_coefficients(
            materials.permittivity[material, carrier],
            cosine,
            materials.thickness[material],
            materials.wave_number[carrier],
            kind == TRANSMISSION,
        )
        if kind == SPECULAR:
            pair = pair * mirror_share(
                materials.scattering[material], materials.rms_height[material], cosine, materials.wave_number[carrier]
            )
        out.re = wp.mat22d(pair[0], ZERO, ZERO, pair[2])
        out.im = wp.mat22d(pair[1], ZERO, ZERO, pair[3])
    return out


@wp.func
def coefficient(
    transfer: wp.array3d[wp.vec2d],
    path: int,
    carrier: int,
    from_theta: wp.vec2d,
    from_phi: wp.vec2d,
    to_theta: wp.vec2d,
    to_phi: wp.vec2d,
) -> wp.vec2d:
    """Return F_r^T transfer F_t of two elements."""
    first = multiply(transfer[path, carrier, 0], from_theta) + multiply(transfer[path, carrier, 1], from_phi)
    second = multiply(transfer[path, carrier, 2], from_theta) + multiply(transfer[path, carrier, 3], from_phi)
    return multiply(to_theta, first) + multiply(to_phi, second)


@wp.struct
class PathInteractions:
    """Interactions of P paths at C carriers."""

    kind: wp.array2d[int]
    """Kind of each interaction, 0 behind the last, shape [P, D]."""
    material: wp.array2d[int]
    """Material of each interaction, shape [P, D]."""
    cosine: wp.array2d[wp.float64]
    """Cosine of incidence, shape [P, D]."""
    turn: wp.array2d[wp.mat22d]
    """Matrices between the bases of interactions, shape [P, D + 1]."""
    factor: wp.array2d[wp.vec2d]
    """Factor of each path, shape [P, C]."""
    is_given: wp.array2d[wp.bool]
    """Whether an interaction has a given matrix, shape [P, D]; empty where none has."""
    given: wp.array4d[wp.vec2d]
    """Given matrices, shape [P, C, D, 4]."""
    arriving: wp.array3d[wp.vec2d]
    """Field that comes to the first interaction, shape [P, C, 4]; empty for that which leaves the transmitter."""
    fields: wp.array3d[wp.vec2d]
    """Fields of the antennas of transmitter and receiver, shape [P, 2, 2]; may be empty."""


@wp.kernel
def path_transfer_kernel(
    paths: PathInteractions,
    materials: PlaneMaterials,
    first: int,
    stop: int,
    transfer_out: wp.array3d[wp.vec2d],
    coefficient_out: wp.array2d[wp.vec2d],
):
    """Write the field behind the interactions `first` to `stop` of each path at each carrier, times its factor, and the
    coefficient between the antennas.

    An interaction that is given has its matrix, the others follow from the materials. Launch: dim=(P, C).
    """
    path, carrier = wp.tid()
    total = ComplexMatrix()
    if paths.arriving.shape[0] > 0:
        a, b = paths.arriving[path, carrier, 0], paths.arriving[path, carrier, 1]
        c, d = paths.arriving[path, carrier, 2], paths.arriving[path, carrier, 3]
        total.re = wp.mat22d(a[0], b[0], c[0], d[0])
        total.im = wp.mat22d(a[1], b[1], c[1], d[1])
    else:
        total.re = paths.turn[path, 0]
    for step in range(first, stop):
        if paths.kind[path, step] != 0:
            has_matrix = wp.bool(False)
            if paths.is_given.shape[0] > 0:
                has_matrix = paths.is_given[path, step]
            if has_matrix:
                total = product(matrix_at(paths.given, path, carrier, step), total)
            else:
                own = plane_matrix(
                    paths.kind[path, step], paths.material[path, step], carrier, paths.cosine[path, step], materials
                )
                total = product(own, total)
            total = turned(paths.turn[path, step + 1], total)
    scale = paths.factor[path, carrier]
    for row in range(2):
        for column in range(2):
            value = multiply(scale, wp.vec2d(total.re[row, column], total.im[row, column]))
            transfer_out[path, carrier, 2 * row + column] = value
    if paths.fields.shape[0] > 0:
        coefficient_out[path, carrier] = coefficient(
            transfer_out,
            path,
            carrier,
            paths.fields[path, 0, 0],
            paths.fields[path, 0, 1],
            paths.fields[path, 1, 0],
            paths.fields[path, 1, 1],
        )


@wp.kernel
def combine_kernel(
    receive: wp.array3d[wp.vec2d],
    transmit: wp.array3d[wp.vec2d],
    transfer: wp.array3d[wp.vec2d],
    coefficient_out: wp.array4d[wp.vec2d],
):
    """Write F_r^T transfer F_t of all pairs of elements of each path at each carrier. Launch: dim=(P, C)."""
    path, carrier = wp.tid()
    for column in range(transmit.shape[1]):
        for row in range(receive.shape[1]):
            coefficient_out[path, carrier, row, column] = coefficient(
                transfer,
                path,
                carrier,
                transmit[path, column, 0],
                transmit[path, column, 1],
                receive[path, row, 0],
                receive[path, row, 1],
            )
