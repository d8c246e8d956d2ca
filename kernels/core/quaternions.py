"""Quaternions (x, y, z, w) in float64: `mmw.core.transforms` for kernels, in the same order, so with the same bits."""

import warp as wp

from mmw.kernels.core.compiler import AS_NUMPY

wp.set_module_options(AS_NUMPY)


@wp.func
def vector_part(q: wp.vec4d) -> wp.vec3d:
    """Return the vector part of a quaternion."""
    return wp.vec3d(q[0], q[1], q[2])


@wp.func
def normalized(q: wp.vec4d) -> wp.vec4d:
    """Return a unit quaternion; NaN of a zero one."""
    return q / wp.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])


@wp.func
def conjugated(q: wp.vec4d) -> wp.vec4d:
    """Return the inverse rotation of a unit quaternion."""
    return wp.vec4d(-q[0], -q[1], -q[2], q[3])


@wp.func
def product(a: wp.vec4d, b: wp.vec4d) -> wp.vec4d:
    """Return the Hamilton product a b, the rotation b followed by a."""
    u = vector_part(a)
    v = vector_part(b)
    vector = a[3] * v + b[3] * u + wp.cross(u, v)
    return wp.vec4d(vector[0], vector[1], vector[2], a[3] * b[3] - (u[0] * v[0] + u[1] * v[1] + u[2] * v[2]))


@wp.func
def rotated(q: wp.vec4d, v: wp.vec3d) -> wp.vec3d:
    """Return a vector rotated by a unit quaternion."""
    axis = vector_part(q)
    twice = wp.float64(2.0) * wp.cross(axis, v)
    return v + q[3] * twice + wp.cross(axis, twice)


@wp.func
def rotation_vector(unit: wp.vec4d) -> wp.vec3d:
    """Return the shortest rotation vector (axis times angle [rad]) of a unit quaternion."""
    q = unit
    if q[3] < wp.float64(0.0):
        q = -q
    sine = wp.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    scale = wp.float64(2.0)  # the limit of angle / sine, to double precision
    if sine > wp.float64(1e-12):
        scale = wp.float64(2.0) * wp.atan2(sine, q[3]) / sine
    return vector_part(q) * scale
