"""Compute the permittivity of soil and water by Recommendation ITU-R P.527.

Source: ITU-R P.527-6, sections 5.1.1 (pure water), 5.1.2 (sea water) and 5.2 (soil). The soil equations are the mixing
model of Dobson et al. 1985 with a double-Debye water.
"""

import math
from dataclasses import dataclass

from mmw.core.errors import InputError
from mmw.core.frequency_range import check_frequency_range

MIN_GHZ, MAX_GHZ = 0.001, 1000.0
"""Frequencies that the functions here accept [GHz]: those of the Recommendation, from 1 MHz."""

WATER_TEMPERATURE_C = (-4.0, 40.0)
"""Temperatures of the water model [C]."""

SALINITY_G_KG = (0.0, 40.0)
"""Salinities of the sea water model [g/kg]."""


@dataclass(frozen=True)
class Soil:
    """Soil as P.527 describes it; silt is the rest of sand and clay."""

    sand_percent: float
    clay_percent: float
    moisture: float
    """Volumetric water content, above 0 to 1 [m3/m3]."""
    temperature_c: float = 23.0
    """Temperature [C]."""
    specific_gravity: float = 2.65
    """Mass of the solid grains over that of the same volume of water [-]; 2.5 to 2.7 for common soils."""
    bulk_density_g_cm3: float | None = None
    """Dry mass of a volume of soil [g/cm3]; None estimates it from the texture."""

    def __post_init__(self) -> None:
        shares = (self.sand_percent, self.clay_percent)
        if not (min(shares) >= 0.0 and sum(shares) <= 100.0):
            raise InputError(
                f"soil: sand {self.sand_percent:g} %, clay {self.clay_percent:g} %; each must be at least 0 and both "
                "together at most 100; correct the texture"
            )
        if not 0.0 < self.moisture <= 1.0:
            raise InputError(f"soil: moisture = {self.moisture:g}; above 0 to 1 is needed; give a share of volume")
        for name in ("specific_gravity", "bulk_density_g_cm3"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < math.inf:
                raise InputError(f"soil: {name} = {value:g}; a finite number above 0 is needed; correct it")


def bulk_density(sand_percent: float, clay_percent: float) -> float:
    """Return the estimated dry bulk density of a soil [g/cm3] from its texture [%].

    A constituent of less than 1 % is left out, and the others are scaled to 100 %.

    Source: ITU-R P.527-6, equation 57.
    """
    shares = (sand_percent, clay_percent, 100.0 - sand_percent - clay_percent)
    kept = [share if share >= 1.0 else 0.0 for share in shares]
    factors = (0.078886, 0.038753, 0.032732)
    logs = (c * math.log(100.0 * share / sum(kept)) for c, share in zip(factors, kept, strict=True) if share)
    return 1.07256 + sum(logs)


def water_permittivity(carrier_hz: float, temperature_c: float, salinity_g_kg: float = 0.0) -> complex:
    """Return the complex relative permittivity of fresh or sea water, for e^{+jwt}.

    Args:
        carrier_hz: Frequency, 1 MHz to 1000 GHz [Hz].
        temperature_c: Temperature, -4 to 40 [C].
        salinity_g_kg: Salt, 0 to 40 [g/kg]; 0 is fresh water, 35 the open sea.

    Raises:
        InputError: If an argument is outside its range.

    Source: ITU-R P.527-6, equations 5 to 13 and 14 to 27. The T^3 term of equation 18 is negative here: the plus in
    print is a misprint of Meissner and Wentz 2012, table 7, which their own code corrects (-0.35594e-6).
    """
    ghz = _ghz("water", carrier_hz)
    for name, value, (low, high) in (
        ("temperature_c", temperature_c, WATER_TEMPERATURE_C),
        ("salinity_g_kg", salinity_g_kg, SALINITY_G_KG),
    ):
        if not low <= value <= high:
            raise InputError(f"water: {name} = {value:g}; ITU-R P.527-6 holds from {low:g} to {high:g}; stay inside")
    return _water(ghz, temperature_c, salinity_g_kg)


def soil_permittivity(carrier_hz: float, soil: Soil) -> complex:
    """Return the complex relative permittivity of moist soil, for e^{+jwt}.

    Args:
        carrier_hz: Frequency, 1 MHz to 1000 GHz [Hz].
        soil: The soil.

    Raises:
        InputError: If the frequency is outside its range, or the model's water gets a negative permittivity or loss: it
            does so for dry, sandy soil at low frequencies, where its fit of the conductivity does not hold.

    Source: ITU-R P.527-6, equations 57 to 70.
    """
    ghz = _ghz("soil", carrier_hz)
    sand, clay, moisture, solid = soil.sand_percent, soil.clay_percent, soil.moisture, soil.specific_gravity
    bulk = bulk_density(sand, clay) if soil.bulk_density_g_cm3 is None else soil.bulk_density_g_cm3
    # Conductivity of the soil's water, between its values below and above 1.35 GHz (equations 67 to 70).
    low = 0.0467 + 0.2204 * bulk - 0.004111 * sand - 0.006614 * clay
    high = -1.645 + 1.939 * bulk - 0.0225622 * sand + 0.01594 * clay
    step = (low - high) / (1.0 + (ghz / 1.35) ** 2)
    share = 18.0 / ghz * (solid - bulk) / (solid * moisture)
    water = _water(ghz, soil.temperature_c, 0.0)
    real, loss = water.real + share * step * ghz / 1.35, -water.imag + share * (high + step)
    if real < 0.0 or loss < 0.0:
        raise InputError(
            f"soil: {sand:g} % sand, {clay:g} % clay, moisture {moisture:g} has no value at {ghz:g} GHz: the water's "
            f"permittivity would be {real:.3g} - j {loss:.3g} (ITU-R P.527-6, equations 65 and 66); both parts must be "
            "positive; use a moister soil, a higher frequency, or the model `constant`"
        )
    alpha = 0.65
    beta_real = 1.2748 - 0.00519 * sand - 0.00152 * clay
    beta_loss = 1.33797 - 0.00603 * sand - 0.00166 * clay
    grains = (1.01 + 0.44 * solid) ** 2 - 0.062
    mixture = 1.0 + bulk / solid * (grains**alpha - 1.0) + moisture**beta_real * real**alpha - moisture
    return complex(mixture ** (1.0 / alpha), -((moisture**beta_loss * loss**alpha) ** (1.0 / alpha)))


def _ghz(what: str, carrier_hz: float) -> float:
    return float(check_frequency_range(carrier_hz, MIN_GHZ, MAX_GHZ, what, "ITU-R P.527-6"))


def _water(ghz: float, t: float, s: float) -> complex:
    """Return the permittivity of water with salt s [g/kg] at t [C], as the sum of two Debye relaxations."""
    theta = 300.0 / (t + 273.15) - 1.0
    static, infinite = 77.66 + 103.3 * theta, 3.52 - 7.52 * theta
    middle = 0.0671 * static
    f1 = 20.20 - 146.4 * theta + 316.0 * theta**2
    f2 = 39.8 * f1
    sigma = 0.0
    if s:
        static *= math.exp(-3.33330e-3 * s + 4.74868e-6 * s**2)
        middle *= math.exp(-6.28908e-3 * s + 1.76032e-4 * s**2 - 9.22144e-5 * t * s)
        infinite *= 1.0 + s * (-2.04265e-3 + 1.57883e-4 * t)
        f1 *= 1.0 + s * (2.3232e-3 - 7.9208e-5 * t + 3.6764e-6 * t**2 - 3.5594e-7 * t**3 + 8.9795e-9 * t**4)
        f2 *= 1.0 + s * (-1.99723e-2 + 1.81176e-4 * t)
        sigma = _sea_conductivity(t, s)
    return (
        infinite
        + (static - middle) / (1.0 + 1j * ghz / f1)
        + (middle - infinite) / (1.0 + 1j * ghz / f2)
        - 18j * sigma / ghz
    )


def _sea_conductivity(t: float, s: float) -> float:
    """Return the conductivity of sea water with salt s [g/kg] at t [C], in S/m (equations 22 to 27)."""
    at_35 = 2.903602 + 8.607e-2 * t + 4.738817e-4 * t**2 - 2.991e-6 * t**3 + 4.3047e-9 * t**4
    at_15 = s * (37.5109 + 5.45216 * s + 1.4409e-2 * s**2) / (1004.75 + 182.283 * s + s**2)
    alpha_0 = (6.9431 + 3.2841 * s - 9.9486e-2 * s**2) / (84.850 + 69.024 * s + s**2)
    alpha_1 = 49.843 - 0.2276 * s + 0.198e-2 * s**2
    return at_35 * at_15 * (1.0 + alpha_0 * (t - 15.0) / (alpha_1 + t))
