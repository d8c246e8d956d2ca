"""The material library: every surface of the shipped towns and vehicles, described once for radio, LiDAR and image."""

from dataclasses import dataclass

from mmw.physics.materials.appearance import Lamp
from mmw.physics.materials.material import RadioMaterial

ROOT = "/Materials"
"""Prim that holds the library's Material prims."""

LIBRARY_FILE = "materials.usda"
"""Name of the library's layer, which datasets copy beside their stages."""

NONVISUAL = "omni:simready:nonvisual:"
"""Prefix of the SimReady attributes that LiDAR and radar simulators read from a Material prim."""


LAMP = "mmw:lamp"
"""Attribute of a Material prim that says when its emission shines: none for always, or the kind of lamp."""


@dataclass(frozen=True)
class MaterialSpec:
    """One material of the library: what `write_material` writes on one Material prim."""

    radio: RadioMaterial
    base: str
    """SimReady base token, a key of `mmw.physics.materials.material.LIDAR_REFLECTANCE_905NM`."""
    color: tuple[float, float, float]
    """Linear diffuse color, 0 to 1 [-]."""
    roughness: float
    """GGX roughness of the picture, 0 to 1 [-]."""
    metallic: float = 0.0
    """0 for a dielectric, 1 for a bare metal [-]."""
    opacity: float = 1.0
    """1 for opaque [-]."""
    clearcoat: float = 0.0
    """Strength of a lacquer layer [-]."""
    coating: str = "none"
    """SimReady coating token: none, paint, clearcoat or paint_clearcoat."""
    attributes: tuple[str, ...] = ("none",)
    """SimReady attribute tokens: none, emissive, retroreflective, single_sided, visually_transparent."""
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Emitted linear color, 1 for 1 kcd/m2; of a lamp, while it burns; of a picture that shines, where it is white."""
    lamp: Lamp = "none"
    """When it shines: none for always, or the kind of lamp."""
    ior: float = 1.5
    """Index of refraction, which says how much the surface mirrors [-]: 1.5 for glass, more for a coated pane.
    A pane, both faces together, mirrors 0.077 at normal incidence with 1.5, 0.20 with 2.0."""


def _itu(row: str) -> RadioMaterial:
    return RadioMaterial("itu", itu=row)


def _constant(relative_permittivity: float, conductivity: float) -> RadioMaterial:
    return RadioMaterial("constant", relative_permittivity=relative_permittivity, conductivity=conductivity)


def _cloth(red: float, green: float, blue: float) -> MaterialSpec:
    return MaterialSpec(_SKIN, "none", (red, green, blue), 0.90)


def _lens(color: tuple[float, float, float], roughness: float, **options) -> MaterialSpec:
    """Return the cover of a lamp or a signal."""
    return MaterialSpec(_GLASS, "plexiglass", color, roughness, **options)


def _paint(color: tuple[float, float, float], metallic: float = 0.0) -> MaterialSpec:
    """Return a lacquered paint; its flakes of metal, the more the rougher, scatter and do not mirror as chrome does."""
    roughness = 0.35 + 0.3 * metallic
    return MaterialSpec(
        _itu("itu_metal"), "steel", color, roughness, metallic, clearcoat=1.0, coating="paint_clearcoat"
    )


PAINTS = ("red", "blue", "white", "black", "silver", "green", "grey", "graphite")
"""Paint variants of every vehicle; `car_paint_<paint>` is the material of its body."""

_DRY_GROUND = _itu("itu_very_dry_ground")
_MEDIUM_GROUND = _itu("itu_medium_dry_ground")
_METAL = _itu("itu_metal")
_GLASS = _itu("itu_glass")
_WINDOW = RadioMaterial("itu", itu="itu_glass", thickness=0.006)
_CURTAIN_WALL = RadioMaterial("itu", itu="itu_glass", thickness=0.010)
_CAR_WINDOW = RadioMaterial("itu", itu="itu_glass", thickness=0.005)
_WOOD = _itu("itu_wood")
_FOLIAGE = RadioMaterial("itu", itu="itu_wood", medium="foliage")
_CONCRETE = _itu("itu_concrete")
_PLASTIC = _constant(2.5, 0.001)
_SKIN = _itu("itu_skin")
_RUBBER = _constant(3.0, 0.0001)

LIBRARY: dict[str, MaterialSpec] = {
    # Ground, in dry weather; a town's weather variant overrides the radio attributes when it is wet.
    "asphalt": MaterialSpec(_DRY_GROUND, "asphalt", (0.085, 0.084, 0.082), 0.90),
    "road_marking": MaterialSpec(_DRY_GROUND, "asphalt", (0.62, 0.62, 0.60), 0.70, coating="paint"),
    "concrete_sidewalk": MaterialSpec(_DRY_GROUND, "concrete", (0.33, 0.32, 0.30), 0.85),
    "curb": MaterialSpec(_DRY_GROUND, "concrete", (0.42, 0.41, 0.39), 0.80),
    "grass": MaterialSpec(_MEDIUM_GROUND, "leaf_grass", (0.07, 0.13, 0.03), 0.95),
    "soil": MaterialSpec(_MEDIUM_GROUND, "dirt", (0.16, 0.11, 0.07), 0.95),
    "manhole_cover": MaterialSpec(_METAL, "iron", (0.101, 0.092, 0.083), 0.55),
    "drain_grate": MaterialSpec(_METAL, "iron", (0.066, 0.059, 0.053), 0.55),
    # Buildings.
    "marble_facade": MaterialSpec(_itu("itu_marble"), "marble", (0.58, 0.55, 0.50), 0.45),
    "concrete_facade": MaterialSpec(_CONCRETE, "concrete", (0.40, 0.39, 0.37), 0.80),
    "brick_facade": MaterialSpec(_itu("itu_brick"), "brick", (0.30, 0.11, 0.07), 0.85),
    "clear_pane": MaterialSpec(_WINDOW, "clear_glass", (0.10, 0.115, 0.11), 0.03, opacity=0.5),
    "glass_facade": MaterialSpec(
        _CURTAIN_WALL,
        "one_way_mirror",
        (0.021, 0.035, 0.046),
        0.03,
        opacity=0.9,
        emission=(0.008, 0.008, 0.008),
        ior=2.0,
    ),
    "window_glass": MaterialSpec(
        _WINDOW, "clear_glass", (0.08, 0.078, 0.072), 0.03, opacity=0.9, emission=(0.006, 0.006, 0.006)
    ),
    "concrete_roof": MaterialSpec(_CONCRETE, "concrete", (0.26, 0.26, 0.25), 0.90),
    "tile_roof": MaterialSpec(_CONCRETE, "brick", (0.25, 0.09, 0.05), 0.80),
    "metal_fascia": MaterialSpec(_METAL, "aluminum", (0.55, 0.56, 0.58), 0.35, 0.8),
    "concrete_structure": MaterialSpec(_CONCRETE, "concrete", (0.36, 0.35, 0.33), 0.85),
    # Street furniture and plants.
    "metal_pole": MaterialSpec(_METAL, "steel", (0.35, 0.36, 0.37), 0.45, 0.8),
    "wood": MaterialSpec(_WOOD, "wood", (0.30, 0.19, 0.10), 0.75),
    "foliage": MaterialSpec(_FOLIAGE, "leaf_grass", (0.05, 0.11, 0.025), 0.80),
    "foliage_light": MaterialSpec(_FOLIAGE, "leaf_grass", (0.07, 0.132, 0.025), 0.80),
    "foliage_dark": MaterialSpec(_FOLIAGE, "leaf_grass", (0.035, 0.0825, 0.025), 0.80),
    "bark": MaterialSpec(_WOOD, "bark", (0.11, 0.075, 0.05), 0.95),
    "plastic": MaterialSpec(_PLASTIC, "plastic", (0.35, 0.35, 0.36), 0.50),
    "sign_face": MaterialSpec(_METAL, "aluminum", (0.435, 0.323, 0.385), 0.40, attributes=("retroreflective",)),
    "shop_sign": MaterialSpec(_PLASTIC, "plastic", (0.3, 0.211, 0.148), 0.35, emission=(0.012, 0.012, 0.012)),
    "street_lamp_lens": MaterialSpec(
        _PLASTIC, "plexiglass", (0.55, 0.55, 0.53), 0.25, emission=(20.0, 17.5, 13.5), lamp="street"
    ),
    "signal_red": _lens((0.30, 0.01, 0.01), 0.15, emission=(5.0, 0.0, 0.0)),
    "signal_red_dark": _lens((0.10, 0.006, 0.006), 0.15),
    "signal_amber": _lens((0.09, 0.05, 0.005), 0.15),
    "signal_green": _lens((0.005, 0.05, 0.03), 0.15),
    "signal_green_lit": _lens((0.01, 0.25, 0.15), 0.15, emission=(0.0, 3.5, 2.1)),
    "traffic_light_metal": MaterialSpec(_METAL, "aluminum", (0.03, 0.035, 0.03), 0.50, 0.2, coating="paint"),
    # Vehicles.
    "car_paint_red": _paint((0.42, 0.015, 0.02)),
    "car_paint_blue": _paint((0.02, 0.07, 0.30), 0.3),
    "car_paint_white": _paint((0.78, 0.78, 0.76)),
    "car_paint_black": _paint((0.012, 0.012, 0.014)),
    "car_paint_silver": _paint((0.44, 0.45, 0.46), 0.5),
    "car_paint_green": _paint((0.02, 0.13, 0.06), 0.3),
    "car_paint_grey": _paint((0.20, 0.205, 0.215), 0.5),
    "car_paint_graphite": _paint((0.055, 0.058, 0.065), 0.5),
    "car_glass": MaterialSpec(
        _CAR_WINDOW, "clear_glass", (0.02, 0.024, 0.028), 0.05, opacity=0.85, attributes=("visually_transparent",)
    ),
    "car_rubber": MaterialSpec(_RUBBER, "rubber", (0.018, 0.018, 0.019), 0.90),
    "car_light_front": _lens((0.62, 0.64, 0.66), 0.12, emission=(20.0, 18.5, 16.0), lamp="headlight"),
    "car_light_rear": _lens(
        (0.22, 0.004, 0.006), 0.20, attributes=("retroreflective",), emission=(1.5, 0.0, 0.0), lamp="taillight"
    ),
    "car_light_brake": _lens((0.16, 0.004, 0.006), 0.20, emission=(1.5, 0.0, 0.0), lamp="brake"),
    "car_light_clear": _lens((0.60, 0.61, 0.62), 0.15),
    "car_light_amber": _lens((0.62, 0.20, 0.01), 0.20, attributes=("retroreflective",)),
    "car_trim": MaterialSpec(_METAL, "aluminum", (0.028, 0.028, 0.03), 0.55, coating="paint"),
    "car_gloss": MaterialSpec(_METAL, "aluminum", (0.010, 0.010, 0.011), 0.15, coating="paint"),
    "car_mirror": MaterialSpec(_METAL, "one_way_mirror", (0.80, 0.81, 0.82), 0.03, 1.0),
    "car_rim": MaterialSpec(_METAL, "aluminum", (0.50, 0.51, 0.53), 0.30, 0.9),
    "car_plate": MaterialSpec(_METAL, "aluminum", (0.576, 0.580, 0.600), 0.55, attributes=("retroreflective",)),
    "truck_lettering": MaterialSpec(_METAL, "aluminum", (0.661, 0.640, 0.669), 0.40, coating="paint"),
    "bus_sign": MaterialSpec(_METAL, "aluminum", (0.148, 0.048, 0.004), 0.30, emission=(1.5, 1.5, 1.5)),
    # People: clothing is too thin to matter to radio waves, so skin decides.
    "skin": MaterialSpec(_SKIN, "none", (0.38, 0.21, 0.14), 0.55),
    "skin_light": MaterialSpec(_SKIN, "none", (0.52, 0.32, 0.23), 0.55),
    "skin_dark": MaterialSpec(_SKIN, "none", (0.13, 0.062, 0.035), 0.50),
    "lips": MaterialSpec(_SKIN, "none", (0.25, 0.065, 0.055), 0.50),
    "hair": MaterialSpec(_SKIN, "none", (0.03, 0.02, 0.015), 0.70),
    "hair_brown": MaterialSpec(_SKIN, "none", (0.085, 0.045, 0.02), 0.65),
    "hair_fair": MaterialSpec(_SKIN, "none", (0.30, 0.19, 0.075), 0.65),
    "cloth_navy": _cloth(0.025, 0.04, 0.12),
    "cloth_grey": _cloth(0.20, 0.20, 0.21),
    "cloth_red": _cloth(0.35, 0.03, 0.03),
    "cloth_ochre": _cloth(0.40, 0.24, 0.05),
    "cloth_white": _cloth(0.65, 0.65, 0.62),
    "cloth_olive": _cloth(0.085, 0.095, 0.04),
    "cloth_teal": _cloth(0.02, 0.14, 0.15),
    "cloth_dark": _cloth(0.035, 0.035, 0.04),
    "cloth_denim": _cloth(0.04, 0.075, 0.16),
    "cloth_beige": _cloth(0.36, 0.28, 0.18),
}
"""Material name -> description. Colors, roughness and the two constant permittivities (plastic 2.5, rubber 3.0) are
design values, as are the thicknesses of the three panes of glass, the only materials that let a wave through; all
others are half-spaces. Radio rows: facades, roofs, ground, vehicles and traffic lights after the paper's table of
materials."""
