"""Draw falling drops near a camera, each as the streak that it leaves while the shutter is open.

A drop covers pi/4 D^2 of the image at every instant, so over the exposure it covers this area, in pixels, times its
path; spread along the streak that is the opacity (tau / T) of Garg and Nayar. Opacities add up in whole numbers, so
the order of the threads does not matter.

Source: K. Garg, S. K. Nayar, "Vision and Rain", International Journal of Computer Vision 75(1), 2007.
"""

import warp as wp

from mmw.kernels.camera.camera import FISHEYE, Camera, project_point
from mmw.kernels.core.compiler import FAST
from mmw.kernels.core.noise import normal2, uniform4
from mmw.kernels.core.structs import Views

wp.set_module_options(
    {"enable_backward": False, "default_grid_stride": False, "fast_math": True, "cpu_compiler_flags": FAST}
)

COVER_SCALE = wp.constant(16777216.0)
"""Whole number of an opacity of 1."""

NEAR_PLANE = wp.constant(0.02)
"""Depth from which on a drop before a pinhole is drawn [m]."""

COUNT_DRAW = wp.constant(1)
PLACE_DRAW = wp.constant(2)
"""Draws of a view's stream; the sensor noise uses another."""


@wp.struct
class Rain:
    """Drops around a camera: a ball's sector about the optical axis, evenly filled."""

    count: float
    """Mean number of drops in it [-]."""
    cos_reach: float
    """Cosine of the half angle of the sector [-]."""
    nearest: float
    """Nearest drop [m]."""
    range: float
    """Farthest drop [m]."""
    smallest: float
    """Smallest diameter [mm]."""
    largest: float
    """Largest diameter [mm]."""
    slope: float
    """Decay of the number of drops with their diameter [1/mm]."""
    wind: wp.vec3
    """Velocity of the air, scene frame [m/s]."""
    shutter: float
    """Exposure time [s]."""
    aperture: float
    """Diameter of the lens's opening: drops near it are out of focus [m]."""


@wp.func
def fall_speed(diameter: float) -> float:
    """Return the speed at which a drop falls in still air [m/s], of its diameter in mm.

    Source: D. Atlas, R. Srivastava, R. Sekhon, Rev. Geophys. Space Phys. 11, 1973, from R. Gunn, G. Kinzer, 1949.
    """
    return wp.max(9.65 - 10.3 * wp.exp(-0.6 * diameter), 0.0)


@wp.func
def pixels_per_metre(camera: Camera, point: wp.vec3) -> float:
    """Return the root of the image area [px] that a small square across the ray at a point covers, over its side."""
    distance = wp.length(point)
    ray = point / distance
    side = wp.vec3(-ray[1], ray[0], 0.0)
    if wp.abs(ray[2]) > 0.9:
        side = wp.vec3(-ray[2], 0.0, ray[0])
    side = wp.normalize(side)
    step = 0.01 * distance
    middle = project_point(camera, point)
    a = project_point(camera, point + step * side) - middle
    b = project_point(camera, point + step * wp.cross(ray, side)) - middle
    return wp.sqrt(wp.abs(a[0] * b[1] - a[1] * b[0])) / step


@wp.kernel
def streaks_kernel(
    views: Views,
    velocity: wp.array[wp.vec3],
    rate: wp.array[wp.vec3],
    key: wp.array[wp.vec2ui],
    camera: Camera,
    t: wp.array[float],
    rain: Rain,
    # out
    cover_out: wp.array3d[int],
):
    """Add the opacity of every drop's streak, times `COVER_SCALE`, to an image that starts at 0.

    Args:
        views: Camera poses.
        velocity: Velocity of each camera, scene frame [m/s].
        rate: Angular velocity of each camera about the axes of the scene frame [rad/s].
        key: Random numbers of each view.
        camera: The camera.
        t: Distance of what each pixel shows [m], row (view * H + v) * W + u: it hides drops behind it.
        rain: The drops.
        cover_out: Opacity, shape [A, H, W].

    Launch: dim=(A, N), N the most drops; views with fewer leave the last ones out.
    """
    view, batch_index = wp.tid()
    spread = uniform4(key[view], 0, COUNT_DRAW)
    present = rain.count + wp.sqrt(rain.count) * normal2(spread[0], spread[1])[0]
    if float(batch_index) + 0.5 > present:
        return
    place = uniform4(key[view], batch_index, PLACE_DRAW)
    distance = rain.range * wp.pow(place[2], 1.0 / 3.0)
    if distance < rain.nearest:
        return
    forward = 1.0 - place[0] * (1.0 - rain.cos_reach)
    aside = wp.sqrt(wp.max(1.0 - forward * forward, 0.0))
    turn = 2.0 * wp.PI * place[1]
    point = distance * wp.vec3(forward, aside * wp.cos(turn), aside * wp.sin(turn))
    diameter = wp.min(rain.smallest - wp.log(place[3]) / rain.slope, rain.largest)
    # How the drop moves against the camera: it falls and drifts, and the camera drives and turns.
    back = wp.quat_inverse(wp.transform_get_rotation(views.pose[view]))
    fall = wp.vec3(0.0, 0.0, -fall_speed(diameter))
    moving = wp.quat_rotate(back, rain.wind + fall - velocity[view])
    moving -= wp.cross(wp.quat_rotate(back, rate[view]), point)
    start = point - (0.5 * rain.shutter) * moving
    end = point + (0.5 * rain.shutter) * moving
    ahead = wp.min(wp.min(start[0], end[0]), point[0])
    if camera.model != FISHEYE and ahead < NEAR_PLANE:
        return
    first = project_point(camera, start)
    last = project_point(camera, end)
    scale = pixels_per_metre(camera, point)
    size = scale * 0.001 * diameter
    area = 0.25 * wp.PI * size * size
    blur = scale * rain.aperture
    width = wp.sqrt(size * size + blur * blur)

    # Pixels along the longer axis of the streak, and across it at each of them.
    span = last - first
    is_level = wp.abs(span[0]) >= wp.abs(span[1])
    if not is_level:
        span = wp.vec2(span[1], span[0])
        first = wp.vec2(first[1], first[0])
    length = wp.length(span)
    tangent = wp.where(wp.abs(span[0]) > 1.0e-3, span[1] / wp.where(span[0] == 0.0, 1.0, span[0]), 0.0)
    extent = wp.max(wp.abs(span[0]) + width, 1.0)
    across = wp.max(width * wp.where(wp.abs(span[0]) > 1.0e-3, length / wp.max(wp.abs(span[0]), 1.0e-3), 1.0), 1.0)
    # Both ends and both sides fade over a ramp, a pixel wide where the streak is thin; its sum stays the same.
    ramp = wp.max(width, 1.0)
    side_ramp = wp.max(0.5 * across, 1.0)
    middle = first[0] + 0.5 * span[0]
    center = first[1] + 0.5 * span[1]
    slant = tangent / (1.0 + tangent * tangent)
    columns = wp.where(is_level, camera.width, camera.height)
    rows = wp.where(is_level, camera.height, camera.width)
    reach = 0.5 * (extent + ramp) + wp.abs(slant) * 0.5 * (across + side_ramp)
    side_reach = 0.5 * (across + side_ramp)
    if middle + reach <= 0.0 or middle - reach >= float(columns):
        return
    opacity = area / (extent * across)
    for i in range(wp.max(int(middle - reach), 0), wp.min(int(wp.ceil(middle + reach)), columns)):
        along = float(i) + 0.5 - middle
        line = center + tangent * along
        for j in range(wp.max(int(line - side_reach), 0), wp.min(int(wp.ceil(line + side_reach)), rows)):
            off = float(j) + 0.5 - line
            share = wp.clamp((side_reach - wp.abs(off)) / side_ramp, 0.0, 1.0)
            share *= wp.clamp((0.5 * (extent + ramp) - wp.abs(along + slant * off)) / ramp, 0.0, 1.0)
            v = wp.where(is_level, j, i)
            u = wp.where(is_level, i, j)
            amount = int(COVER_SCALE * wp.min(opacity * share, 1.0))
            if amount > 0 and t[(view * camera.height + v) * camera.width + u] > distance:
                wp.atomic_add(cover_out, view, v, u, amount)
