"""Attenuate light in the air in front of a camera: haze, fog and rain absorb it and scatter light of the sky in."""

import warp as wp

from mmw.kernels.shading.sky import Sky, lerp3, sky_radiance, sun_disc

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": True})

HORIZON = wp.constant(64)
"""Directions of the horizon, even steps of the sine of half the azimuth from the sun."""

FOG_ANISOTROPY = wp.constant(0.85)
"""Mean cosine g of scattering by drops of fog at 550 nm. Source: Hess, Koepke and Schult, Bull. Am. Meteorol. Soc. 79,
1998 (OPAC), fog 0.85 to 0.88."""


@wp.struct
class Air:
    """One weather between a camera and what it sees, from `mmw.sensors.render.sky.sky.make_air`."""

    rain_extinction: float
    """Extinction of the drops of rain [1/m], the same at all heights."""
    fog_extinction: wp.vec3
    """Extinction of fog or haze in red, green (550 nm) and blue at the ground [1/m]."""
    fog_start: float
    """Distance from the camera at which fog or haze begins [m]."""
    fog_falloff: float
    """Decay of the fog's density with height [1/m], 0 for none."""
    ground_z: float
    """Height of the ground, scene frame [m]; the fog is no denser below."""
    horizon: wp.array[wp.vec3]
    """Airlight of level directions [kcd/m2], shape [`HORIZON`], from the sun's azimuth to the opposite one."""
    upward: wp.vec3
    """Excess of the airlight straight upward over the level one [kcd/m2]: light comes from above."""
    downward: wp.vec3
    """Deficit of the airlight straight downward below the level one [kcd/m2]."""
    glow: wp.vec3
    """Sunlight [klux] that the fog scatters toward the camera; zero where the sun is hidden."""


@wp.func
def henyey_greenstein(cosine: float, anisotropy: float) -> float:
    """Return the share of light scattered per solid angle [1/sr] at an angle from its direction, given by its cosine.

    Source: Henyey and Greenstein, Astrophys. J. 93, 1941.
    """
    base = wp.max(1.0 + anisotropy * anisotropy - 2.0 * anisotropy * cosine, 1e-6)
    return (1.0 - anisotropy * anisotropy) / (4.0 * wp.PI * base * wp.sqrt(base))


@wp.func
def airlight(air: Air, sun_direction: wp.vec3, direction: wp.vec3) -> wp.vec3:
    """Return the radiance of endless air in a direction [kcd/m2]: what everything far away fades to."""
    level = wp.sqrt(direction[0] * direction[0] + direction[1] * direction[1])
    sun_level = wp.sqrt(sun_direction[0] * sun_direction[0] + sun_direction[1] * sun_direction[1])
    both = wp.max(level * sun_level, 1e-12)
    cosine = (direction[0] * sun_direction[0] + direction[1] * sun_direction[1]) / both
    at = wp.sqrt(wp.clamp(0.5 - 0.5 * cosine, 0.0, 1.0)) * float(HORIZON - 1)
    entry = wp.min(int(at), HORIZON - 2)
    light = lerp3(air.horizon[entry], air.horizon[entry + 1], at - float(entry))
    light += air.upward * wp.max(direction[2], 0.0) + air.downward * wp.min(direction[2], 0.0)
    return light + air.glow * henyey_greenstein(wp.dot(direction, sun_direction), FOG_ANISOTROPY)


@wp.func
def transmittance(air: Air, origin: wp.vec3, direction: wp.vec3, distance: float) -> wp.vec3:
    """Return the share of light that comes through the air on a ray, in red, green and blue.

    Fog of density exp(-k z) on a ray that climbs from z0 to z1 has the mean density (e0 - e1) / (k (z1 - z0)), e being
    the densities at the ends. Over a short climb, where that is 0 / 0, it is the density at the middle.

    Args:
        air: The air.
        origin: Where the camera is, scene frame [m].
        direction: Unit vector away from it, scene frame.
        distance: Length of the ray [m].
    """
    through_fog = wp.max(distance - air.fog_start, 0.0)
    density = wp.float32(1.0)
    if air.fog_falloff > 0.0:
        z1 = wp.max(origin[2] + direction[2] * distance - air.ground_z, 0.0)
        z0 = wp.max(origin[2] + direction[2] * wp.min(air.fog_start, distance) - air.ground_z, 0.0)
        climb = air.fog_falloff * (z1 - z0)
        density = wp.exp(-air.fog_falloff * 0.5 * (z0 + z1))
        if wp.abs(climb) > 0.01:
            density = (wp.exp(-air.fog_falloff * z0) - wp.exp(-air.fog_falloff * z1)) / climb
    depth = air.fog_extinction * (density * through_fog)
    rain = air.rain_extinction * distance
    return wp.vec3(wp.exp(-depth[0] - rain), wp.exp(-depth[1] - rain), wp.exp(-depth[2] - rain))


@wp.func
def through_air(air: Air, sky: Sky, radiance: wp.vec3, origin: wp.vec3, direction: wp.vec3, distance: float) -> wp.vec3:
    """Return what a camera sees of a radiance through the air [kcd/m2].

    Args:
        air: The air.
        sky: Its sky.
        radiance: Of the surface, toward the camera [kcd/m2].
        origin: Where the camera is, scene frame [m].
        direction: Unit vector from the camera to the surface, scene frame.
        distance: Of the surface [m].

    Source: Koschmieder's law, L = L0 T + La (1 - T), Beitr. Phys. freien Atm. 12, 1924.
    """
    passed = transmittance(air, origin, direction, distance)
    return wp.cw_mul(radiance, passed) + wp.cw_mul(airlight(air, sky.sun_direction, direction), wp.vec3(1.0) - passed)


@wp.func
def sky_through_air(sky: Sky, direction: wp.vec3) -> wp.vec3:
    """Return what a camera sees where a ray hits nothing, the sun's disc included [kcd/m2].

    The sky is baked as seen from the ground, through all of its haze, fog and rain, so nothing is left to do: in dense
    fog it is the airlight, and at the horizon the airlight in any weather.
    """
    return sky_radiance(sky, direction, 0.0) + sun_disc(sky, direction)
