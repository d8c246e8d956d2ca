"""Compute the light of sky and sun: radiance from a direction, sharp or blurred, and irradiance of a plane.

Maps are equirectangular: column 0 begins at north and columns run clockwise (east next), row 0 begins at the zenith.
They are baked on the host, once a weather (`mmw.sensors.render.sky.sky.make_sky`).
"""

import warp as wp

from mmw.kernels.core.packing import octahedral

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": True})

BLURS = wp.constant(5)
"""Blurred maps: number k holds the lobes of roughness (k + 1) / `BLURS`; one more map holds irradiance over pi."""

LIMB = wp.constant(0.6)
"""Limb darkening of the sun u: luminance is 1 - u (1 - cos) of that of the middle, cos at the sun's surface. Source:
Allen's Astrophysical Quantities, 2000, section 14.7, at 550 nm."""


@wp.struct
class Sky:
    """Sky, ground and sun of one weather, the ground's own haze and fog included; the sun's disc is in no map."""

    map: wp.array2d[wp.uint64]
    """Radiance over `scale`, octahedral, four halves a texel of which the last is not used, in one word as
    `kernels.texture` reads them; shape [N + 2, N + 2] with a border of one texel."""
    blurred: wp.array3d[wp.uint64]
    """The same as GGX lobes see it, shape [`BLURS` + 1, n + 2, n + 2]; the last is irradiance / pi of planes by
    normal."""
    scale: float
    """Luminance of a value of 1 in the maps [kcd/m2]: halves do not reach from noon to night."""
    sun_direction: wp.vec3
    """Unit vector to the sun, scene frame."""
    sun_illuminance: wp.vec3
    """Illuminance of a plane that faces the sun by the sun alone [klux]; zero where it is hidden."""
    sun_radius: float
    """Angular radius of the disc [rad]."""
    exposure: float
    """Factor that brings radiance [kcd/m2] to display linear, 1 for white."""


@wp.func
def lerp3(a: wp.vec3, b: wp.vec3, t: float) -> wp.vec3:
    """Return a + (b - a) t."""
    return a + (b - a) * t


@wp.func
def texel(texels: wp.array2d[wp.uint64], row: int, column: int) -> wp.vec3:
    """Return a texel."""
    value = wp.cast(texels[row, column], wp.vec4h)
    return wp.vec3(float(value[0]), float(value[1]), float(value[2]))


@wp.func
def sample_map(texels: wp.array2d[wp.uint64], at: wp.vec2) -> wp.vec3:
    """Return the bilinear value of an octahedral map, shape [N + 2, N + 2], at coordinates of `octahedral`.

    Its border repeats what lies beyond the edges, so that nothing is asked about them here.
    """
    size = float(texels.shape[0] - 2)
    u = (at[0] + 1.0) * (0.5 * size) + 0.5
    v = (at[1] + 1.0) * (0.5 * size) + 0.5
    column = wp.floor(u)
    row = wp.floor(v)
    c = wp.clamp(int(column), 0, texels.shape[0] - 2)
    r = wp.clamp(int(row), 0, texels.shape[0] - 2)
    upper = lerp3(texel(texels, r, c), texel(texels, r, c + 1), u - column)
    lower = lerp3(texel(texels, r + 1, c), texel(texels, r + 1, c + 1), u - column)
    return lerp3(upper, lower, v - row)


@wp.func
def sky_radiance(sky: Sky, direction: wp.vec3, roughness: float) -> wp.vec3:
    """Return the radiance of sky or far ground in a direction, without the sun's disc [kcd/m2].

    Args:
        sky: The sky.
        direction: Unit vector away from the viewer, scene frame; of a glossy surface the reflected one.
        roughness: 0 sharp, else mean over the GGX lobe of that perceptual roughness (alpha = roughness^2), up to 1.
    """
    at = octahedral(direction)
    level = wp.clamp(roughness, 0.0, 1.0) * float(BLURS)
    if level <= 0.0:
        return sample_map(sky.map, at) * sky.scale
    lower = wp.min(int(level), BLURS - 1)
    rough = sample_map(sky.blurred[lower], at)
    smooth = wp.vec3()
    if lower == 0:
        smooth = sample_map(sky.map, at)
    else:
        smooth = sample_map(sky.blurred[lower - 1], at)
    return lerp3(smooth, rough, level - float(lower)) * sky.scale


@wp.func
def sky_irradiance(sky: Sky, normal: wp.vec3) -> wp.vec3:
    """Return the illuminance of a plane by sky and far ground, without the sun [klux]."""
    return sample_map(sky.blurred[BLURS], octahedral(normal)) * (sky.scale * wp.PI)


@wp.func
def sun_disc(sky: Sky, direction: wp.vec3) -> wp.vec3:
    """Return the luminance of the sun's disc seen directly [kcd/m2], zero off the disc; its integral is
    `sun_illuminance`.

    Source: linear limb darkening, whose mean over the disc is 1 - u / 3.
    """
    off = direction - sky.sun_direction  # the chord: the cosine of so small an angle has no digits left
    radius = 2.0 * wp.sin(0.5 * sky.sun_radius)
    share = wp.dot(off, off) / (radius * radius)
    if share >= 1.0:
        return wp.vec3()
    limb = 1.0 - LIMB * (1.0 - wp.sqrt(1.0 - share))
    return sky.sun_illuminance * (limb / (wp.PI * radius * radius * (1.0 - LIMB / 3.0)))
