"""Compute the clear sky: sunlight scattered once and many times by the gas, haze and ozone of a round atmosphere.

Light is followed at eleven wavelengths, the last axis of an array (K): with three, a twilight turns purple. What leaves
this module is linear Rec. 709 red, green and blue. Angles are in rad, lengths in m, luminance in kcd/m2. Everything is
float64 and depends on nothing but the arguments.

Source: S. Hillaire, "A Scalable and Production Ready Sky and Atmosphere Rendering Technique", Comput. Graph. Forum 39,
2020 (order of integration, the series of multiple scattering); E. Bruneton and F. Neyret, "Precomputed Atmospheric
Scattering", Comput. Graph. Forum 27, 2008, and Bruneton's revision of 2017 (parameters of the tables).
"""

import functools
import math
from dataclasses import dataclass

import numpy as np

EARTH_M = 6_360e3
"""Radius of the ground [m]. Source: Bruneton 2017."""

TOP_M = 6_460e3
"""Radius of the top of the atmosphere [m]. Source: Hillaire 2020."""

WAVELENGTH_NM = np.arange(400.0, 701.0, 30.0)
"""Wavelengths that are followed [nm], shape [K]; 550 is the sixth."""

RAYLEIGH_PER_M = 13.558e-6 * (WAVELENGTH_NM / 550.0) ** -4
"""Scattering of the gas at sea level [1/m]. Source: Hillaire 2020, table 1: (5.802, 13.558, 33.1)e-6 1/m at 680, 550
and 440 nm; Bruneton 2017."""

RAYLEIGH_HEIGHT_M = 8_000.0
"""Scale height of the gas [m]. Source: the same."""

HAZE_HEIGHT_M = 1_200.0
"""Scale height of the haze [m]. Source: the same."""

HAZE_ALBEDO = 0.9
"""Share of the haze's extinction that is scattering. Source: Bruneton 2017 (3.996e-6 of 4.44e-6 1/m); Hillaire's table
gives an absorption of 4.40e-6 1/m, which would be soot."""

HAZE_ANISOTROPY = 0.8
"""Mean cosine of scattering by haze. Source: Hillaire 2020."""

HAZE_EXPONENT = 1.3
"""Extinction of haze goes as the wavelength to minus this. Source: A. Angstrom, Geogr. Ann. 11, 1929."""

HAZE_SPECTRUM = (WAVELENGTH_NM / 550.0) ** -HAZE_EXPONENT
"""Extinction of haze over that at 550 nm, shape [K]."""

_OZONE_CROSS_SECTION = np.array([0.01527, 0.08451, 0.3669, 0.9016, 2.139, 3.5, 4.398, 4.305, 2.662, 1.473, 0.7455])
OZONE_PER_M = 1.881e-6 / 3.5 * _OZONE_CROSS_SECTION
"""Absorption by ozone at its densest [1/m]: its cross section in 1e-25 m2 times a density. Source: cross section, J.
Gorshelev et al. and A. Serdyuchenko et al., Atmos. Meas. Tech. 7, 2014, as in Bruneton 2017; density, Hillaire 2020,
table 1: (0.650, 1.881, 0.085)e-6 1/m at 680, 550 and 440 nm."""

OZONE_MIDDLE_M, OZONE_HALF_WIDTH_M = 25_000.0, 15_000.0
"""Height of the densest ozone, and from there to none, falling off straight [m]. Source: the same."""

SUN_KLUX = 128.0
"""Illuminance by the sun above the atmosphere [klux]. Source: 127 to 134 klux, CIE and IES; Hillaire 2020."""

SUN_KELVIN = 5_772.0
"""Temperature of the sun as a black body, which is white to the camera (cameras set to daylight are balanced for 5500
K). Source: IAU 2015 resolution B3; balance: design value."""

GROUND_ALBEDO = 0.2
"""Share of light that ground far away reflects, in all colors: soil, grass and asphalt mixed. Design value."""


def _to_rgb() -> np.ndarray:
    """Return the share of each wavelength of sunlight in red, green and blue, columns summing to 1, shape [K, 3].

    Source: color matching functions, C. Wyman, P.-P. Sloan and P. Shirley, J. Comput. Graph. Tech. 2, 2013; matrix of
    Rec. 709.
    """

    def lobe(middle: float, below: float, above: float) -> np.ndarray:
        off = WAVELENGTH_NM - middle
        return np.exp(-0.5 * (off * np.where(off < 0.0, below, above)) ** 2)

    x = 0.362 * lobe(442.0, 0.0624, 0.0374) + 1.056 * lobe(599.8, 0.0264, 0.0323) - 0.065 * lobe(501.1, 0.049, 0.0382)
    y = 0.821 * lobe(568.8, 0.0213, 0.0247) + 0.286 * lobe(530.9, 0.0613, 0.0322)
    z = 1.217 * lobe(437.0, 0.0845, 0.0278) + 0.681 * lobe(459.0, 0.0385, 0.0725)
    to_709 = np.array([[3.2405, -1.5371, -0.4985], [-0.9693, 1.8760, 0.0416], [0.0556, -0.2040, 1.0572]])
    sunlight = (WAVELENGTH_NM * 1e-3) ** -5 / np.expm1(1.43878e7 / (WAVELENGTH_NM * SUN_KELVIN))
    rgb = sunlight[:, None] * (np.stack((x, y, z), axis=1) @ to_709.T)
    return rgb / rgb.sum(axis=0)


TO_RGB = _to_rgb()
"""Weight of each wavelength in red, green and blue, shape [K, 3]; sunlight is white."""

_HEIGHTS, _COSINES = 48, 192
_STEPS = 40
_MANY_HEIGHTS, _MANY_COSINES, _MANY_FROM = 12, 28, -0.5


@dataclass(frozen=True)
class Air:
    """Composition of a clear atmosphere: extinction at sea level [1/m], one entry a wavelength."""

    rayleigh: tuple[float, ...]
    haze: tuple[float, ...]


def densities(height: np.ndarray) -> np.ndarray:
    """Return the density of gas, haze and ozone over their largest, shape [..., 3], at heights above the sea [m]."""
    tent = np.maximum(0.0, 1.0 - np.abs(height - OZONE_MIDDLE_M) / OZONE_HALF_WIDTH_M)
    height = np.maximum(height, 0.0)
    return np.stack((np.exp(-height / RAYLEIGH_HEIGHT_M), np.exp(-height / HAZE_HEIGHT_M), tent), axis=-1)


def to_top(radius: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    """Return the distance to the top of the atmosphere [m] from a radius, given the cosine of the zenith angle."""
    return -radius * cosine + np.sqrt(np.maximum(radius**2 * (cosine**2 - 1.0) + TOP_M**2, 0.0))


@functools.cache
def column_table() -> np.ndarray:
    """Return the columns of gas, haze and ozone up to the top [m], shape [heights, cosines, 3].

    Row and column follow Bruneton: rho = sqrt(r^2 - ground^2) evenly, and the distance to the top evenly between its
    shortest and its longest at that height.
    """
    longest = math.sqrt(TOP_M**2 - EARTH_M**2)
    rho = np.linspace(0.0, 1.0, _HEIGHTS)[:, None] * longest
    radius = np.sqrt(rho**2 + EARTH_M**2)
    near, far = TOP_M - radius, rho + longest
    length_m = near + (far - near) * np.linspace(0.0, 1.0, _COSINES)
    with np.errstate(invalid="ignore", divide="ignore"):
        cosine = (longest**2 - rho**2 - length_m**2) / (2.0 * radius * length_m)
    cosine = np.where(length_m > 0.0, np.clip(cosine, -1.0, 1.0), 1.0)
    # Steps grow along the ray, as the densities fall.
    edges = np.linspace(0.0, 1.0, 2 * _STEPS + 1) ** 2
    at = 0.5 * (edges[1:] + edges[:-1])
    s = length_m[..., None] * at
    r = np.sqrt(radius[..., None] ** 2 + s**2 + 2.0 * radius[..., None] * s * cosine[..., None])
    return np.einsum("abik,i,ab->abk", densities(r - EARTH_M), np.diff(edges), length_m)


def columns(radius: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    """Return the columns of gas, haze and ozone up to the top [m], shape [..., 3]; the ground is no obstacle.

    Args:
        radius: From the middle of the earth [m].
        cosine: Of the angle to the zenith.
    """
    table = column_table()
    longest = math.sqrt(TOP_M**2 - EARTH_M**2)
    radius, cosine = np.broadcast_arrays(np.clip(radius, EARTH_M, TOP_M), cosine)
    rho = np.sqrt(np.maximum(radius**2 - EARTH_M**2, 0.0))
    near = TOP_M - radius
    x = (to_top(radius, cosine) - near) / np.maximum(rho + longest - near, 1.0)
    return _bilinear(table, rho / longest, x)


def transmittance(air: Air, radius: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    """Return the share of light of a direction that reaches a point from outside, shape [..., K].

    Args:
        air: The air.
        radius: Of the point, from the middle of the earth [m].
        cosine: Of the angle between the direction and the zenith; below the point's horizon nothing comes through.
    """
    horizon = -np.sqrt(np.maximum(1.0 - (EARTH_M / np.maximum(radius, EARTH_M)) ** 2, 0.0))
    half_disc = 0.0046
    open_share = np.clip((cosine - horizon) / (2.0 * half_disc) + 0.5, 0.0, 1.0)
    return np.exp(-columns(radius, cosine) @ _extinctions(air)) * open_share[..., None]


def _extinctions(air: Air) -> np.ndarray:
    return np.stack((np.array(air.rayleigh), np.array(air.haze), OZONE_PER_M))


def _bilinear(table: np.ndarray, down: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Return the values of a table [rows, columns, K] at places that are 0 to 1 down and along it, shape [..., K]."""
    places = [np.clip(x, 0.0, 1.0) * (count - 1) for x, count in zip((down, along), table.shape[:2], strict=True)]
    i, j = (np.minimum(x.astype(int), count - 2) for x, count in zip(places, table.shape[:2], strict=True))
    row, column = (places[0] - i)[..., None], (places[1] - j)[..., None]
    upper = table[i, j] * (1.0 - column) + table[i, j + 1] * column
    lower = table[i + 1, j] * (1.0 - column) + table[i + 1, j + 1] * column
    return upper * (1.0 - row) + lower * row


def rayleigh_phase(cosine: np.ndarray) -> np.ndarray:
    """Return the share of light that gas scatters per solid angle [1/sr]."""
    return 3.0 / (16.0 * math.pi) * (1.0 + cosine**2)


def haze_phase(cosine: np.ndarray) -> np.ndarray:
    """Return the share of light that haze scatters per solid angle [1/sr].

    Source: W. Cornette and J. Shanks, Appl. Opt. 31, 1992.
    """
    g = HAZE_ANISOTROPY
    base = 1.0 + g**2 - 2.0 * g * cosine
    return 3.0 / (8.0 * math.pi) * (1.0 - g**2) * (1.0 + cosine**2) / ((2.0 + g**2) * base**1.5)


def _march(
    air: Air, radius: np.ndarray, cosine: np.ndarray, length_m: np.ndarray, steps: int
) -> tuple[np.ndarray, ...]:
    """Return heights' radii, distances, lengths, transmittances and densities at steps of a ray, shape [..., steps]."""
    edges = np.linspace(0.0, 1.0, steps + 1) ** 2
    s = length_m[..., None] * (0.5 * (edges[1:] + edges[:-1]))
    length = length_m[..., None] * np.diff(edges)
    r = np.sqrt(radius[..., None] ** 2 + s**2 + 2.0 * radius[..., None] * s * cosine[..., None])
    density = densities(r - EARTH_M)
    depth = (density @ _extinctions(air)) * length[..., None]
    before = np.cumsum(depth, axis=-2) - depth
    # Light scattered within a step is dimmed by the mean of exp(-x) over it.
    mean = np.where(depth > 1e-6, -np.expm1(-depth) / np.maximum(depth, 1e-6), 1.0)
    return r, s, length, np.exp(-before) * mean, density, np.exp(-(before[..., -1, :] + depth[..., -1, :]))


@functools.lru_cache(maxsize=32)
def multiple_scattering(air: Air) -> np.ndarray:
    """Return light scattered twice and more, per scattering and per unit of sunlight [1/sr], shape [12, 28, K].

    Rows are heights, columns cosines of the sun's zenith distance, see `scattered`. Each further order is the fraction
    f of the one before, so that all of them together are 1 / (1 - f) of the second.

    Source: Hillaire 2020, section 5.5.
    """
    heights = np.linspace(0.0, 1.0, _MANY_HEIGHTS) ** 2 * (TOP_M - EARTH_M - 2.0) + 1.0
    signed = np.linspace(_MANY_FROM, 1.0, _MANY_COSINES)
    sun = np.sign(signed) * signed**2
    nodes, weights = np.polynomial.legendre.leggauss(8)
    azimuths = (np.arange(4) + 0.5) / 4 * math.pi
    radius, cosine = np.broadcast_arrays((EARTH_M + heights)[:, None], nodes)
    below = radius**2 * (cosine**2 - 1.0) + EARTH_M**2
    hits_ground = (cosine < 0.0) & (below > 0.0)
    ground = -radius * cosine - np.sqrt(np.maximum(below, 0.0))
    length_m = np.where(hits_ground, ground, to_top(radius, cosine))
    r, s, length, passed, density, through = _march(air, radius, cosine, length_m, 12)
    weight = passed * (density[..., :2] @ _scatterings(air)) * length[..., None]
    fraction = np.einsum("hnsk,n->hk", weight, weights) / 2.0

    # Axes: height, view's zenith angle, step, sun's cosine, azimuth between view and sun.
    sines = np.sqrt(1.0 - cosine[..., None, None] ** 2) * np.sqrt(1.0 - sun[:, None] ** 2)
    along = cosine[..., None, None] * sun[:, None] + sines * np.cos(azimuths)
    sun_cosine = (radius[..., None, None, None] * sun[:, None] + s[..., None, None] * along[:, :, None]) / (
        r[..., None, None]
    )
    light = transmittance(air, r[..., None, None], sun_cosine).mean(axis=4)
    second = np.einsum("hnsk,hnsck,n->hck", weight, light, weights) / (8.0 * math.pi)
    lit = np.where(hits_ground[..., None], np.maximum(sun, 0.0) * GROUND_ALBEDO / math.pi, 0.0)
    second += np.einsum("hnc,hnck,hnk,n->hck", lit, light[:, :, -1], through, weights) / 2.0
    return second / (1.0 - fraction[:, None])


def scattered(air: Air, radius: np.ndarray, sun_cosine: np.ndarray) -> np.ndarray:
    """Return `multiple_scattering` at radii [m] and cosines of the sun's zenith distance, shape [..., K]."""
    table = multiple_scattering(air)
    height = np.sqrt(np.clip((radius - EARTH_M) / (TOP_M - EARTH_M), 0.0, 1.0))
    signed = np.sign(sun_cosine) * np.sqrt(np.abs(sun_cosine))
    return _bilinear(table, height, (signed - _MANY_FROM) / (1.0 - _MANY_FROM))


def sun_illuminance(air: Air, altitude: float) -> np.ndarray:
    """Return the illuminance of a plane at sea level that faces the sun, by the sun alone [klux], shape [3].

    It falls to nothing while the disc sinks through the horizon. Refraction, which lifts it by half a degree, is left
    out.

    Args:
        air: The air.
        altitude: Of the middle of the sun [rad].
    """
    passed = transmittance(air, np.array(EARTH_M + 2.0), np.array(math.sin(altitude)))
    return SUN_KLUX * np.maximum(passed @ TO_RGB, 0.0)


def sky_radiance(air: Air, altitude: float, elevation: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Return the luminance of the clear sky at sea level [kcd/m2], shape [E, A, 3].

    Args:
        air: The air.
        altitude: Of the sun [rad].
        elevation: Of the view, 0 or above [rad], shape [E].
        azimuth: Of the view from the sun [rad], shape [A].
    """
    cosine = np.sin(elevation)
    radius = np.full_like(cosine, EARTH_M + 2.0)
    r, s, length, passed, density, _ = _march(air, radius, cosine, to_top(radius, cosine), _STEPS)
    # The sun's zenith angle changes along the ray: that is what makes twilight.
    toward = cosine[:, None] * math.sin(altitude) + (np.cos(elevation) * math.cos(altitude))[:, None] * np.cos(azimuth)
    sun_cosine = (radius[:, None, None] * math.sin(altitude) + s[:, None] * toward[..., None]) / r[:, None]
    light = transmittance(air, r[:, None], sun_cosine)
    many = scattered(air, np.broadcast_to(r[:, None], sun_cosine.shape), sun_cosine)
    gas, haze = density[..., 0, None] * _scatterings(air)[0], density[..., 1, None] * _scatterings(air)[1]
    weight = passed * length[..., None]
    out = rayleigh_phase(toward)[..., None] * np.einsum("esk,eask->eak", weight * gas, light)
    out += haze_phase(toward)[..., None] * np.einsum("esk,eask->eak", weight * haze, light)
    out += np.einsum("esk,eask->eak", weight * (gas + haze), many)
    return SUN_KLUX * np.maximum(out @ TO_RGB, 0.0)


def _scatterings(air: Air) -> np.ndarray:
    return np.stack((np.array(air.rayleigh), HAZE_ALBEDO * np.array(air.haze)))
