"""Describe the materials of the library for radio waves beyond the paper: walls, panes, rough ground, water films.

The paper's table of materials has smooth half-spaces. The presets of `channel.physics` beyond `paper` use these
descriptions instead, for materials of the library only; what a user says of a material stands above them. LiDARs,
cameras and radars see no difference.

Each number has a source, or says that it is an engineering value. Walls of the shipped towns are single surfaces, so a
facade is a whole wall; props are closed bodies, of which a ray meets two faces, so each of their faces has half the
material.
"""

from dataclasses import dataclass, replace
from typing import Any

from mmw.physics.materials.material import WATER_FILM_M, RadioMaterial
from mmw.usd.material_library import LIBRARY, PAINTS

WET_GROUND = "itu_wet_ground"
"""Row that a weather of the shipped towns gives to ground that is wet."""


@dataclass(frozen=True)
class StandardMaterial:
    """Radio description of one material of the library beyond the paper's."""

    radio: RadioMaterial
    """In dry weather."""
    source: str
    """Source of the substance, and of thickness, layers and roughness."""
    wet: RadioMaterial | None = None
    """In a weather that wets the ground; None for a material that no weather changes."""


LOBES: dict[str, Any] = {"scattering_pattern": "directive", "alpha_r": 4, "xpd": 0.1}
"""A lobe around the reflection, and a tenth of the scattered power in the other polarization."""

LOBES_SOURCE = (
    "S, lobe and xpd: engineering values, for the directive model of Degli-Esposti et al., IEEE Trans. AP 55(1), 2007"
)
"""Source of scattering coefficients and lobes."""

ROUGH_SOURCE = "rms height: engineering value"
"""Source of the roughness of ground and walls."""

FILM = f"itu_fresh_water {WATER_FILM_M:g}"
"""Water on soaked, drained ground: the film that LiDARs see too."""

FILM_SOURCE = "water: ITU-R P.527-6, 5.1.1; film as in `mmw.physics.materials.material.WATER_FILM_M`, a design value"

WET_ROUGHNESS = 0.5
"""Share of the roughness that a film of water leaves; engineering value, as `FILM_SMOOTHING` of radars."""


def _ground(row: str, rms_height: float, source: str, *front: str) -> StandardMaterial:
    """Return ground that goes on forever below, with a film of water and half the roughness when it is wet."""
    dry = RadioMaterial("itu", itu=row, rms_height=rms_height, layers=front, **LOBES)
    wet = replace(dry, rms_height=WET_ROUGHNESS * rms_height, layers=(FILM, *front))
    return StandardMaterial(dry, f"{source}; {ROUGH_SOURCE}; {FILM_SOURCE}; lobe: {LOBES_SOURCE}", wet)


def _soil(name: str, moist: str, rms_height: float, source: str) -> StandardMaterial:
    """Return soil, whose pores take the water when it rains."""
    dry = RadioMaterial("itu", itu=moist, rms_height=rms_height, **LOBES)
    wet = replace(dry, itu="itu_wet_loam")
    text = f"{name}: ITU-R P.527-6, 5.2, loam, {source}; {ROUGH_SOURCE}; lobe: {LOBES_SOURCE}"
    return StandardMaterial(dry, text, wet)


def _wall(row: str, thickness: float, scattering: float, rms_height: float, *front: str) -> RadioMaterial:
    """Return a wall, outermost layer first, which scatters."""
    return RadioMaterial(
        "itu", itu=row, thickness=thickness, scattering=scattering, rms_height=rms_height, layers=front, **LOBES
    )


def _entry(radio: RadioMaterial, source: str) -> StandardMaterial:
    return StandardMaterial(radio, f"{source}; {LOBES_SOURCE}; {ROUGH_SOURCE}" if radio.scatters else source)


P2040 = "ITU-R P.2040-4, table 3"
CONSTRUCTION = "thicknesses: engineering values of common construction"
_CLOTH = StandardMaterial(
    RadioMaterial("itu", itu="itu_skin", layers=("constant 1.7 0.05 0.001", "itu_vacuum 0.002")),
    "dry skin of Gabriel et al. 1996 below 1 mm of cotton and 2 mm of air; permittivity of cotton and thicknesses: "
    "engineering values",
)
_LENS = StandardMaterial(
    RadioMaterial("itu", itu="itu_metal", layers=("constant 2.8 0.01 0.003", "itu_vacuum 0.03")),
    "3 mm of polycarbonate and 30 mm of air before a metal reflector or board: engineering values",
)
_PLASTIC = StandardMaterial(
    RadioMaterial("constant", relative_permittivity=2.5, conductivity=0.001, thickness=0.003),
    "permittivity of the library, a design value; shell of 3 mm: engineering value",
)

STANDARD: dict[str, StandardMaterial] = {
    # Ground.
    "asphalt": _ground("itu_asphalt_concrete", 0.0004, f"{P2040}, asphalt concrete"),
    "road_marking": _ground(
        "itu_asphalt_concrete",
        0.0002,
        f"{P2040}, asphalt concrete, below 3 mm of thermoplastic: engineering value",
        "constant 3.5 0.05 0.003",
    ),
    "concrete_sidewalk": _ground("itu_concrete", 0.0003, f"{P2040}, concrete"),
    "curb": _ground("itu_concrete", 0.0003, f"{P2040}, concrete"),
    "grass": _soil("soil of a lawn", "itu_moist_loam", 0.005, "0.25 of water by volume: engineering value"),
    "soil": _soil("bare soil", "itu_dry_loam", 0.01, "0.07 of water by volume"),
    # Buildings.
    "concrete_facade": _entry(
        _wall("itu_concrete", 0.2, 0.3, 0.0003), f"{P2040}, concrete; wall of 200 mm: engineering value"
    ),
    "brick_facade": _entry(
        _wall(
            "itu_plasterboard",
            0.0125,
            0.3,
            0.0008,
            "itu_brick 0.102",
            "itu_vacuum 0.05",
            "itu_brick 0.102",
            "itu_vacuum 0.01",
        ),
        f"{P2040}, brick and plasterboard; cavity wall of two leaves of 102 mm: {CONSTRUCTION}",
    ),
    "marble_facade": _entry(
        _wall("itu_concrete", 0.2, 0.2, 0.0001, "itu_marble 0.03", "itu_vacuum 0.04"),
        f"{P2040}, marble and concrete; panels of 30 mm before a cavity and a wall of 200 mm: {CONSTRUCTION}",
    ),
    "concrete_structure": _entry(
        RadioMaterial("itu", itu="itu_concrete", scattering=0.2, rms_height=0.0003, **LOBES),
        f"{P2040}, concrete, too thick to let anything through",
    ),
    "window_glass": _entry(
        RadioMaterial("itu", itu="itu_glass", thickness=0.004, layers=("itu_glass 0.004", "itu_vacuum 0.016")),
        f"{P2040}, glass; double glazing 4-16-4 mm without a coat: {CONSTRUCTION}",
    ),
    "glass_facade": _entry(
        RadioMaterial(
            "itu", itu="itu_glass", thickness=0.006, layers=("itu_glass 0.006", "sheet 8", "itu_vacuum 0.016")
        ),
        f"{P2040}, glass; double glazing 6-16-6 mm with a low-emissivity coat of 8 ohm/square on the inner side of the "
        "outer pane: engineering value, such that the loss is about that of 3GPP TR 38.901, table 7.4.3-1, IRR glass, "
        "and the 30 dB that Kiani et al. 2008 measure from 0.8 to 6 GHz",
    ),
    "clear_pane": _entry(
        RadioMaterial("itu", itu="itu_glass", thickness=0.003),
        f"{P2040}, glass; 6 mm as two faces of 3 mm: engineering value",
    ),
    "concrete_roof": _entry(
        _wall("itu_concrete", 0.2, 0.2, 0.0003), f"{P2040}, concrete; slab of 200 mm: engineering value"
    ),
    "tile_roof": _entry(
        _wall(
            "itu_plasterboard",
            0.0125,
            0.4,
            0.001,
            "itu_brick 0.015",
            "itu_vacuum 0.05",
            "itu_wood 0.02",
            "itu_vacuum 0.15",
        ),
        f"{P2040}, brick, wood and plasterboard; tiles of 15 mm over boards of 20 mm: {CONSTRUCTION}",
    ),
    # Street furniture.
    "wood": _entry(
        _wall("itu_wood", 0.02, 0.2, 0.0002), f"{P2040}, wood; 40 mm as two faces of 20 mm: engineering value"
    ),
    "bark": StandardMaterial(
        RadioMaterial("itu", itu="itu_wood", scattering=0.5, rms_height=0.005, xpd=0.2),
        f"{P2040}, wood; a trunk is too thick to let anything through; Lambertian S, rms height and xpd: engineering "
        "values",
    ),
    "plastic": _PLASTIC,
    "shop_sign": _PLASTIC,
    "street_lamp_lens": _LENS,
    **dict.fromkeys(("signal_red", "signal_red_dark", "signal_amber", "signal_green", "signal_green_lit"), _LENS),
    # Vehicles.
    "car_glass": _entry(
        RadioMaterial(
            "itu", itu="itu_glass", thickness=0.0021, layers=("itu_glass 0.0021", "constant 2.8 0.01 0.00076")
        ),
        f"{P2040}, glass; laminated 2.1-0.76-2.1 mm with polyvinyl butyral: engineering values",
    ),
    **dict.fromkeys(
        ("car_light_front", "car_light_rear", "car_light_brake", "car_light_clear", "car_light_amber"), _LENS
    ),
    # People.
    **dict.fromkeys([name for name in LIBRARY if name.startswith("cloth_")], _CLOTH),
}
"""Material name -> its description beyond the paper's."""

_METAL = "bare or painted metal is opaque and smooth at these wavelengths: ITU-R P.2040-4, table 3, metal"

UNCHANGED: dict[str, str] = {
    **dict.fromkeys(
        (
            "manhole_cover", "drain_grate", "metal_fascia", "metal_pole", "sign_face", "traffic_light_metal",
            "car_trim", "car_gloss", "car_mirror", "car_rim", "car_plate", "truck_lettering", "bus_sign",
            *(f"car_paint_{paint}" for paint in PAINTS),
        ),
        _METAL,
    ),
    **dict.fromkeys(("skin", "skin_light", "skin_dark", "lips"), "dry skin at any carrier: Gabriel et al. 1996"),
    **dict.fromkeys(
        ("hair", "hair_brown", "hair_fair"), "skin below decides: no published permittivity of hair was found"
    ),
    "car_rubber": "permittivity of the library, a design value: no source for filled rubber was read",
    **dict.fromkeys(
        [name for name in LIBRARY if name.startswith("foliage")], "leaves are no surface; crowns are described apart"
    ),
}  # fmt: skip
"""Material name -> why its description stays that of the paper."""


def standard_radio(name: str, radio: RadioMaterial) -> RadioMaterial:
    """Return what a material of the library is beyond the paper, and what it is if something changed it on purpose.

    Args:
        name: Name in the library.
        radio: What the stage says of it in the weather: the library's own values, those of wet ground, or others, which
            then stay.
    """
    entry = STANDARD.get(name)
    if entry is None:
        return radio
    dry = LIBRARY[name].radio
    if radio == dry:
        return entry.radio
    if entry.wet is not None and radio == replace(dry, model="itu", itu=WET_GROUND):
        return entry.wet
    return radio
