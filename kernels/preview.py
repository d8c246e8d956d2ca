"""A quick look: the first surface of every pixel, in its material's colour under one sun. Not a camera sensor."""

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


@wp.func
def shade(
    scene: Scene, slot: int, origin: wp.vec3, direction: wp.vec3, t_max: float, sun: wp.vec3, color: wp.array[wp.vec3]
) -> wp.vec3:
    """Return the linear colour of a ray: Lambert surfaces, one sun with shadows, sky brighter to the horizon."""
    hit = closest_hit(scene, slot, origin, direction, t_max, -1)
    if hit.object_id < 0:
        height = wp.clamp(direction[2], 0.0, 1.0)
        return wp.vec3(0.55, 0.66, 0.80) * (1.0 - 0.6 * height)
    point = origin + direction * (hit.t * 0.99999) + hit.normal * 1.0e-3
    light = 0.35 + 0.15 * hit.normal[2]
    facing = wp.dot(hit.normal, sun)
    if facing > 0.0 and not is_blocked(scene, slot, point, sun, 500.0, -1):
        light = light + 0.85 * facing
    return color[hit.material_id] * light


@wp.kernel
def preview_kernel(
    scene: Scene,
    slot: int,
    lens: Lens,
    sun: wp.vec3,
    color: wp.array[wp.vec3],
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
                total = total + shade(scene, slot, lens.eye + offset, lens.forward, lens.t_max, sun, color)
            else:
                direction = wp.normalize(lens.forward + offset)
                total = total + shade(scene, slot, lens.eye, direction, lens.t_max, sun, color)
    image_out[row, column] = total / float(samples * samples)
