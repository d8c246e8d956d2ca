"""A quick look: the first surface of every pixel, in its material's colour under sun and sky. Not a camera sensor."""

import warp as wp

from mmw.kernels.structs import Scene
from mmw.kernels.trace import closest_hit, is_blocked

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": True})


@wp.struct
class Lens:
    """Where a preview looks from, scene frame."""

    eye: wp.vec3
    """Middle of the image plane, or the pinhole [m]."""
    forward: wp.vec3
    """Unit direction of view."""
    right: wp.vec3
    """One pixel to the right: a direction for a pinhole, metres for a parallel view."""
    down: wp.vec3
    """One pixel down, like `right`."""
    is_parallel: wp.bool
    """True for a parallel view such as a map, False for a pinhole."""
    t_max: float
    """Longest distance [m]."""


@wp.struct
class Light:
    """Light and surfaces of a preview."""

    sun: wp.vec3
    """Unit direction to the sun."""
    color: wp.array[wp.vec3]
    """Linear colour of each material."""
    mirror: wp.array[float]
    """Reflectance of each material at normal incidence, 0 for a matt one."""
    haze_m: float
    """Distance over which the air takes 63 % of the contrast [m]."""


@wp.func
def sky(direction: wp.vec3) -> wp.vec3:
    """Return the linear colour of the sky: blue above, pale at the horizon, dim below it."""
    height = wp.clamp(direction[2], 0.0, 1.0)
    haze = wp.pow(1.0 - height, 3.0)
    color = wp.vec3(0.16, 0.34, 0.72) * (1.0 - haze) + wp.vec3(0.72, 0.80, 0.88) * haze
    if direction[2] < 0.0:
        color = color * wp.max(1.0 + 1.5 * direction[2], 0.6)
    return color


@wp.func
def surface(scene: Scene, slot: int, point: wp.vec3, normal: wp.vec3, color: wp.vec3, sun: wp.vec3) -> wp.vec3:
    """Return the linear colour of a matt surface: sky from above, the ground's glow from below, and a sun that casts
    shadows."""
    up = 0.5 + 0.5 * normal[2]
    light = wp.vec3(0.46, 0.54, 0.66) * up + wp.vec3(0.24, 0.22, 0.19) * (1.0 - up)
    facing = wp.dot(normal, sun)
    if facing > 0.0 and not is_blocked(scene, slot, point, sun, 500.0, -1):
        light = light + wp.vec3(1.15, 1.05, 0.90) * facing
    return wp.cw_mul(color, light)


@wp.func
def shade(scene: Scene, slot: int, origin: wp.vec3, direction: wp.vec3, t_max: float, light: Light) -> wp.vec3:
    """Return the linear colour of a ray; what is far pales into the haze, and glass mirrors once (Schlick)."""
    hit = closest_hit(scene, slot, origin, direction, t_max, -1)
    result = sky(direction)
    if hit.object_id >= 0:
        point = origin + direction * (hit.t * 0.99999) + hit.normal * 1.0e-3
        color = surface(scene, slot, point, hit.normal, light.color[hit.material_id], light.sun)
        mirror = light.mirror[hit.material_id]
        if mirror > 0.0:
            slant = wp.dot(hit.normal, direction)
            away = direction - 2.0 * slant * hit.normal
            share = mirror + (1.0 - mirror) * wp.pow(1.0 + slant, 5.0)
            image = sky(away)
            far = closest_hit(scene, slot, point, away, t_max, -1)
            if far.object_id >= 0:
                there = point + away * (far.t * 0.99999) + far.normal * 1.0e-3
                image = surface(scene, slot, there, far.normal, light.color[far.material_id], light.sun)
            color = color * (1.0 - share) + image * share
        clear = wp.exp(-hit.t / light.haze_m)
        result = color * clear + wp.vec3(0.72, 0.80, 0.88) * (1.0 - clear)
    return result


@wp.kernel
def preview_kernel(
    scene: Scene,
    slot: int,
    lens: Lens,
    light: Light,
    samples: int,
    # out
    image_out: wp.array2d[wp.vec3],
):
    """Average a grid of samples x samples rays in every pixel.

    Launch: dim=(H, W), block_dim=64.
    """
    row, column = wp.tid()
    height, width = image_out.shape[0], image_out.shape[1]
    total = wp.vec3(0.0, 0.0, 0.0)
    for i in range(samples):
        for j in range(samples):
            u = float(column) - 0.5 * float(width) + (float(i) + 0.5) / float(samples)
            v = float(row) - 0.5 * float(height) + (float(j) + 0.5) / float(samples)
            offset = lens.right * u + lens.down * v
            if lens.is_parallel:
                total = total + shade(scene, slot, lens.eye + offset, lens.forward, lens.t_max, light)
            else:
                direction = wp.normalize(lens.forward + offset)
                total = total + shade(scene, slot, lens.eye, direction, lens.t_max, light)
    image_out[row, column] = total / float(samples * samples)
