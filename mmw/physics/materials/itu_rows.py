"""Tabulate permittivities by name: Recommendation ITU-R P.2040-4, the paper's grounds at 28 GHz, soils and water of
ITU-R P.527-6, human skin, and the perfect conductor.

A row of P.2040 is `eps_r = a f^b`, `sigma = c f^d` with f in GHz and sigma in S/m, inside its own frequency range. What
holds from 0.5 to 150 GHz outside all ranges of a name is in `mmw.physics.materials.extrapolation`.

Source: ITU-R P.2040-4, section 3, table 3; for the grounds from 26.5 to 29.5 GHz the constants of the
Multimodal-Wireless paper, with those of ITU-R P.527-5; for soils and water `mmw.physics.materials.soil`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from mmw.core.constants import VACUUM_PERMITTIVITY
from mmw.physics.materials import skin
from mmw.physics.materials.soil import MAX_GHZ, MIN_GHZ, Soil, soil_permittivity, water_permittivity

P2040 = "ITU-R P.2040-4, table 3"
P527 = "ITU-R P.527-5, as constants of the Multimodal-Wireless paper at 28 GHz"
P527_MODEL = "ITU-R P.527-6, section 5"
PREFIX = "itu_"
"""Material names carry this in files; the table's names do not."""


@dataclass(frozen=True)
class PermittivityRow:
    """One line of the table: the permittivity in one frequency range."""

    min_ghz: float
    max_ghz: float
    at: Callable[[float], complex]
    """Frequency [Hz] -> complex relative permittivity."""
    source: str = P2040

    @property
    def is_power_law(self) -> bool:
        """True if permittivity and conductivity are powers of the frequency, so that they go on beyond the range."""
        return isinstance(self.at, partial) and self.at.func is power_law

    def holds(self, carrier_hz: float) -> bool:
        """Return whether the range has a frequency [Hz]; both ends belong to it."""
        return self.min_ghz * (1 - 1e-12) <= carrier_hz / 1e9 <= self.max_ghz * (1 + 1e-12)


def complex_permittivity(eps_r: float, sigma: float, carrier_hz: float) -> complex:
    """Return eps_r - j sigma / (2 pi f eps_0), sigma in S/m, for the time convention e^{+jwt}.

    Source: ITU-R P.2040-4, equation 9.
    """
    return complex(eps_r, -sigma / (2.0 * math.pi * carrier_hz * VACUUM_PERMITTIVITY))


def power_law(carrier_hz: float, a: float, b: float, c: float, d: float) -> complex:
    """Return the complex relative permittivity of eps_r = a f^b and sigma = c f^d, f in GHz and sigma in S/m.

    Source: ITU-R P.2040-4, equations 28 and 29.
    """
    ghz = carrier_hz / 1e9
    return complex_permittivity(a * ghz**b, c * ghz**d, carrier_hz)


def _rows(*lines: tuple[float, float, float, float, float, float]) -> tuple[PermittivityRow, ...]:
    return tuple(PermittivityRow(low, high, partial(power_law, a=a, b=b, c=c, d=d)) for low, high, a, b, c, d in lines)


def _paper_ground(eps_r: float, sigma: float) -> PermittivityRow:
    return PermittivityRow(26.5, 29.5, partial(power_law, a=eps_r, b=0.0, c=sigma, d=0.0), P527)


def _soils() -> dict[str, tuple[PermittivityRow, ...]]:
    """Return the four example soils of P.527 at 23 C, dry (0.07 of the volume is water), moist (0.25) and wet (0.5)."""
    textures = {
        # name: sand [%], clay [%], specific gravity, bulk density [g/cm3], where the model of the dry soil starts [GHz]
        "sandy_loam": (51.52, 13.42, 2.66, 1.6006, MIN_GHZ),
        "loam": (41.96, 8.53, 2.70, 1.5781, MIN_GHZ),
        "silty_loam": (30.63, 13.48, 2.59, 1.5750, MIN_GHZ),
        "silty_clay": (5.02, 47.38, 2.56, 1.4758, 1.3),
    }
    rows = {}
    for state, moisture in (("dry", 0.07), ("moist", 0.25), ("wet", 0.5)):
        for name, (sand, clay, gravity, density, dry_from) in textures.items():
            model = partial(soil_permittivity, soil=Soil(sand, clay, moisture, 23.0, gravity, density))
            rows[f"{state}_{name}"] = (
                PermittivityRow(dry_from if state == "dry" else MIN_GHZ, MAX_GHZ, model, P527_MODEL),
            )
    return rows


def _water(temperature_c: float, salinity_g_kg: float) -> tuple[PermittivityRow, ...]:
    model = partial(water_permittivity, temperature_c=temperature_c, salinity_g_kg=salinity_g_kg)
    return (PermittivityRow(MIN_GHZ, MAX_GHZ, model, P527_MODEL),)


def _conductor(carrier_hz: float) -> complex:
    return complex(1.0, -math.inf)


VERY_DRY_28, MEDIUM_DRY_28, WET_28 = _paper_ground(2.5, 0.03), _paper_ground(3.0, 0.4), _paper_ground(3.0, 2.5)

PERMITTIVITY: dict[str, tuple[PermittivityRow, ...]] = {
    # name: (GHz from, GHz to, a, b, c, d), ...
    "vacuum": _rows((0.001, 100, 1, 0, 0, 0)),
    "concrete": _rows((1, 100, 5.24, 0, 0.0462, 0.7822), (110, 330, 5.17, 0, 0.0145, 1.09)),
    "brick": _rows((1, 40, 3.91, 0, 0.0238, 0.16), (110, 330, 4.15, 0, 0.0006, 1.5712)),
    "plasterboard": _rows(
        (1, 100, 2.73, 0, 0.0085, 0.9395), (110, 330, 2.56, 0, 0.0001, 1.7799), (100, 400, 2.65, 0, 0.0002, 1.598)
    ),
    "wood": _rows(
        (0.001, 100, 1.99, 0, 0.0047, 1.0718), (110, 330, 1.82, 0, 0.004, 1.0761), (100, 400, 2.1183, 0, 0.0055, 1.1113)
    ),
    "glass": _rows(
        (0.1, 100, 6.31, 0, 0.0036, 1.3394), (220, 450, 5.79, 0, 0.0004, 1.658), (100, 400, 6.5767, 0, 0.0012, 1.4697)
    ),
    "clear_acrylic": _rows((110, 330, 2.58, 0, 0.0001, 1.6524)),
    "ceiling_board": _rows(
        (1, 100, 1.48, 0, 0.0011, 1.075), (220, 450, 1.52, 0, 0.0029, 1.029), (100, 400, 1.2567, 0, 0.00013, 1.454)
    ),
    "chipboard": _rows((1, 100, 2.58, 0, 0.0217, 0.78), (100, 200, 2.16, 0, 0.0023, 1.359)),
    "plywood": _rows(
        (1, 40, 2.71, 0, 0.33, 0), (110, 330, 1.94, 0, 0.0067, 0.9982), (100, 400, 2.17, 0, 0.0063, 1.045)
    ),
    "marble": _rows(
        (1, 60, 7.074, 0, 0.0055, 0.9262), (110, 330, 7.94, 0, 0.0001, 1.733), (100, 400, 8.62, 0, 0.0027, 1.15)
    ),
    "floorboard": _rows(
        (50, 100, 3.66, 0, 0.0044, 1.3515),
        (220, 300, 5.27, 0, 2.22e-17, 7.3413),
        (300, 400, 5.27, 0, 0.0003, 2.0298),
        (400, 450, 5.27, 0, 49.8726, 0),
        (100, 400, 3.1575, 0, 0.001675, 1.32775),
    ),
    "vinyl_tile": _rows((1, 40, 3.62, 0, 0.0051, 0.8422)),
    "carpet_tile": _rows((1, 40, 2.08, 0, 0.0009, 0.82)),
    "asphalt_concrete": _rows((1, 40, 4.83, 0, 0.0108, 1.3969)),
    "metal": _rows((1, 100, 1, 0, 1e7, 0)),
    "very_dry_ground": (*_rows((1, 10, 3, 0, 0.00015, 2.52)), VERY_DRY_28),
    "medium_dry_ground": (*_rows((1, 10, 15, -0.1, 0.035, 1.63)), MEDIUM_DRY_28),
    "wet_ground": (*_rows((1, 10, 30, -0.4, 0.15, 1.3)), WET_28),
    "very_dry_grnd_28": (VERY_DRY_28,),  # the paper's own names of its 28 GHz grounds
    "medium_dry_grnd_28": (MEDIUM_DRY_28,),
    "wet_grnd_28": (WET_28,),
    **_soils(),
    "fresh_water": _water(20.0, 0.0),
    "sea_water": _water(20.0, 35.0),  # 35 g/kg of salt, the open sea
    "skin": (PermittivityRow(skin.MIN_GHZ, skin.MAX_GHZ, skin.skin_permittivity, "Gabriel et al. 1996, dry skin"),),
    "pec": (PermittivityRow(0.0, math.inf, _conductor, "perfect electric conductor, no Recommendation"),),
}
"""Rows by name; where ranges overlap the first row that holds the frequency counts. `pec` reflects everything at every
frequency: its permittivity is infinite, which `mmw.physics.em.fresnel` supports."""

RADIO_ROWS = tuple(PREFIX + name for name in PERMITTIVITY)
"""Names of all rows as materials give them."""
