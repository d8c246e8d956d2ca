"""Tabulate radar reflectivity of surfaces: reflection, slope and diffuse share of every material, dry or wet.

A surface is rough on the scale of the wave: facets with normally distributed slopes reflect the wave back where they
face the radar, and a share of what the surface reflects is scattered by Lambert's law instead. How much it reflects is
|Gamma0|^2, the reflection at normal incidence: of the permittivity that the radio channel uses, where that is known at
the carrier, else of a table by non-visual base.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mmw.core.errors import InputError
from mmw.physics.em.surface_response import material_response
from mmw.physics.materials.material import POROUS_BASES, Material
from mmw.physics.materials.permittivity import has_permittivity
from mmw.physics.materials.soil import WATER_TEMPERATURE_C, water_permittivity
from mmw.physics.weather.weather import Weather


@dataclass(frozen=True)
class Roughness:
    """Scattering of a surface at 77 GHz. Design values, after the usual range of each kind of surface."""

    slope: float
    """Root mean square slope of the facets [-]."""
    gamma0: float
    """|Gamma0| where the material has no permittivity at the carrier [-]."""
    diffuse_share: float
    """Share of the reflected power that is scattered by Lambert's law, 0 to 1 [-]."""
    porosity: float = 0.0
    """Pores near the surface that rain fills, share of the volume [-]."""
    is_volume: bool = False
    """True if a volume of leaves scatters rather than a surface: `gamma0` counts, whatever the permittivity."""


_METAL = Roughness(0.08, 0.95, 0.02)
_GLASS = Roughness(0.03, 0.60, 0.005)
_LEAVES = Roughness(0.50, 0.22, 1.0, is_volume=True)
_SOIL = Roughness(0.30, 0.45, 0.20, porosity=0.30)

ROUGHNESS: dict[str, Roughness] = {
    "asphalt": Roughness(0.15, 0.35, 0.08, porosity=0.08),
    "concrete": Roughness(0.20, 0.40, 0.30, porosity=0.12),
    "brick": Roughness(0.20, 0.33, 0.30, porosity=0.15),
    "stone": Roughness(0.15, 0.45, 0.20, porosity=0.05),
    "marble": Roughness(0.08, 0.45, 0.05),
    "clear_glass": _GLASS,
    "one_way_mirror": _GLASS,
    "mirror": _METAL,
    "leaf_grass": _LEAVES,
    "dead_leaf_grass": _LEAVES,
    "soil": _SOIL,
    "dirt": _SOIL,
    "mud": Roughness(0.20, 0.60, 0.10, porosity=0.30),
    "gravel": Roughness(0.40, 0.40, 0.50, porosity=0.15),
    "wood": Roughness(0.15, 0.25, 0.20, porosity=0.10),
    "bark": Roughness(0.40, 0.25, 0.50, porosity=0.10),
    "plastic": Roughness(0.08, 0.23, 0.02),
    "plexiglass": Roughness(0.05, 0.24, 0.01),
    "rubber": Roughness(0.20, 0.27, 0.10),
    "aluminum": _METAL,
    "steel": _METAL,
    "oxidized_steel": Roughness(0.15, 0.90, 0.05),
    "iron": Roughness(0.12, 0.95, 0.03),
    "fiberglass": Roughness(0.08, 0.35, 0.03),
    "retroreflective": Roughness(0.08, 0.90, 0.05),
    "none": Roughness(0.30, 0.55, 0.10),
}
"""SimReady non-visual base -> roughness; `none` is for people: skin and cloth."""

BODYWORK = Roughness(0.25, 0.95, 0.30)
"""Painted metal. Meshes leave out the seams, handles, grilles and cavities of bodywork, and rays that bounce twice: a
larger slope and diffuse share represent them, such that the shipped cars have 0 to 20 dBsm from every side, a mean of
8 to 11, and the box truck 16. Design value."""

METALS = ("aluminum", "steel", "oxidized_steel", "iron")
"""Non-visual bases of metal."""

FILM_SMOOTHING = 0.5
"""Share of the diffuse part that the water film of a soaked surface removes: it fills the texture. Design value."""


WET_ROWS = ("itu_wet_", "itu_fresh_water", "itu_sea_water")
"""Prefixes of the names of radio rows whose permittivity is that of a wet material."""


def roughness_of(material: Material) -> Roughness:
    """Return how a material scatters.

    Raises:
        ValueError: If its base has no row in `ROUGHNESS`.
    """
    if material.nonvisual_base not in ROUGHNESS:
        raise InputError(
            f"material {material.name!r}: base {material.nonvisual_base!r} has no radar row; needed is one of "
            f"{', '.join(ROUGHNESS)}; use one of them, or `none`"
        )
    if material.nonvisual_base in METALS and material.coating != "none":
        return BODYWORK
    return ROUGHNESS[material.nonvisual_base]


def normal_reflection(material: Material, carrier_hz: float) -> complex:
    """Return the reflection coefficient of a dry material at normal incidence, from its permittivity or the table.

    Panes let a part of the wave through and reflect at both faces, as in the radio channel.
    """
    roughness, radio = roughness_of(material), material.seen_by_radar
    if roughness.is_volume or not has_permittivity(radio, carrier_hz):
        return complex(roughness.gamma0)
    response = material_response(radio, carrier_hz, material.name)
    _, tm = response.reflection(np.zeros(1, dtype=np.int64), np.ones(1))
    return complex(tm[0])


def takes_water(material: Material, carrier_hz: float) -> bool:
    """Return whether rain changes a material: it has pores, no paint on them, and no wet permittivity already."""
    radio = material.seen_by_radar
    is_wet = radio.model == "itu" and radio.itu.startswith(WET_ROWS) and has_permittivity(radio, carrier_hz)
    return material.nonvisual_base in POROUS_BASES and material.coating == "none" and not is_wet


def reflectivity_table(materials: Sequence[Material], weather: Weather, carrier_hz: float) -> np.ndarray:
    """Return the arguments of `mmw.kernels.radar.trace.backscatter` of every material in one weather.

    Water in pores adds to the refractive index in proportion to its share of the volume, and its film removes a part of
    the diffuse scattering away. Materials of P.527's wet soils are wet already and stay as they are.

    Args:
        materials: Materials by id, as they are in the weather.
        weather: Its wetness and temperature; water below -4 C or above 40 C counts as water of that temperature.
        carrier_hz: Carrier frequency [Hz].

    Returns:
        |Gamma0|^2 (1 - k) / 2 s^2, 1 / 2 s^2 and 4 k |Gamma0|^2 with s the slope and k the diffuse share, shape [M, 3],
        float32.

    Raises:
        ValueError: If there are no materials, or one has a base without a row in `ROUGHNESS`.

    Source: refractive mixing, J. Birchak et al., "High dielectric constant microwave probes for sensing soil moisture",
    Proc. IEEE 62(1), 1974.
    """
    if not materials:
        raise ValueError("radar: no materials; every id of the scene needs one; pass arrays.materials[weather]")
    low, high = WATER_TEMPERATURE_C
    water = np.sqrt(water_permittivity(carrier_hz, min(max(weather.temperature_c, low), high)))
    table = np.empty((len(materials), 3), dtype=np.float32)
    for index, material in enumerate(materials):
        roughness = roughness_of(material)
        gamma, diffuse = normal_reflection(material, carrier_hz), roughness.diffuse_share
        is_conductor = gamma == 1.0
        if weather.wetness > 0.0 and takes_water(material, carrier_hz) and not is_conductor:
            dry_index = (1.0 + gamma) / (1.0 - gamma)
            wet_index = dry_index + roughness.porosity * weather.wetness * (water - 1.0)
            gamma = (wet_index - 1.0) / (wet_index + 1.0)
            diffuse *= 1.0 - FILM_SMOOTHING * weather.wetness
        power, steepness = abs(gamma) ** 2, 0.5 / roughness.slope**2
        table[index] = power * (1.0 - diffuse) * steepness, steepness, 4.0 * diffuse * power
    return table
