"""Draw drops on a camera's lens: small lenses that show the scene upside down, blurred, with a dark rim."""

import warp as wp

from mmw.kernels.core.noise import uniform4

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": True})

SMALLEST = wp.constant(0.008)
LARGEST = wp.constant(0.045)
"""Radius of the drops over the image's width. Design values: drops of about a millimeter, millimeters from a lens."""

SEEN = wp.constant(0.42)
"""Half of what a drop shows, over the image's size. Design value; a drop is a wide-angle lens and shows nearly all."""

TAPS = wp.constant(3)
"""Places along each side of a drop's pixel that are averaged: it covers tens of pixels of the image."""

FOCUS = wp.constant(0.9)
"""Half of the width of a drop's image that a pixel averages, in pixels of the drop [px]. Design value."""

SOFT = wp.constant(0.25)
"""Share of the radius over which a drop fades at its rim: it is out of focus. Design value."""

RIM = wp.constant(0.75)
"""Share of the radius from which a drop darkens toward its rim, where light leaves it sideways. Design value."""


@wp.kernel
def lens_drops_kernel(
    key: wp.array[wp.vec2ui],
    width: int,
    height: int,
    # out
    drops_out: wp.array2d[wp.vec4],
):
    """Write drops on the lens: column, row and radius [px], and height over width, shape [A, N].

    Small ones are more frequent than large ones. Launch: dim=(A, N).
    """
    view, drop = wp.tid()
    draw = uniform4(key[view], drop, 0)
    radius = SMALLEST * wp.pow(LARGEST / SMALLEST, draw[2] * draw[2])
    drops_out[view, drop] = wp.vec4(
        draw[0] * float(width), draw[1] * float(height), radius * float(width), 1.0 + 0.25 * draw[3]
    )


@wp.func
def between_pixels(image: wp.array3d[wp.vec3], view: int, u: float, v: float) -> wp.vec3:
    """Return an image at any place, by the four nearest pixels; the outermost pixels go on beyond the edges.

    Args:
        image: Shape [A, H, W].
        view: View.
        u: Column [px], pixel centers at +0.5.
        v: Row [px].
    """
    x = wp.clamp(u - 0.5, 0.0, float(image.shape[2] - 1))
    y = wp.clamp(v - 0.5, 0.0, float(image.shape[1] - 1))
    left = wp.min(int(x), wp.max(image.shape[2] - 2, 0))
    top = wp.min(int(y), wp.max(image.shape[1] - 2, 0))
    right = wp.min(left + 1, image.shape[2] - 1)
    low = wp.min(top + 1, image.shape[1] - 1)
    a = x - float(left)
    b = y - float(top)
    upper = (1.0 - a) * image[view, top, left] + a * image[view, top, right]
    lower = (1.0 - a) * image[view, low, left] + a * image[view, low, right]
    return (1.0 - b) * upper + b * lower


@wp.func
def through_drops(image: wp.array3d[wp.vec3], drops: wp.array2d[wp.vec4], view: int, u: int, v: int) -> wp.vec4:
    """Return what a pixel sees where drops on the lens may lie: radiance, and 1 if one covers the pixel, else 0.

    The first drop of the list that covers a pixel counts. The rim is out of focus: over the outer part of a drop the
    pixel's own light mixes in.
    """
    for drop in range(drops.shape[1]):
        d = drops[view, drop]
        x = (float(u) + 0.5 - d[0]) / d[2]
        y = (float(v) + 0.5 - d[1]) / (d[2] * d[3])
        away = wp.sqrt(x * x + y * y)
        if away < 1.0:
            # A ball lens: what a point at `away` shows lies as far to the other side, ever faster toward the rim.
            bend = 0.5 * (1.0 + away * away)
            half_width = 0.5 * float(image.shape[2])
            half_height = 0.5 * float(image.shape[1])
            total = wp.vec3()
            for row in range(TAPS):
                for column in range(TAPS):
                    aside = (float(column) - 1.0) * FOCUS / d[2]
                    along = (float(row) - 1.0) * FOCUS / d[2]
                    total += between_pixels(
                        image,
                        view,
                        half_width - 2.0 * SEEN * half_width * (x * bend + aside),
                        half_height - 2.0 * SEEN * half_height * (y * bend + along),
                    )
            shown = total / float(TAPS * TAPS)
            rim = wp.clamp((away - RIM) / (1.0 - RIM), 0.0, 1.0)
            shown *= 1.0 - 0.7 * rim * rim
            soft = wp.clamp((1.0 - away) * d[2] / wp.max(SOFT * d[2], 1.0), 0.0, 1.0)
            own = image[view, v, u]
            light = own + soft * (shown - own)
            return wp.vec4(light[0], light[1], light[2], 1.0)
    return wp.vec4(0.0, 0.0, 0.0, 0.0)
