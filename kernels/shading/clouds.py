"""March light through a layer of heaped clouds once a weather, for every texel of the sky's map."""

import warp as wp

from mmw.kernels.shading.aerial_perspective import henyey_greenstein

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": True})

EARTH = wp.constant(6.36e6)
"""Radius of the ground [m]."""

STEPS = wp.constant(40)
"""Steps of a ray through the layer."""

SUN_STEPS = wp.constant(6)
"""Steps from a point of a cloud toward the sun, each 1.7 times as long as the one before."""

ORDERS = wp.constant(4)
"""Orders of scattering that are followed: each one weaker, more spread and less dimmed than the one before."""


HEAP_HEIGHT = wp.constant(1.25)
"""Height of a heap of endless rank, over the depth of the layer [-]. Design value."""

HEAP_GROWTH = wp.constant(3.2)
"""Growth of heaps with the rank over the threshold [-]. Design value."""


@wp.struct
class Clouds:
    """A layer of clouds, the same everywhere but for its pattern, which repeats itself."""

    cover: wp.array2d[float]
    """Ranks 0 to 1 of a random field, evenly spread, shape [N, N], N a power of two: clouds are where it is high."""
    detail: wp.array3d[float]
    """Ranks 0 to 1 of a finer one, shape [M, M, M], M a power of two."""
    cover_size: float
    """Side of the pattern [m]."""
    detail_size: float
    """Side of the finer pattern [m]."""
    offset: wp.vec2
    """Position of the viewer in the pattern [m]."""
    threshold: float
    """Rank from which on there is a cloud."""
    bottom: float
    """Height of the flat bottoms [m]."""
    depth: float
    """Height of the highest top over the bottoms [m]."""
    highest: float
    """Height over which the pattern leaves nothing, over the bottoms, as a share of the depth."""
    extinction: float
    """Extinction inside [1/m]."""
    sun_direction: wp.vec3


@wp.func
def pattern(values: wp.array2d[float], x: float, y: float) -> float:
    """Return the smooth value of a repeating field, shape [N, N], at a point in its cells."""
    i = int(wp.floor(x))
    j = int(wp.floor(y))
    u = x - float(i)
    v = y - float(j)
    u = u * u * (3.0 - 2.0 * u)
    v = v * v * (3.0 - 2.0 * v)
    mask = values.shape[0] - 1
    i0 = i & mask
    i1 = (i + 1) & mask
    j0 = j & mask
    j1 = (j + 1) & mask
    return wp.lerp(wp.lerp(values[j0, i0], values[j0, i1], u), wp.lerp(values[j1, i0], values[j1, i1], u), v)


@wp.func
def pattern_3d(values: wp.array3d[float], at: wp.vec3) -> float:
    """Return the trilinear value of a repeating field, shape [M, M, M], at a point in its cells."""
    i = int(wp.floor(at[0]))
    j = int(wp.floor(at[1]))
    k = int(wp.floor(at[2]))
    u = at[0] - float(i)
    v = at[1] - float(j)
    w = at[2] - float(k)
    mask = values.shape[0] - 1
    i0 = i & mask
    i1 = (i + 1) & mask
    j0 = j & mask
    j1 = (j + 1) & mask
    k0 = k & mask
    k1 = (k + 1) & mask
    low = wp.lerp(
        wp.lerp(values[k0, j0, i0], values[k0, j0, i1], u), wp.lerp(values[k0, j1, i0], values[k0, j1, i1], u), v
    )
    high = wp.lerp(
        wp.lerp(values[k1, j0, i0], values[k1, j0, i1], u), wp.lerp(values[k1, j1, i0], values[k1, j1, i1], u), v
    )
    return wp.lerp(low, high, w)


@wp.func
def cloud_density(clouds: Clouds, x: float, y: float, height: float) -> float:
    """Return how much cloud is at a point, 0 to 1, without what detail removes; below 0 outside.

    Args:
        clouds: The layer.
        x: East of the viewer [m].
        y: North of the viewer [m].
        height: Over the bottoms, as a share of the depth.
    """
    if height >= clouds.highest:
        return -1.0
    cells = float(clouds.cover.shape[0]) / clouds.cover_size
    rank = pattern(clouds.cover, (x + clouds.offset[0]) * cells, (y + clouds.offset[1]) * cells)
    # The higher the rank over the threshold, the higher the heap; what is left at the top of the layer is eroded.
    return HEAP_HEIGHT * (1.0 - wp.exp(-HEAP_GROWTH * wp.max(rank - clouds.threshold, -0.1))) - height


@wp.kernel
def clouds_kernel(clouds: Clouds, directions: wp.array2d[wp.vec3], light_out: wp.array2d[wp.vec4]):
    """Light of the clouds in directions. Launch: (R, C), any block.

    Args:
        clouds: The layer.
        directions: Unit vectors, scene frame, shape [R, C].
        light_out: Share of the sun's illuminance that comes as luminance [1/sr]; share of the luminance around;
            opacity, 0 to 1; mean distance [m]. Zeros for no cloud. Shape [R, C].

    Source of the orders of scattering: M. Wrenninge, C. Kulla and V. Lundqvist, "Oz: The Great and Volumetric",
    SIGGRAPH 2013 talks.
    """
    row, column = wp.tid()
    direction = directions[row, column]
    up = direction[2]
    light_out[row, column] = wp.vec4()
    if up < 0.005:
        return
    r = EARTH * up
    near = 2.0 * EARTH * clouds.bottom / (r + wp.sqrt(r * r + 2.0 * EARTH * clouds.bottom))
    top = clouds.bottom + clouds.depth
    far = 2.0 * EARTH * top / (r + wp.sqrt(r * r + 2.0 * EARTH * top))
    step = (far - near) / float(STEPS)
    cosine = wp.dot(direction, clouds.sun_direction)
    fine = float(clouds.detail.shape[0]) / clouds.detail_size
    passed = wp.float32(1.0)
    sun = wp.float32(0.0)
    around = wp.float32(0.0)
    where = wp.float32(0.0)
    for i in range(STEPS):
        s = near + (float(i) + 0.5) * step
        x = direction[0] * s
        y = direction[1] * s
        height = (float(i) + 0.5) / float(STEPS)
        density = cloud_density(clouds, x, y, height)
        if passed < 0.01:
            break
        if density > 0.0:
            at = wp.vec3(x + clouds.offset[0], y + clouds.offset[1], height * clouds.depth) * fine
            lumps = pattern_3d(clouds.detail, at) * 0.65 + pattern_3d(clouds.detail, at * 2.7) * 0.35
            density = wp.clamp((density - 0.55 * (1.0 - lumps)) * 2.5, 0.0, 1.0)
            if density > 0.0:
                depth_to_sun = wp.float32(0.0)
                length = wp.float32(40.0)
                along = wp.float32(0.0)
                for _k in range(SUN_STEPS):
                    ahead = along + 0.5 * length
                    h = height + ahead * wp.max(clouds.sun_direction[2], 0.02) / clouds.depth
                    there = cloud_density(
                        clouds, x + clouds.sun_direction[0] * ahead, y + clouds.sun_direction[1] * ahead, h
                    )
                    depth_to_sun += wp.clamp((there - 0.2) * 2.5, 0.0, 1.0) * length
                    along += length
                    length = length * 1.7
                depth_to_sun = depth_to_sun * clouds.extinction * (0.25 + 1.5 * lumps)
                scattered = wp.float32(0.0)
                weight = wp.float32(1.0)
                dimming = wp.float32(1.0)
                spread = wp.float32(1.0)
                for _order in range(ORDERS):
                    phase = 0.75 * henyey_greenstein(cosine, 0.8 * spread) + 0.25 * henyey_greenstein(cosine, -0.2)
                    scattered += weight * phase * wp.exp(-depth_to_sun * dimming)
                    weight = weight * 0.75
                    dimming = dimming * 0.3
                    spread = spread * 0.5
                share = passed * (1.0 - wp.exp(-density * clouds.extinction * step))
                sun += share * scattered
                around += share * (0.55 + 0.45 * height)
                where += share * s
                passed -= share
    opacity = 1.0 - passed
    if opacity > 0.0:
        light_out[row, column] = wp.vec4(sun, around, opacity, where / opacity)
