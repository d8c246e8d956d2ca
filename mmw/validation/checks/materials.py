"""Compare what walls reflect and let through with measurements and 3GPP TR 38.901."""

from collections.abc import Callable

import numpy as np

from mmw.core.constants import SPEED_OF_LIGHT
from mmw.physics.em.surface_response import material_response
from mmw.physics.materials.itu_rows import PREFIX
from mmw.physics.materials.material import RadioMaterial
from mmw.physics.materials.permittivity import relative_permittivity
from mmw.usd.standard_materials import STANDARD
from mmw.usd.standard_materials_docs import TR38901_DB, penetration_loss_db
from mmw.validation.check import Check, Measurement, Reference, Source

TR38901 = Source(
    "3GPP TR 38.901", "tables 7.4.3-1 and 7.4.3-2 (spread)", "https://www.3gpp.org/dynareport/38901.htm", "other code"
)
ZHAO = Source(
    "Zhao et al., 28 GHz measurements for reflection and penetration loss in and around buildings in New York City, "
    "ICC 2013", "abstract; table I", "https://doi.org/10.1109/ICC.2013.6655403", "abstract",
)  # fmt: skip
DU = Source(
    "Du et al., Sub-terahertz and mmWave penetration loss measurements for indoor environments, 2021", "abstract",
    "https://arxiv.org/abs/2103.02745", "abstract",
)  # fmt: skip
RYAN = Source(
    "Ryan, MacCartney and Rappaport, Indoor office wideband penetration loss measurements at 73 GHz, 2017", "abstract",
    "https://arxiv.org/abs/1703.08030", "abstract",
)  # fmt: skip

LOW_LOSS_SPREAD_DB, HIGH_LOSS_SPREAD_DB = 4.4, 6.5
"""Standard deviations of the low-loss and the high-loss model of buildings, TR 38.901, table 7.4.3-2 [dB]."""

ZHAO_DEG = 10.0
"""Angle of incidence of the measured reflections [deg]."""

DB_PER_NEPER = 20.0 / np.log(10.0)


def _penetration(material: str, carrier_hz: float) -> Callable[[str], Measurement]:
    faces = TR38901_DB[material][1]
    return lambda device: Measurement(faces * penetration_loss_db(STANDARD[material].radio, carrier_hz))


def _tr38901_row(material: str, ghz: float, spread_db: float, known_red: str = "") -> Check:
    name, _, constant, slope = TR38901_DB[material]
    expected = constant + slope * ghz
    return Check(
        name=f"materials.{material}_{ghz:g}ghz",
        title=f"Loss through {name.partition(',')[0]} at {ghz:g} GHz",
        computed=f"`{material}` of the standard materials at normal incidence, both polarizations, 30 % of band",
        unit="dB",
        reference=Reference.plus_minus(expected, spread_db),
        tolerance=f"the standard deviation of buildings in that model, {spread_db:g} dB",
        sources=(TR38901,),
        measure=_penetration(material, 1e9 * ghz),
        known_red=known_red,
    )


def _reflection(radio: RadioMaterial, carrier_hz: float, degrees: float) -> Callable[[str], Measurement]:
    def measure(device: str) -> Measurement:
        cosine, index = np.array([np.cos(np.radians(degrees))]), np.zeros(1, dtype=np.int64)
        te, _ = material_response(radio, carrier_hz).reflection(index, cosine)
        return Measurement(float(np.abs(te[0])))

    return measure


def _zhao_row(
    name: str, title: str, radio: RadioMaterial, reference: float, computed: str, known_red: str = ""
) -> Check:
    return Check(
        name=f"materials.reflection_{name}",
        title=f"Reflection of {title} at 28 GHz",
        computed=f"{computed}; |Gamma| at {ZHAO_DEG:g} degrees, electric field along the surface",
        unit="",
        reference=Reference(reference, reference - 0.15, min(reference + 0.15, 1.0)),
        tolerance="1.5 dB of a strong reflection: panes of one kind differ by as much",
        sources=(ZHAO,),
        measure=_reflection(radio, 28e9, ZHAO_DEG),
        known_red=known_red,
    )


def attenuation_db_per_cm(row: str, carrier_hz: float) -> float:
    """Return what a plane wave loses inside a substance [dB/cm].

    Args:
        row: Row of ITU-R P.2040, such as `glass`.
        carrier_hz: Carrier frequency [Hz].

    Source: the imaginary part of the wave number, k = 2 pi f sqrt(eps_r) / c.
    """
    permittivity = complex(relative_permittivity(RadioMaterial("itu", itu=PREFIX + row), carrier_hz, row))
    return float(-2.0 * np.pi * carrier_hz / SPEED_OF_LIGHT * np.sqrt(permittivity).imag * DB_PER_NEPER / 100.0)


def _range_at_73ghz(device: str) -> Measurement:
    values = {row: attenuation_db_per_cm(row, 73e9) for row in ("glass", "wood", "chipboard", "plasterboard")}
    text = ", ".join(f"{row} {value:.2g} dB/cm" for row, value in values.items())
    return Measurement(max(values.values()), text)


CHECKS = (
    _tr38901_row("window_glass", 28.0, LOW_LOSS_SPREAD_DB),
    _tr38901_row("glass_facade", 28.0, HIGH_LOSS_SPREAD_DB),
    _tr38901_row("concrete_facade", 4.9, HIGH_LOSS_SPREAD_DB),
    _tr38901_row(
        "concrete_facade", 28.0, HIGH_LOSS_SPREAD_DB,
        known_red="P.2040's concrete loses 4.3 dB/cm at 28 GHz, so that a wall of 200 mm has 87 dB; the line of TR "
        "38.901 is a fit of walls of unknown thickness. Nothing comes through either; a wall of 270 mm would agree",
    ),
    _tr38901_row("wood", 28.0, LOW_LOSS_SPREAD_DB),
    _zhao_row(
        "tinted_glass", "tinted glass", STANDARD["glass_facade"].radio, 0.896,
        "`glass_facade` of the standard materials, a double pane with a metal film",
    ),
    Check(
        name="materials.glass_144ghz",
        title="Attenuation in clear glass at 144 GHz",
        computed="row `itu_glass` of P.2040, extrapolated beyond its 100 GHz",
        unit="dB/cm",
        reference=Reference.within_factor(27.633, 2.0),
        tolerance="a factor 2: the loss of soda-lime glasses differs by as much, and the row ends at 100 GHz",
        sources=(DU,),
        measure=lambda device: Measurement(attenuation_db_per_cm("glass", 144e9)),
        known_red="the row has 0.4 of the measured loss; P.2040 has no glass from 100 to 220 GHz. A row of its own for "
        "soda-lime glass at 100 to 220 GHz, from measured permittivities, would mend it",
    ),
    Check(
        name="materials.range_73ghz",
        title="Attenuation in common materials at 73 GHz, the largest",
        computed="rows glass, wood, chipboard and plasterboard of P.2040",
        unit="dB/cm",
        reference=Reference(9.9, 0.8, 9.9),
        tolerance="the measured range of 21 places and six materials, co-polarized",
        sources=(RYAN,),
        measure=_range_at_73ghz,
    ),
)  # fmt: skip
"""Rows of this topic."""
