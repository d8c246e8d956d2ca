"""Wet surfaces: water darkens pores and lies over them as a film, with puddles and the rings of rain on them.

Three effects change with the weather, and all are functions of place and time alone:

- A porous surface soaks: light is thrown back into it at the water's surface and it darkens
  (`mmw.physics.materials.material.wet_reflectance` in each color channel). Walls soak less than the ground.
- Water lies over it as a film that reflects by Fresnel's law with an index of 1.33. What it reflects is taken from what
  lies below (`film_weights`). On the ground it is thin, follows the grain and is streaky; cars carry it too.
- Puddles stand on level ground where a smooth noise is high. Their share of the ground is that of the weather, because
  the noise is brought to a uniform distribution. They are flat but for the rings of drops.

Noise is hashed from whole numbers, so that every device has the same puddles.
"""

import warp as wp

from mmw.kernels.shading.brdf import MIN_COSINE, lobe, lobe_albedo
from mmw.kernels.shading.structs import Appearance, SurfacePoint

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": True})

MIX_A = wp.constant(wp.uint32(0x9E3779B1))
MIX_B = wp.constant(wp.uint32(0x85EBCA77))
MIX_C = wp.constant(wp.uint32(0xC2B2AE3D))
MIX_D = wp.constant(wp.uint32(0x7FEB352D))
MIX_E = wp.constant(wp.uint32(0x846CA68B))
MIX_F = wp.constant(wp.uint32(0xFFFF))
"""Odd numbers of the hash of a cell; typed, so that no compiler reads them as negative ones."""

WATER_REFLECTANCE = wp.constant(0.02)
"""Reflectance of water at normal incidence, ((1.33 - 1) / (1.33 + 1))^2 [-]."""
WATER_INDEX2 = wp.constant(1.7689)
"""Square of the refractive index 1.33 of water [-]; `mmw.physics.materials.material.WATER_INDEX`."""
LEVEL_FROM = wp.constant(0.97)
LEVEL_TO = wp.constant(0.985)
"""Upward component of normals between which ground becomes level enough for puddles: 14 to 10 degrees. Design value."""
WALL_SOAK = wp.constant(0.4)
"""Water in an upright wall over that in level ground [-]: rain hits it at a slant only. Design value."""
SOAKED_ROUGHNESS = wp.constant(0.25)
"""Roughness of a soaked porous surface, if it was rougher [-]. Design value."""
GROUND_FILM = wp.constant(0.75)
"""Share of soaked ground that is under a film, where the noise is at its mean [-]. Design value."""
SHEEN_FILM = wp.constant(0.5)
"""Share of a smooth upward surface off the ground that drops and film cover [-]. Design value."""
GROUND_FILM_ROUGHNESS = wp.constant(0.28)
"""Roughness of the film over the grain of a road [-]. Design value."""
PUDDLE_ROUGHNESS = wp.constant(0.03)
"""Roughness of standing water without rain [-]. Design value."""
RIM = wp.constant(0.03)
"""Half width of a puddle's rim on the uniform scale of the noise: about 4 cm, as its slope is about 0.7 per meter."""
RIM_PER_M = wp.constant(0.35)
"""Half width that a footprint of 1 m adds."""
PUDDLE_SIZE_M = wp.constant(3.4)
"""Wavelength of the first octave of the puddles' noise [m]."""

RING_CELL_M = wp.constant(0.3)
"""Side of the cell in which one ring at a time runs, in each layer [m]."""
RING_LAYERS = wp.constant(4)
RING_LIFE_S = wp.constant(0.4)
"""Time in which a ring runs out [s]. Design value."""
RING_SPEED_M_S = wp.constant(0.25)
"""Speed of a ring [m/s]: capillary waves are slowest at 0.23 m/s. Source: H. Lamb, "Hydrodynamics", section 267."""
RING_WIDTH_M = wp.constant(0.02)
"""Half width of a ring, which holds 2 waves [m]: 2 cm each, near the slowest."""
SHED_FILM = wp.constant(0.3)
"""Film that stays on porous surfaces on which no water stands, over that of a road [-]. Design value."""
RING_SLOPE = wp.constant(0.2)
"""Steepest slope of a new ring [-]. Design value."""


@wp.struct
class Wet:
    """Water on the surfaces of a scene in one weather."""

    wetness: float
    """Water in the pores, 0 dry to 1 soaked."""
    puddles: float
    """Share of level ground under standing water, 0 to 1."""
    rain_mm_h: float
    origin: wp.vec3
    """Added to points of the scene frame [m], so that puddles stay where they are in the world."""


@wp.struct
class Wetted:
    """A surface_point as water changes it, and the film over it."""

    surface_point: SurfacePoint
    """Surface under the film."""
    film: float
    """Share of the surface that the film covers, 0 to 1; 0 for a dry one."""
    film_normal: wp.vec3
    """Unit normal of the film."""
    film_roughness: float
    puddle: float
    """Share of the surface under standing water, 0 to 1."""


@wp.func
def mixed_bits(x: int, y: int, salt: int) -> wp.uint32:
    """Return a hash of a cell. Source: finaliser "lowbias32" of C. Wellons, "Prospecting for hash functions", 2018."""
    h = wp.uint32(x) * MIX_A + wp.uint32(y) * MIX_B
    h += wp.uint32(salt) * MIX_C
    h = (h ^ (h >> wp.uint32(16))) * MIX_D
    h = (h ^ (h >> wp.uint32(15))) * MIX_E
    return h ^ (h >> wp.uint32(16))


@wp.func
def cell_value(x: int, y: int, salt: int) -> float:
    """Return a number of a cell, uniform in [0, 1)."""
    return wp.float32(mixed_bits(x, y, salt) >> wp.uint32(8)) * 5.9604644775390625e-08


@wp.func
def value_noise(at: wp.vec2, salt: int) -> float:
    """Return a smooth noise with values 0 to 1 at the corners of unit cells, and none in between beyond them.

    Source: lattice value noise with the quintic of K. Perlin, "Improving noise", SIGGRAPH 2002.
    """
    cell_x = wp.floor(at[0])
    cell_y = wp.floor(at[1])
    x = at[0] - cell_x
    y = at[1] - cell_y
    i = int(cell_x)
    j = int(cell_y)
    u = x * x * x * (x * (x * 6.0 - 15.0) + 10.0)
    v = y * y * y * (y * (y * 6.0 - 15.0) + 10.0)
    low = wp.lerp(cell_value(i, j, salt), cell_value(i + 1, j, salt), u)
    high = wp.lerp(cell_value(i, j + 1, salt), cell_value(i + 1, j + 1, salt), u)
    return wp.lerp(low, high, v)


@wp.func
def turned(at: wp.vec2, angle: float, size: float) -> wp.vec2:
    """Return a point [m] in a lattice that is turned by an angle and has cells of this size."""
    c = wp.cos(angle) / size
    s = wp.sin(angle) / size
    return wp.vec2(c * at[0] - s * at[1], s * at[0] + c * at[1])


@wp.func
def smoothstep(low: float, high: float, x: float) -> float:
    """Return 0 below `low`, 1 above `high`, a cubic between."""
    t = wp.clamp((x - low) / (high - low), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


@wp.func
def hollows(at: wp.vec2) -> float:
    """Return how deep the ground lies, 0 to 1, uniformly distributed over a large area.

    Three octaves, of which the small ones also bend the large one, so that its cells do not show. The polynomial brings
    them to a uniform distribution (fit to 4 million points, largest error of the share 0.0008).
    """
    second = value_noise(turned(at, 1.1, 1.3), 2)
    third = value_noise(turned(at, 2.3, 0.45), 3)
    a = second - 0.5
    b = third - 0.5
    first = value_noise(turned(at, 0.3, PUDDLE_SIZE_M) + wp.vec2(0.9 * a + 0.3 * b, 0.4 * b - 0.7 * a), 1)
    z = 2.0 * (0.7 * first + 0.2 * second + 0.1 * third) - 1.0
    z2 = z * z
    return wp.clamp(0.5 + z * (1.04422 + z2 * (-0.74466 + z2 * (-0.0235 + z2 * 0.24805))), 0.0, 1.0)


@wp.func
def puddle_at(wet: Wet, appearance: Appearance, normal: wp.vec3, point: wp.vec3, footprint: float) -> float:
    """Return the share of a surface that is under standing water, 0 to 1.

    Over a large level area its mean is `wet.puddles`, whatever the footprint.

    Args:
        wet: The weather's water.
        appearance: Material of the surface.
        normal: Unit normal of the face.
        point: Scene frame [m].
        footprint: Longest side of what a pixel covers on the surface [m]; 0 for a point. Rims get as soft as that, and
            where puddles are smaller than it, their mean is left.
    """
    result = wp.float32(0.0)
    if appearance.holds_puddles and wet.puddles > 0.0 and normal[2] > LEVEL_FROM:
        at = wp.vec2(point[0] + wet.origin[0], point[1] + wet.origin[1])
        edge = 1.0 - wet.puddles
        width = wp.min(RIM + RIM_PER_M * footprint, wp.max(wp.min(edge, wet.puddles), 1.0e-3))
        mask = smoothstep(edge - width, edge + width, hollows(at))
        far = smoothstep(PUDDLE_SIZE_M, 4.0 * PUDDLE_SIZE_M, footprint)
        result = wp.lerp(mask, wet.puddles, far) * smoothstep(LEVEL_FROM, LEVEL_TO, normal[2])
        if wet.puddles >= 1.0:
            result = smoothstep(LEVEL_FROM, LEVEL_TO, normal[2])
    return result


@wp.func
def large_drops(rain_mm_h: float) -> float:
    """Return how many drops of 2 mm or more fall [1/(m2 s)]: those whose rings are visible.

    Source: J. Marshall and W. Palmer, J. Meteor. 5, 1948: N(D) = 8000 exp(-4.1 R^-0.21 D) per m3 and mm; they fall at
    6.6 m/s (2 mm, Atlas et al. 1973).
    """
    rate = 4.1 * wp.pow(rain_mm_h, -0.21)
    return 6.6 * 8000.0 / rate * wp.exp(-2.0 * rate)


@wp.func
def ring_slope(at: wp.vec2, layer: int, time: float, chance: float) -> wp.vec2:
    """Return the slope of the water [-] that one layer's ring gives, dz/dx and dz/dy.

    Every cell of the layer has at most one ring at a time, which ends before it reaches the cell's edge. Its drop falls
    at a place and an instant that are hashed anew for every turn.
    """
    angle = 0.7 * wp.float32(layer)
    local = turned(at, angle, RING_CELL_M) + wp.vec2(0.37, 0.61) * wp.float32(layer)
    i = int(wp.floor(local[0]))
    j = int(wp.floor(local[1]))
    turns = time / RING_LIFE_S + cell_value(i, j, 16 + layer)
    turn = int(wp.floor(turns))
    salt = 32 + RING_LAYERS * turn + layer
    slope = wp.vec2(0.0, 0.0)
    if cell_value(i, j, salt) < chance:
        age = turns - wp.float32(turn)
        bits = mixed_bits(j, i, salt)
        x = wp.float32(bits & MIX_F) / 65536.0
        y = wp.float32(bits >> wp.uint32(16)) / 65536.0
        reach = RING_SPEED_M_S * RING_LIFE_S + RING_WIDTH_M
        margin = reach / RING_CELL_M
        center = wp.vec2(margin + (1.0 - 2.0 * margin) * x, margin + (1.0 - 2.0 * margin) * y)
        away = (local - wp.vec2(wp.float32(i), wp.float32(j)) - center) * RING_CELL_M
        radius = wp.length(away)
        offset = (radius - RING_SPEED_M_S * RING_LIFE_S * age) / RING_WIDTH_M
        if wp.abs(offset) < 1.0 and radius > 1.0e-4:
            window = 1.0 - offset * offset
            wave = wp.sin(2.0 * wp.PI * offset) * window * window
            # A ring dies away as it spreads; near its drop the slope has to turn through zero.
            size = RING_SLOPE * (1.0 - age) * wp.min(radius / RING_WIDTH_M, 1.0) * wave / radius
            c = wp.cos(angle)
            s = wp.sin(angle)
            slope = wp.vec2(c * away[0] + s * away[1], c * away[1] - s * away[0]) * size
    return slope


@wp.func
def ripple_normal(wet: Wet, point: wp.vec3, time: float) -> wp.vec3:
    """Return the unit normal of standing water in rain: rings of single drops, run out after 10 cm; up without rain.

    Args:
        wet: The weather's water.
        point: Scene frame [m].
        time: [s].
    """
    slope = wp.vec2(0.0, 0.0)
    if wet.rain_mm_h > 0.0:
        at = wp.vec2(point[0] + wet.origin[0], point[1] + wet.origin[1])
        rings = large_drops(wet.rain_mm_h) * RING_LIFE_S * RING_CELL_M * RING_CELL_M
        chance = 1.0 - wp.exp(-rings / wp.float32(RING_LAYERS))
        layers = int(RING_LAYERS)  # a variable, so that the loop is not unrolled
        for layer in range(layers):
            slope += ring_slope(at, layer, time, chance)
    return wp.normalize(wp.vec3(-slope[0], -slope[1], 1.0))


@wp.func
def soaked_color(color: wp.vec3, share: float) -> wp.vec3:
    """Return the color of a porous surface of which a share is soaked; 1 / n^2 of the light escapes the water.

    Source: A. Angstrom 1925, J. Lekner and M. Dorf 1988; see `mmw.physics.materials.material.wet_reflectance`.
    """
    result = wp.vec3()
    for i in range(3):
        dry = color[i]
        result[i] = dry + share * (dry / (WATER_INDEX2 * (1.0 - dry) + dry) - dry)
    return result


@wp.func
def wetted(wet: Wet, appearance: Appearance, surface_point: SurfacePoint, time: float, footprint: float) -> Wetted:
    """Return a dry surface_point as the weather's water makes it.

    Args:
        wet: The weather's water.
        appearance: Material of the surface.
        surface_point: The dry surface.
        time: Time, for the rings on puddles [s].
        footprint: Longest side of what a pixel covers on the surface [m]; rings and streaks that are finer fade into
            the film's roughness.
    """
    out = Wetted()
    out.surface_point = surface_point
    out.film = wp.float32(0.0)
    out.puddle = wp.float32(0.0)
    out.film_normal = surface_point.shading_normal
    out.film_roughness = GROUND_FILM_ROUGHNESS
    if wet.wetness > 0.0 or wet.puddles > 0.0:
        up = surface_point.normal[2]
        puddle = puddle_at(wet, appearance, surface_point.normal, surface_point.point, footprint)
        soak = wp.float32(0.0)
        if appearance.is_porous:
            # Undersides stay dry, walls get a part.
            share = WALL_SOAK * smoothstep(-0.5, 0.0, up) + (1.0 - WALL_SOAK) * smoothstep(0.1, 0.7, up)
            soak = wp.max(wet.wetness * share, puddle)
            out.surface_point.color = soaked_color(surface_point.color, soak)
            out.surface_point.roughness = wp.lerp(
                surface_point.roughness, wp.min(surface_point.roughness, SOAKED_ROUGHNESS), soak
            )
        level = smoothstep(0.2, 0.8, up)
        if appearance.is_porous or appearance.holds_puddles:
            # A damp ground has no film yet: it grows with the square of the wetness.
            at = wp.vec2(surface_point.point[0] + wet.origin[0], surface_point.point[1] + wet.origin[1])
            streak = value_noise(turned(at, 0.5, 0.9), 8) + 0.6 * value_noise(turned(at, 1.9, 0.22), 9) - 0.8
            streak *= wp.exp(-footprint)
            # A pitched roof or a wall's top sheds the water that stays on a road.
            stays = wp.where(appearance.holds_puddles, 1.0, SHED_FILM)
            out.film = (
                stays * wet.wetness * wet.wetness * level * wp.clamp(GROUND_FILM * (1.0 + 0.15 * streak), 0.0, 1.0)
            )
            out.film_roughness = GROUND_FILM_ROUGHNESS - 0.04 * streak
            out.film_normal = wp.normalize(surface_point.normal + surface_point.shading_normal)
        else:
            out.film = SHEEN_FILM * wet.wetness * level * (1.0 - surface_point.roughness)
            out.film_roughness = wp.max(0.1, surface_point.roughness)
        if puddle > 0.0:
            near = wp.exp(-10.0 * footprint)
            ripple = wp.vec3(0.0, 0.0, 1.0)
            if wet.rain_mm_h > 0.0 and near > 0.02:
                ripple = wp.normalize(wp.lerp(ripple, ripple_normal(wet, surface_point.point, time), near))
            # The rings of the many small drops are never drawn; they and the faded ones blur the reflection.
            rough = PUDDLE_ROUGHNESS + (0.05 + 0.07 * (1.0 - near)) * (1.0 - wp.exp(-wet.rain_mm_h / 25.0))
            out.film = wp.lerp(out.film, 1.0, puddle)
            out.film_roughness = wp.lerp(out.film_roughness, rough, puddle)
            out.film_normal = wp.normalize(wp.lerp(out.film_normal, ripple, puddle))
            out.puddle = puddle
    return out


@wp.func
def film_weights(wetted: Wetted, to_viewer: wp.vec3) -> float:
    """Return the share that the film reflects, of light from all round; what lies below it is scaled by 1 - share."""
    share = wp.float32(0.0)
    if wetted.film > 0.0:
        n_v = wp.clamp(wp.dot(wetted.film_normal, to_viewer), MIN_COSINE, 1.0)
        albedo = lobe_albedo(n_v, wetted.film_roughness)
        share = wetted.film * (WATER_REFLECTANCE * (albedo[0] - albedo[1]) + albedo[1])
    return share


@wp.func
def film_light(wetted: Wetted, to_viewer: wp.vec3, to_light: wp.vec3, alpha2: float) -> float:
    """Return BRDF times cosine of the film for a far light [1/sr]: the sun's or a light's glint on wet ground.

    Args:
        wetted: The wet surface.
        to_viewer: Unit direction, scene frame.
        to_light: Unit direction, scene frame.
        alpha2: Added to the square of GGX's alpha for the light's size; `brdf.GLINT_ALPHA2` for the sun.
    """
    result = wp.float32(0.0)
    n = wetted.film_normal
    n_l = wp.dot(n, to_light)
    if wetted.film > 0.0 and n_l > 0.0 and wp.dot(wetted.surface_point.normal, to_light) > 0.0:
        n_v = wp.clamp(wp.dot(n, to_viewer), MIN_COSINE, 1.0)
        half = wp.normalize(to_viewer + to_light)
        sine = wp.cross(n, half)
        x = 1.0 - wp.clamp(wp.dot(to_viewer, half), 0.0, 1.0)
        x5 = x * x * x * x * x
        alpha = wetted.film_roughness * wetted.film_roughness
        shine = lobe(n_v, n_l, wp.min(wp.dot(sine, sine), 1.0), wp.min(alpha * alpha + alpha2, 1.0))
        result = wetted.film * (WATER_REFLECTANCE * (1.0 - x5) + x5) * shine * n_l
    return result
