"""Compute extinction and backscatter of rain and fog in the visible and at LiDAR wavelengths.

Rain is Marshall and Palmer's drop-size distribution N(D) = N0 exp(-slope D), fog the modified gamma distributions of
`mmw.physics.weather.weather.FogType`. One distribution serves every sensor: here its optics, in
`mmw.physics.em.attenuation` its radio.
"""

import math

from mmw.physics.weather.weather import Weather

CONTRAST_THRESHOLD = 0.05
"""Contrast at which a black target is just seen: it defines the meteorological optical range. Source: WMO-No. 8."""

MARSHALL_PALMER_N0 = 8000.0
"""Drops per volume and diameter at zero diameter [1/m3/mm]. Source: Marshall and Palmer, J. Meteorol. 5, 1948."""

RAIN_EXTINCTION = {550: (3.6616e-4, 0.62965), 905: (3.6682e-4, 0.62947), 1550: (3.6784e-4, 0.62918)}
"""Wavelength [nm] -> extinction of rain of 1 mm/h [1/m], exponent of the rain rate: fit within 0.06 % of Mie theory
over Marshall and Palmer's drops of 0.05 to 8 mm, 1 to 150 mm/h."""

DROP_BACKSCATTER = {905: 0.18, 1550: 0.02}
"""Backscatter efficiency of a rain drop by wavelength of LiDAR [nm]: Mie theory over drops of 1 to 6 mm, 5 to 20 mrad
off the exact return, where a receiver beside the laser sees them (0.145 to 0.196 and 0.018 to 0.027); oblate drops have
no glory. Water absorbs at 1550 nm."""

FOG_EXTINCTION_RATIO = {
    "strong_advection": {550: 1.0, 905: 1.0113, 1550: 1.0290},
    "moderate_advection": {550: 1.0, 905: 1.0132, 1550: 1.0340},
    "strong_spray": {550: 1.0, 905: 1.0249, 1550: 1.0653},
    "radiation": {550: 1.0, 905: 1.0401, 1550: 1.1349},
    "chu_hogg": {550: 1.0, 905: 1.0293, 1550: 1.0828},
}
"""Extinction of fog over that at 550 nm, by fog type and wavelength [nm]: Mie theory."""

FOG_LIDAR_RATIO_SR = {
    "strong_advection": {550: 16.6202, 905: 18.1027, 1550: 22.3360},
    "moderate_advection": {550: 17.7597, 905: 18.5747, 1550: 21.8483},
    "strong_spray": {550: 19.1375, 905: 19.6770, 1550: 18.6556},
    "radiation": {550: 19.6731, 905: 17.0421, 1550: 28.3369},
    "chu_hogg": {550: 19.1869, 905: 19.3079, 1550: 21.9273},
}
"""Extinction over backscatter of fog [sr], by fog type and wavelength [nm]: Mie theory; measured 18.8 +- 0.8 sr at
905 nm (O'Connor, Illingworth and Hogan, J. Atmos. Oceanic Technol. 21, 2004)."""


def marshall_palmer(rain_mm_h: float) -> tuple[float, float]:
    """Return N0 [1/m3/mm] and the slope [1/mm] of the drop-size distribution N(D) = N0 exp(-slope D), D in mm.

    Source: Marshall and Palmer, J. Meteorol. 5, 1948.
    """
    return MARSHALL_PALMER_N0, 4.1 * rain_mm_h**-0.21


def rain_extinction(rain_mm_h: float, wavelength_nm: int) -> float:
    """Return the extinction coefficient of rain [1/m], 0 without rain; within 0.2 % of Mie theory below 1 mm/h too.

    Args:
        rain_mm_h: Rain rate [mm/h].
        wavelength_nm: 550, 905 or 1550 [nm].
    """
    at_1_mm_h, exponent = RAIN_EXTINCTION[wavelength_nm]
    return at_1_mm_h * rain_mm_h**exponent if rain_mm_h > 0.0 else 0.0


def fog_extinction(weather: Weather, wavelength_nm: int) -> float:
    """Return the extinction coefficient of fog or haze [1/m]: ln(20) / visibility at 550 nm.

    Args:
        weather: Its visibility and fog type.
        wavelength_nm: 550, 905 or 1550 [nm].

    Source: Koschmieder's law with the contrast threshold of 5 %.
    """
    ratio = FOG_EXTINCTION_RATIO[weather.fog_type][wavelength_nm]
    return -math.log(CONTRAST_THRESHOLD) / weather.visibility_m * ratio


def fog_backscatter(weather: Weather, wavelength_nm: int) -> float:
    """Return the backscatter coefficient of fog or haze [1/m/sr]; see `fog_extinction` for the arguments."""
    return fog_extinction(weather, wavelength_nm) / FOG_LIDAR_RATIO_SR[weather.fog_type][wavelength_nm]


def extinction(weather: Weather, wavelength_nm: int) -> float:
    """Return the extinction coefficient of the weather's rain and fog together [1/m]."""
    return rain_extinction(weather.rain_mm_h, wavelength_nm) + fog_extinction(weather, wavelength_nm)


def rain_visibility(rain_mm_h: float) -> float:
    """Return the meteorological optical range in the drops of rain alone [m]; inf without rain.

    Source: Koschmieder's law over `rain_extinction` at 550 nm; 1.08 km at 25 mm/h.
    """
    return -math.log(CONTRAST_THRESHOLD) / rain_extinction(rain_mm_h, 550) if rain_mm_h > 0.0 else math.inf


def visibility(weather: Weather) -> float:
    """Return the meteorological optical range in a weather [m]: in its fog or haze and its rain together.

    Source: Koschmieder's law over `extinction` at 550 nm.
    """
    return -math.log(CONTRAST_THRESHOLD) / extinction(weather, 550)
