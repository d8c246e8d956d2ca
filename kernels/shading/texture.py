"""Filter textures over the footprint of a pixel: mip levels, and taps along a long footprint."""

import warp as wp

from mmw.kernels.shading.structs import AppearanceTable, Texture, TextureUse

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": True})

REPEAT = wp.constant(0)
CLAMP = wp.constant(1)
MIRROR = wp.constant(2)
BLACK = wp.constant(3)
"""Wraps by number, as in `TextureUse.wrap_u`."""

MAX_TAPS = wp.constant(4)
"""Taps along the long axis of a footprint of a color; normals, roughness and the like get one. Design value: a road
seen at 14 degrees or steeper stays sharp."""

FINE_LEVEL = wp.constant(5.0)
"""Mip level from which normals, roughness and the like fade to their mean, which alone counts one level on: a pixel is
then 64 texels long, 0.25 m and more on what towns are made of, and their variation within it is gone. Design value."""

MIN_TEXELS = wp.constant(1.0e-6)
MAX_TEXELS = wp.constant(1.0e6)
"""Sides of a footprint count as at least and at most this [texels], so that their ratio and logarithm are finite."""


@wp.struct
class AxisTaps:
    """The two texels along one axis that a linear filter reads, and their weights."""

    low: int
    high: int
    low_weight: float
    high_weight: float


@wp.func
def wrap_coordinate(u: float, wrap: int) -> float:
    """Return a texture coordinate that lies in or near 0 to 1 and reads the same: large ones lose no digits later."""
    wrapped = u
    if wrap == REPEAT:
        wrapped = u - wp.floor(u)
    elif wrap == MIRROR:
        turn = u - 2.0 * wp.floor(0.5 * u)
        wrapped = wp.where(turn > 1.0, 2.0 - turn, turn)
    else:
        wrapped = wp.clamp(u, -1.0, 2.0)
    return wrapped


@wp.func
def axis_taps(u: float, count: int, wrap: int) -> AxisTaps:
    """Return what a linear filter reads at a coordinate of `wrap_coordinate`; texel i has its center at (i + 0.5) / n.

    Args:
        u: Texture coordinate.
        count: Texels along the axis.
        wrap: Which of the wraps; beyond a mirrored or clamped edge lies the texel at that edge.
    """
    x = u * float(count) - 0.5
    base = wp.floor(x)
    taps = AxisTaps()
    taps.high_weight = x - base
    taps.low_weight = 1.0 - taps.high_weight
    low = int(base)
    high = low + 1
    last = count - 1
    if wrap == REPEAT:
        taps.low = wp.where(low < 0, low + count, wp.min(low, last))
        taps.high = wp.where(high > last, high - count, wp.max(high, 0))
    else:
        if wrap == BLACK:
            taps.low_weight = wp.where(low < 0 or low > last, 0.0, taps.low_weight)
            taps.high_weight = wp.where(high < 0 or high > last, 0.0, taps.high_weight)
        taps.low = wp.clamp(low, 0, last)
        taps.high = wp.clamp(high, 0, last)
    return taps


@wp.func
def texel(table: AppearanceTable, index: int) -> wp.vec4:
    """Return one texel."""
    value = wp.cast(table.texels[index], wp.vec4h)
    return wp.vec4(float(value[0]), float(value[1]), float(value[2]), float(value[3]))


@wp.func
def level_value(
    table: AppearanceTable, first: int, width: int, height: int, u: float, v: float, wrap_u: int, wrap_v: int
) -> wp.vec4:
    """Return the bilinear value of one mip level, whose texels begin at `first`."""
    across = axis_taps(u, width, wrap_u)
    upward = axis_taps(v, height, wrap_v)
    low = first + upward.low * width
    high = first + upward.high * width
    return (
        texel(table, low + across.low) * (across.low_weight * upward.low_weight)
        + texel(table, low + across.high) * (across.high_weight * upward.low_weight)
        + texel(table, high + across.low) * (across.low_weight * upward.high_weight)
        + texel(table, high + across.high) * (across.high_weight * upward.high_weight)
    )


@wp.func
def level_place(texture: Texture, level: int) -> tuple[int, int, int]:
    """Return first texel, width and height of a mip level."""
    first = texture.first
    width = texture.width
    height = texture.height
    for _ in range(level):
        first += width * height
        width = wp.max(width >> 1, 1)
        height = wp.max(height >> 1, 1)
    return first, width, height


@wp.func
def in_texels(used: TextureUse, size: wp.vec2, side: wp.vec2) -> wp.vec2:
    """Return a side of a footprint in texels of a texture of some size."""
    return wp.vec2(
        wp.clamp((used.row_u[0] * side[0] + used.row_u[1] * side[1]) * size[0], -MAX_TEXELS, MAX_TEXELS),
        wp.clamp((used.row_v[0] * side[0] + used.row_v[1] * side[1]) * size[1], -MAX_TEXELS, MAX_TEXELS),
    )


@wp.func
def sample_texture(table: AppearanceTable, use: int, st: wp.vec2, ds: wp.vec2, dt: wp.vec2, max_taps: int) -> wp.vec4:
    """Return the filtered value of a texture over the footprint of a pixel, after scale and bias of its use.

    The footprint is a parallelogram. Up to `max_taps` trilinear taps lie along its longer side; each is as wide as the
    shorter side, or as the share of a tap where the footprint is longer than they reach. After L. Williams, "Pyramidal
    parametrics", SIGGRAPH 1983, and J. McCormack et al., "Feline: fast elliptical lines for anisotropic texture
    mapping", SIGGRAPH 1999.

    Args:
        table: Textures and their uses.
        use: Row of `AppearanceTable.uses`, >= 0.
        st: Texture coordinates of the mesh in the middle of the pixel.
        ds: One side of the footprint in those coordinates.
        dt: Another side.
        max_taps: `MAX_TAPS` for what the eye follows, 1 for the rest.
    """
    used = table.uses[use]
    texture = table.textures[used.texture]
    across = used.row_u
    upward = used.row_v
    size = wp.vec2(float(texture.width), float(texture.height))
    a = in_texels(used, size, ds)
    b = in_texels(used, size, dt)
    long_axis = wp.where(wp.dot(a, a) > wp.dot(b, b), a, b)
    length = wp.max(wp.length(long_axis), MIN_TEXELS)
    breadth = wp.max(wp.abs(a[0] * b[1] - a[1] * b[0]) / length, MIN_TEXELS)
    taps = wp.clamp(int(length / breadth + 0.5), 1, max_taps)
    top = texture.levels - 1
    level = wp.clamp(wp.log2(wp.max(breadth, length / float(taps))), 0.0, float(top))
    if level <= 0.0:
        taps = wp.clamp(int(length + 0.5), 1, taps)  # magnified: one tap a texel is enough

    mean_share = wp.float32(0.0)
    if max_taps == 1:
        mean_share = wp.clamp(level - FINE_LEVEL, 0.0, 1.0)
        if mean_share == 1.0:
            return wp.cw_mul(texel(table, texture.mean), used.scale) + used.bias

    lower = int(level)
    share = level - float(lower)
    first, width, height = level_place(texture, lower)
    next_width = wp.max(width >> 1, 1)
    next_height = wp.max(height >> 1, 1)

    u = across[0] * st[0] + across[1] * st[1] + across[2]
    v = upward[0] * st[0] + upward[1] * st[1] + upward[2]
    step = wp.vec2(long_axis[0] / size[0], long_axis[1] / size[1]) / float(taps)
    u -= 0.5 * float(taps - 1) * step[0]
    v -= 0.5 * float(taps - 1) * step[1]
    total = wp.vec4()
    for _ in range(taps):
        at_u = wrap_coordinate(u, used.wrap_u)
        at_v = wrap_coordinate(v, used.wrap_v)
        value = level_value(table, first, width, height, at_u, at_v, used.wrap_u, used.wrap_v)
        if share > 0.0 and lower < top:
            coarser = level_value(
                table,
                first + width * height,
                next_width,
                next_height,
                at_u,
                at_v,
                used.wrap_u,
                used.wrap_v,
            )
            value = value + (coarser - value) * share
        total += value
        u += step[0]
        v += step[1]
    total = total / float(taps)
    if mean_share > 0.0:
        total += (texel(table, texture.mean) - total) * mean_share
    return wp.cw_mul(total, used.scale) + used.bias
