"""One material, described for every sensor: radio, LiDAR and image. Names and numbers come from the USD Material."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

ScatteringPattern = Literal["lambertian", "directive", "backscattering"]


@dataclass(frozen=True)
class RadioMaterial:
    """Electromagnetic description of a surface; the permittivity at a carrier follows in `mmw.channel.materials`."""

    model: Literal["itu", "constant"]
    """`itu`: a named row of ITU-R P.2040, of P.527, or of the paper, or `itu_pec`; `constant`: the two numbers below at
    every frequency."""
    itu: str = ""
    """Row name with its prefix, such as `itu_concrete`; `itu_pec` is the perfect conductor; empty for `constant`."""
    relative_permittivity: float = 1.0
    """Real part of the relative permittivity, for `constant` [-]."""
    conductivity: float = 0.0
    """Conductivity, for `constant` [S/m]."""
    thickness: float = 0.0
    """Slab thickness [m]; 0 means a half-space, which lets nothing through."""
    scattering: float = 0.0
    """Scattering coefficient S, 0 to 1 [-]."""
    xpd: float = 0.0
    """Cross-polarisation coefficient of scattering, 0 to 1 [-]."""
    scattering_pattern: ScatteringPattern = "lambertian"
    """Where scattered power goes: `lambertian` cos theta_s around the normal; `directive` a lobe around the reflected
    direction; `backscattering` that lobe and one back to where the wave came from."""
    alpha_r: int = 4
    """Exponent of the lobe around the reflection, at least 1 [-]; a larger one is narrower."""
    alpha_i: int = 4
    """Exponent of the lobe back to the source, at least 1 [-]; only `backscattering` has it."""
    lobe_share: float = 1.0
    """Share Lambda of the lobe around the reflection in `backscattering`, 0 to 1 [-].

    Source of the patterns: Degli-Esposti et al., IEEE Trans. Antennas Propag. 55(1), 2007."""


@dataclass(frozen=True)
class Material:
    """What one surface is to every sensor."""

    name: str
    """Name of the USD Material prim."""
    radio: RadioMaterial
    nonvisual_base: str
    """SimReady non-visual base token (`omni:simready:nonvisual:base`), such as `asphalt`; `none` where it is absent."""
    lidar_reflectance: float
    """Diffuse reflectance at 905 nm, 0 to 1 [-]."""
    color: tuple[float, float, float]
    """Linear diffuse colour, 0 to 1 [-]."""
    coating: str = "none"
    """SimReady coating token: none, paint, clearcoat or paint_clearcoat."""
    is_retroreflective: bool = False
    """Whether the surface sends light back to where it came from."""


LIDAR_REFLECTANCE_905NM = {
    "asphalt": 0.17, "concrete": 0.37, "brick": 0.38, "stone": 0.45, "marble": 0.55, "clear_glass": 0.08,
    "one_way_mirror": 0.12, "mirror": 0.10, "leaf_grass": 0.50, "dead_leaf_grass": 0.35, "soil": 0.25, "dirt": 0.25,
    "mud": 0.15, "gravel": 0.30, "wood": 0.45, "bark": 0.35, "plastic": 0.40, "plexiglass": 0.15, "rubber": 0.05,
    "aluminum": 0.60, "steel": 0.55, "oxidized_steel": 0.30, "iron": 0.35, "fiberglass": 0.45, "retroreflective": 0.95,
    "none": 0.30,
}  # fmt: skip
"""Diffuse reflectance at 905 nm by non-visual base token: typical laboratory values of spectral libraries (ECOSTRESS
class means, rounded to 0.05 where classes scatter more); design values where a class has no entry."""

PAINT_REFLECTANCE_905NM = (0.05, 0.80)
"""Diffuse reflectance at 905 nm of the blackest and of the whitest paint: carbon black absorbs in the near infrared as
in the visible, titanium dioxide scatters in both. Design values."""


def lidar_reflectance(
    base: str, coating: str = "none", attributes: Sequence[str] = (), color: Sequence[float] = (0.5, 0.5, 0.5)
) -> float:
    """Return the diffuse reflectance at 905 nm of a material, from its SimReady non-visual tokens and its colour.

    A painted surface (coating `paint` or `paint_clearcoat`) hides its base: the value runs linearly between the two of
    `PAINT_REFLECTANCE_905NM` with the brightest colour channel. The brightest, not the luminance, because coloured
    organic pigments let the near infrared through to the white below while black does not; so red and blue cars return
    more than black ones. A `retroreflective` attribute overrides both.

    Args:
        base: Token of `omni:simready:nonvisual:base`.
        coating: Token of `omni:simready:nonvisual:coating`: none, paint, clearcoat or paint_clearcoat.
        attributes: Tokens of `omni:simready:nonvisual:attributes`.
        color: Linear diffuse colour, 0 to 1 [-], shape [3].

    Returns:
        Reflectance, 0 to 1 [-].

    Raises:
        ValueError: If the base token has no row in `LIDAR_REFLECTANCE_905NM`.
    """
    if base not in LIDAR_REFLECTANCE_905NM:
        known = ", ".join(sorted(LIDAR_REFLECTANCE_905NM))
        raise ValueError(
            f"omni:simready:nonvisual:base = {base!r}; needed is one of {known}; use one of them, or `none`"
        )
    if "retroreflective" in attributes:
        return LIDAR_REFLECTANCE_905NM["retroreflective"]
    if coating in ("paint", "paint_clearcoat"):
        black, white = PAINT_REFLECTANCE_905NM
        return black + (white - black) * min(max(*color, 0.0), 1.0)
    return LIDAR_REFLECTANCE_905NM[base]
