"""Share parts of camera kernels: tiles of pixels, the ray through a pixel and the pixel of a point.

A lens maps a direction to plane coordinates q (pinhole and Brown-Conrady: tangents, right and down; fisheye: the angle
from the optical axis along both), distorts them, and scales them by the focal lengths. `mmw.core.camera_models` says
the same in float64.

Source: OpenCV 4 documentation, modules calib3d ("Camera calibration and 3D reconstruction") and fisheye; D. C. Brown,
"Close-range camera calibration", 1971; J. Kannala, S. S. Brandt, IEEE TPAMI 28(8), 2006.
"""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})

TILE = wp.constant(8)
"""Pixels on a side of the square that one block of 64 threads traces: neighbors traverse the same branches."""

PINHOLE = wp.constant(0)
BROWN_CONRADY = wp.constant(1)
FISHEYE = wp.constant(2)

RADIAL_STEPS = wp.constant(12)
"""Steps of the safeguarded Newton iteration for the radius: it halves the bracket where Newton would leave it."""

TANGENTIAL_STEPS = wp.constant(4)
"""Newton steps in both coordinates, from the radial solution; tangential terms are small."""

NEAREST = wp.constant(1.0e-6)
"""Depth over distance from which on a point counts as before a pinhole."""


@wp.struct
class Camera:
    """A camera; pixel (u, v) has its center at (u + 0.5, v + 0.5)."""

    width: int
    height: int
    fx: float
    """Focal length along the rows [px]."""
    fy: float
    """Focal length along the columns [px]."""
    cx: float
    """Column of the optical axis [px]."""
    cy: float
    """Row of the optical axis [px]."""
    range: float
    """Longest depth [m]."""
    model: int
    """`PINHOLE`, `BROWN_CONRADY` or `FISHEYE`."""
    radial: wp.vec4
    """Factors of q^2, q^4, q^6 and q^8 in the radial distortion."""
    rational: wp.vec3
    """Factors of q^2, q^4 and q^6 in its denominator."""
    tangential: wp.vec2
    """p1 and p2."""
    reach: float
    """Largest |q| of a pixel of the image; beyond it the distortion goes on linearly, so that nothing folds back."""


@wp.func
def radial_factor(camera: Camera, s: float) -> wp.vec2:
    """Return the radial distortion over |q|, and its derivative by s = |q|^2."""
    a = camera.radial
    b = camera.rational
    above = 1.0 + s * (a[0] + s * (a[1] + s * (a[2] + s * a[3])))
    slope_above = a[0] + s * (2.0 * a[1] + s * (3.0 * a[2] + s * 4.0 * a[3]))
    below = 1.0 + s * (b[0] + s * (b[1] + s * b[2]))
    slope_below = b[0] + s * (2.0 * b[1] + s * 3.0 * b[2])
    factor = above / below
    return wp.vec2(factor, (slope_above - factor * slope_below) / below)


@wp.func
def distort(camera: Camera, q: wp.vec2) -> wp.vec2:
    """Return the distorted plane coordinates of plane coordinates; beyond `reach` those of the edge, scaled."""
    length = wp.length(q)
    stretch = wp.max(length / camera.reach, 1.0)
    x = q[0] / stretch
    y = q[1] / stretch
    s = x * x + y * y
    factor = radial_factor(camera, s)[0]
    p1 = camera.tangential[0]
    p2 = camera.tangential[1]
    return stretch * wp.vec2(
        x * factor + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x), y * factor + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y
    )


@wp.func
def undistort(camera: Camera, target: wp.vec2) -> wp.vec2:
    """Return the plane coordinates whose distorted ones are `target`.

    The radial part alone first, by Newton's method within a bracket that shrinks (it cannot diverge); where there is a
    tangential part, Newton's method in both coordinates from there.

    Args:
        camera: The camera; one to one within its image (`mmw.core.camera_models.reach`).
        target: Distorted plane coordinates, of a point of the image.
    """
    wanted = wp.length(target)
    low = wp.float32(0.0)
    high = float(camera.reach)
    r = wp.min(wanted, camera.reach)
    for _step in range(RADIAL_STEPS):
        f = radial_factor(camera, r * r)
        error = r * f[0] - wanted
        if error > 0.0:
            high = r
        else:
            low = r
        following = r - error / (f[0] + 2.0 * r * r * f[1])
        if following < low or following > high:
            following = 0.5 * (low + high)
        r = following
    q = target * (r / wp.max(wanted, 1.0e-20))
    p1 = camera.tangential[0]
    p2 = camera.tangential[1]
    if p1 != 0.0 or p2 != 0.0:
        for _step in range(TANGENTIAL_STEPS):
            x = q[0]
            y = q[1]
            s = x * x + y * y
            f = radial_factor(camera, s)
            error_x = x * f[0] + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x) - target[0]
            error_y = y * f[0] + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y - target[1]
            xx = f[0] + 2.0 * x * x * f[1] + 2.0 * p1 * y + 6.0 * p2 * x
            xy = 2.0 * x * y * f[1] + 2.0 * p1 * x + 2.0 * p2 * y
            yy = f[0] + 2.0 * y * y * f[1] + 6.0 * p1 * y + 2.0 * p2 * x
            scale = 1.0 / (xx * yy - xy * xy)
            q -= scale * wp.vec2(yy * error_x - xy * error_y, xx * error_y - xy * error_x)
    return q


@wp.func
def camera_ray(camera: Camera, u: float, v: float) -> wp.vec3:
    """Return the unit direction through a point of the image, sensor frame (x along the optical axis, y left, z up).

    Depth along the axis is distance times its x, which is negative behind a fisheye.

    Args:
        camera: The camera.
        u: Column [px], pixel edges at whole numbers.
        v: Row [px], pixel edges at whole numbers.
    """
    q = wp.vec2((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy)
    if camera.model != PINHOLE:
        q = undistort(camera, q)
    if camera.model == FISHEYE:
        angle = wp.length(q)
        share = wp.where(angle > 1.0e-4, wp.sin(angle) / wp.max(angle, 1.0e-4), 1.0)
        return wp.normalize(wp.vec3(wp.cos(angle), -share * q[0], -share * q[1]))
    return wp.normalize(wp.vec3(1.0, -q[0], -q[1]))


@wp.func
def project_point(camera: Camera, point: wp.vec3) -> wp.vec2:
    """Return where a point lies in the image: column and row [px], pixel edges at whole numbers.

    The point may lie outside the image. It has no meaning behind the image plane of a camera that is no fisheye; test
    its x first.
    """
    across = wp.vec2(-point[1], -point[2])
    q = wp.vec2()
    if camera.model == FISHEYE:
        aside = wp.length(across)
        q = across * (wp.atan2(aside, point[0]) / wp.max(aside, 1.0e-20))
        if aside < 1.0e-4 * point[0]:
            q = across / point[0]
    else:
        q = across / wp.max(point[0], NEAREST * wp.length(point))
    if camera.model != PINHOLE:
        q = distort(camera, q)
    return wp.vec2(camera.cx + camera.fx * q[0], camera.cy + camera.fy * q[1])


@wp.func
def tile_column(tile: int, lane: int) -> int:
    """Return the column of the pixel that a lane of a tile's block traces; it may lie outside the image."""
    return tile * TILE + lane % TILE


@wp.func
def tile_row(tile: int, lane: int) -> int:
    """Return the row of the pixel that a lane of a tile's block traces; it may lie outside the image."""
    return tile * TILE + lane // TILE
