"""Make the poses that a stage has of the poses that are written into it, on the host in float64.

A stage turns quaternions into matrices, and a reader these into quaternions again, which costs the last bits; and it
has no quaternions where an actor is absent, which decides their signs. `mmw.generation.live.stage_poses` says how.
"""

import warp as wp

from mmw.kernels.core.compiler import AS_NUMPY

wp.set_module_options(AS_NUMPY)

MIN_LENGTH = wp.constant(wp.float64(1.0e-10))
"""Length of the vector part below which a quaternion is no turn: `GF_MIN_VECTOR_LENGTH` of `pxr/base/gf/limits.h`."""

DEGREES = wp.constant(wp.float64(180.0 / 3.141592653589793))
"""Degrees in a radian, and `RADIANS` the other way round: one product each, as in `pxr/base/gf/math.h`."""

RADIANS = wp.constant(wp.float64(3.141592653589793 / 180.0))


@wp.func
def orient_matrix(q: wp.vec4d) -> wp.mat33d:
    """Return the matrix of row vectors that an operation `xformOp:orient` of double precision makes of a quaternion.

    The operations of USD in their order: an axis and an angle in degrees, and of these a matrix.

    Source: `GfRotation::SetQuat` and `GetQuat` of `pxr/base/gf/rotation.cpp`, `GfMatrix4d::_SetRotateFromQuat` of
    `matrix4d.cpp`.
    """
    one = wp.float64(1.0)
    two = wp.float64(2.0)
    length = wp.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    if not length > MIN_LENGTH:
        return wp.identity(n=3, dtype=wp.float64)
    scale = one / length
    degrees = two * (wp.acos(wp.min(wp.max(q[3], -one), one)) * DEGREES)
    half = degrees * RADIANS / two
    sine = wp.sin(half)
    cosine = wp.cos(half)
    x = q[0] * scale * sine
    y = q[1] * scale * sine
    z = q[2] * scale * sine
    length = wp.sqrt(cosine * cosine + (x * x + y * y + z * z))
    scale = one / length
    x = x * scale
    y = y * scale
    z = z * scale
    w = cosine / length
    return wp.mat33d(
        one - two * (y * y + z * z),
        two * (x * y + z * w),
        two * (z * x - y * w),
        two * (x * y - z * w),
        one - two * (z * z + x * x),
        two * (y * z + x * w),
        two * (z * x + y * w),
        two * (y * z - x * w),
        one - two * (y * y + x * x),
    )


@wp.func
def product(a: wp.vec4d, b: wp.vec4d) -> wp.float64:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3]


@wp.func
def attitude_of(rows: wp.mat33d) -> wp.vec4d:
    """Return the attitude of a matrix of row vectors that are made orthonormal in their order, as `actor_poses` does.

    It has the bits of `mmw.core.transforms.quaternion_from_matrix`.
    """
    length = wp.sqrt(rows[0, 0] * rows[0, 0] + rows[0, 1] * rows[0, 1] + rows[0, 2] * rows[0, 2])
    along = rows[0, 0] * rows[1, 0] + rows[0, 1] * rows[1, 1] + rows[0, 2] * rows[1, 2]
    along = along / (length * length)
    yx = rows[1, 0] - rows[0, 0] * along
    yy = rows[1, 1] - rows[0, 1] * along
    yz = rows[1, 2] - rows[0, 2] * along
    width = wp.sqrt(yx * yx + yy * yy + yz * yz)
    yx = yx / width
    yy = yy / width
    yz = yz / width
    xx = rows[0, 0] / length
    xy = rows[0, 1] / length
    xz = rows[0, 2] / length
    zx = xy * yz - xz * yy
    zy = xz * yx - xx * yz
    zz = xx * yy - xy * yx
    trace = xx + yy + zz
    system = wp.mat44d(
        xx + xx - trace,
        yx + xy,
        zx + xz,
        yz - zy,
        xy + yx,
        yy + yy - trace,
        zy + yz,
        zx - xz,
        xz + zx,
        yz + zy,
        zz + zz - trace,
        xy - yx,
        yz - zy,
        zx - xz,
        xy - yx,
        trace,
    )
    longest = wp.int32(0)
    for column in range(1, 4):
        if system[column, column] > system[longest, longest]:
            longest = column
    unit = wp.vec4d()
    unit[longest] = wp.float64(1.0)
    # a sum with zeros, as that of NumPy: it makes 0 of -0, which the angles of boxes tell apart
    q = wp.vec4d(system[0, longest], system[1, longest], system[2, longest], system[3, longest]) + unit
    size = wp.sqrt(product(q, q))
    q = wp.vec4d(q[0] / size, q[1] / size, q[2] / size, q[3] / size)
    if q[3] < wp.float64(0.0):
        q = -q
    return q


@wp.kernel
def orient_kernel(
    q: wp.array[wp.vec4d],
    # out
    matrix_out: wp.array[wp.mat33d],
):
    """Make the matrices of unit quaternions. Launch: dim=N."""
    row = wp.tid()
    matrix_out[row] = orient_matrix(q[row])


@wp.kernel
def written_kernel(
    poses: wp.array3d[wp.float64],
    before: wp.array[wp.vec4d],
    skipped: int,
    with_matrices: bool,
    # out
    written_out: wp.array2d[wp.vec4d],
    matrix_out: wp.array2d[wp.mat33d],
):
    """Write the quaternions of rows as a stage has them, those of the row before where absent.

    Poses have shape [R, V, 7], NaN where absent; `before` are the quaternions of the row before the first, NaN for
    none. Matrices are those of the rows after the first `skipped`; absent bodies have some. Launch: dim=V.
    """
    body = wp.tid()
    last = before[body]
    for row in range(poses.shape[0]):
        q = wp.vec4d(poses[row, body, 3], poses[row, body, 4], poses[row, body, 5], poses[row, body, 6])
        if not wp.isnan(q[0]):
            length = wp.sqrt(product(q, q))
            q = wp.vec4d(q[0] / length, q[1] / length, q[2] / length, q[3] / length)
            if product(q, last) < wp.float64(0.0):
                q = -q
            last = q
        written_out[row, body] = last
        if with_matrices and row >= skipped:
            matrix_out[row - skipped, body] = orient_matrix(last)


@wp.kernel
def read_kernel(
    poses: wp.array3d[wp.float64],
    written: wp.array2d[wp.vec4d],
    matrix: wp.array2d[wp.mat33d],
    skipped: int,
    read_before: wp.array[wp.vec4d],
    side_before: wp.array[wp.float64],
    # out
    poses_out: wp.array3d[wp.float64],
    read_out: wp.array[wp.vec4d],
    side_out: wp.array[wp.float64],
):
    """Read poses of rows as a stage has them: attitudes with the signs that a reader gives them. NaN where absent.

    `poses`, `written` and `matrix` are those of `written_kernel`. `read_before` are the quaternions of the row before,
    NaN where absent; `side_before` is 1 where the reader's sign was that of the writer when the body was there last, -1
    where it was not, NaN where it has not been there. Launch: dim=V.
    """
    body = wp.tid()
    none = wp.float64(wp.nan)
    last = read_before[body]
    side = side_before[body]
    for index in range(matrix.shape[0]):
        row = skipped + index
        for axis in range(3):
            poses_out[index, body, axis] = poses[row, body, axis]
        q = wp.vec4d(none, none, none, none)
        if not wp.isnan(poses[row, body, 3]):
            q = attitude_of(matrix[index, body])
            if product(q, last) < wp.float64(0.0):
                q = -q
            own = wp.float64(1.0)
            if product(q, written[row, body]) < wp.float64(0.0):
                own = wp.float64(-1.0)
            if wp.isnan(last[0]) and wp.isfinite(side) and own != side:  # it is back
                q = -q
                own = side
            side = own
        last = q
        for axis in range(4):
            poses_out[index, body, 3 + axis] = q[axis]
    read_out[body] = last
    side_out[body] = side
