"""The material library: every surface of the shipped towns and vehicles, described once for radio, LiDAR and image."""

from dataclasses import dataclass, field
from pathlib import Path

from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

from mmw.materials import RadioMaterial
from mmw.paths import assets_dir
from mmw.usd import schema
from mmw.usd.textures import TILES, Tile, write_tile

ROOT = "/Materials"
"""Prim that holds the library's Material prims."""

TEXTURES = "textures"
"""Folder of the texture tiles beside the library."""

NONVISUAL = "omni:simready:nonvisual:"
"""Prefix of the SimReady attributes that LiDAR and radar simulators read from a Material prim."""


@dataclass(frozen=True)
class MaterialSpec:
    """One material of the library: what `author_material` writes on one Material prim."""

    radio: RadioMaterial
    base: str
    """SimReady base token, a key of `mmw.materials.LIDAR_REFLECTANCE_905NM`."""
    color: tuple[float, float, float]
    """Linear diffuse colour, 0 to 1 [-]."""
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
    attributes: tuple[str, ...] = field(default=("none",))
    """SimReady attribute tokens: none, emissive, retroreflective, single_sided, visually_transparent."""


def _itu(row: str) -> RadioMaterial:
    return RadioMaterial("itu", itu=row)


def _constant(relative_permittivity: float, conductivity: float) -> RadioMaterial:
    return RadioMaterial("constant", relative_permittivity=relative_permittivity, conductivity=conductivity)


def _paint(color: tuple[float, float, float], metallic: float = 0.0) -> MaterialSpec:
    return MaterialSpec(_itu("itu_metal"), "steel", color, 0.35, metallic, clearcoat=1.0, coating="paint_clearcoat")


PAINTS = ("red", "blue", "white", "black", "silver", "green")
"""Paint variants of every vehicle; `car_paint_<paint>` is the material of its body."""

_DRY_GROUND = _itu("itu_very_dry_ground")
_MEDIUM_GROUND = _itu("itu_medium_dry_ground")
_METAL = _itu("itu_metal")
_GLASS = _itu("itu_glass")
_WINDOW = RadioMaterial("itu", itu="itu_glass", thickness=0.006)
_CURTAIN_WALL = RadioMaterial("itu", itu="itu_glass", thickness=0.010)
_CAR_WINDOW = RadioMaterial("itu", itu="itu_glass", thickness=0.005)
_WOOD = _itu("itu_wood")
_CONCRETE = _itu("itu_concrete")
_PLASTIC = _constant(2.5, 0.001)
_SKIN = _itu("itu_skin")
_RUBBER = _constant(3.0, 0.0001)

LIBRARY: dict[str, MaterialSpec] = {
    # Ground, in dry weather; a town's weather variant overrides the radio attributes when it is wet.
    "asphalt": MaterialSpec(_DRY_GROUND, "asphalt", (0.055, 0.055, 0.058), 0.90),
    "road_marking": MaterialSpec(_DRY_GROUND, "asphalt", (0.62, 0.62, 0.60), 0.70, coating="paint"),
    "concrete_sidewalk": MaterialSpec(_DRY_GROUND, "concrete", (0.33, 0.32, 0.30), 0.85),
    "curb": MaterialSpec(_DRY_GROUND, "concrete", (0.42, 0.41, 0.39), 0.80),
    "grass": MaterialSpec(_MEDIUM_GROUND, "leaf_grass", (0.07, 0.13, 0.03), 0.95),
    "soil": MaterialSpec(_MEDIUM_GROUND, "dirt", (0.16, 0.11, 0.07), 0.95),
    # Buildings.
    "marble_facade": MaterialSpec(_itu("itu_marble"), "marble", (0.58, 0.55, 0.50), 0.45),
    "concrete_facade": MaterialSpec(_CONCRETE, "concrete", (0.40, 0.39, 0.37), 0.80),
    "brick_facade": MaterialSpec(_itu("itu_brick"), "brick", (0.30, 0.11, 0.07), 0.85),
    "glass_facade": MaterialSpec(_CURTAIN_WALL, "one_way_mirror", (0.05, 0.09, 0.12), 0.05),
    "window_glass": MaterialSpec(_WINDOW, "clear_glass", (0.03, 0.045, 0.055), 0.05),
    "concrete_roof": MaterialSpec(_CONCRETE, "concrete", (0.26, 0.26, 0.25), 0.90),
    "tile_roof": MaterialSpec(_CONCRETE, "brick", (0.25, 0.09, 0.05), 0.80),
    "metal_fascia": MaterialSpec(_METAL, "aluminum", (0.55, 0.56, 0.58), 0.35, 0.8),
    "concrete_structure": MaterialSpec(_CONCRETE, "concrete", (0.36, 0.35, 0.33), 0.85),
    # Street furniture and plants.
    "metal_pole": MaterialSpec(_METAL, "steel", (0.35, 0.36, 0.37), 0.45, 0.8),
    "wood": MaterialSpec(_WOOD, "wood", (0.30, 0.19, 0.10), 0.75),
    "foliage": MaterialSpec(_WOOD, "leaf_grass", (0.05, 0.11, 0.025), 0.80),
    "bark": MaterialSpec(_WOOD, "bark", (0.11, 0.075, 0.05), 0.95),
    "plastic": MaterialSpec(_PLASTIC, "plastic", (0.35, 0.35, 0.36), 0.50),
    "sign_face": MaterialSpec(_METAL, "aluminum", (0.70, 0.70, 0.70), 0.40, attributes=("retroreflective",)),
    "traffic_light_metal": MaterialSpec(_METAL, "aluminum", (0.03, 0.035, 0.03), 0.50, 0.2, coating="paint"),
    # Vehicles.
    "car_paint_red": _paint((0.42, 0.015, 0.02)),
    "car_paint_blue": _paint((0.02, 0.07, 0.30)),
    "car_paint_white": _paint((0.78, 0.78, 0.76)),
    "car_paint_black": _paint((0.012, 0.012, 0.014)),
    "car_paint_silver": _paint((0.48, 0.49, 0.50), 0.5),
    "car_paint_green": _paint((0.02, 0.13, 0.06)),
    "car_glass": MaterialSpec(
        _CAR_WINDOW, "clear_glass", (0.02, 0.024, 0.028), 0.05, opacity=0.85, attributes=("visually_transparent",)
    ),
    "car_rubber": MaterialSpec(_RUBBER, "rubber", (0.018, 0.018, 0.019), 0.90),
    "car_light_front": MaterialSpec(_GLASS, "plexiglass", (0.42, 0.44, 0.46), 0.15),
    "car_light_rear": MaterialSpec(_GLASS, "plexiglass", (0.22, 0.004, 0.006), 0.20, attributes=("retroreflective",)),
    # People: clothing is too thin to matter to radio waves, so skin decides.
    "skin": MaterialSpec(_SKIN, "none", (0.38, 0.21, 0.14), 0.55),
    "hair": MaterialSpec(_SKIN, "none", (0.03, 0.02, 0.015), 0.70),
    "cloth_navy": MaterialSpec(_SKIN, "none", (0.025, 0.04, 0.12), 0.90),
    "cloth_grey": MaterialSpec(_SKIN, "none", (0.20, 0.20, 0.21), 0.90),
    "cloth_red": MaterialSpec(_SKIN, "none", (0.35, 0.03, 0.03), 0.90),
    "cloth_ochre": MaterialSpec(_SKIN, "none", (0.40, 0.24, 0.05), 0.90),
    "cloth_white": MaterialSpec(_SKIN, "none", (0.65, 0.65, 0.62), 0.90),
    "cloth_dark": MaterialSpec(_SKIN, "none", (0.035, 0.035, 0.04), 0.90),
    "car_trim": MaterialSpec(_METAL, "aluminum", (0.06, 0.06, 0.065), 0.40, 0.4, coating="paint"),
}
"""Material name -> description. Colours, roughness and the two constant permittivities (plastic 2.5, rubber 3.0) are
design values, as are the thicknesses of the three panes of glass, the only materials that let a wave through; all
others are half-spaces. Radio rows: facades, roofs, ground, vehicles and traffic lights after the paper's table of
materials."""


def author_material(stage: Usd.Stage, path: str, spec: MaterialSpec, tile: Tile | None = None) -> UsdShade.Material:
    """Write one Material prim: UsdPreviewSurface, SimReady non-visual attributes and `MmwRadioMaterialAPI`.

    Every attribute is authored, so a reader without the schema's plugin sees the same values.

    Args:
        stage: Stage to write to, at its edit target.
        path: Path of the Material prim; an existing prim is overwritten.
        spec: The description.
        tile: Texture of the diffuse colour, `textures/<name>.png` beside the layer; the colour itself without one.

    Returns:
        The material.
    """
    schema.register()
    material = UsdShade.Material.Define(stage, path)
    prim = material.GetPrim()

    shader = UsdShade.Shader.Define(stage, f"{path}/Preview")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*spec.color))
    scalars = {
        "roughness": spec.roughness, "metallic": spec.metallic, "opacity": spec.opacity, "clearcoat": spec.clearcoat
    }  # fmt: skip
    for name, value in scalars.items():
        shader.CreateInput(name, Sdf.ValueTypeNames.Float).Set(value)
    if tile:
        _author_texture(stage, path, shader.GetInput("diffuseColor"), tile)
    output = shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput().ConnectToSource(output)

    for name, value in (("base", spec.base), ("coating", spec.coating)):
        prim.CreateAttribute(NONVISUAL + name, Sdf.ValueTypeNames.Token, custom=True).Set(value)
    attributes = prim.CreateAttribute(f"{NONVISUAL}attributes", Sdf.ValueTypeNames.TokenArray, custom=True)
    attributes.Set(list(spec.attributes))

    prim.AddAppliedSchema(schema.RADIO_API)  # not ApplyAPI: that fails where a stage was opened before register()
    for name, attribute in schema.RADIO_ATTRIBUTES.items():
        created = prim.CreateAttribute(attribute.name, attribute.type_name, False, attribute.variability)
        created.Set(getattr(spec.radio, name))
    return material


def _author_texture(stage: Usd.Stage, path: str, color: UsdShade.Input, tile: Tile) -> None:
    """Connect a texture to a colour, repeated every `size_m` of `st`, which town meshes give in metres.

    The colour keeps its own value too, the texture's mean, for readers that draw no textures.
    """
    kinds = Sdf.ValueTypeNames
    name = Sdf.Path(path).name
    reader = UsdShade.Shader.Define(stage, f"{path}/St")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", kinds.String).Set("st")
    scale = UsdShade.Shader.Define(stage, f"{path}/Repeat")
    scale.CreateIdAttr("UsdTransform2d")
    scale.CreateInput("in", kinds.Float2).ConnectToSource(reader.CreateOutput("result", kinds.Float2))
    scale.CreateInput("scale", kinds.Float2).Set(Gf.Vec2f(1.0 / tile.size_m))
    texture = UsdShade.Shader.Define(stage, f"{path}/Texture")
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", kinds.Asset).Set(Sdf.AssetPath(f"./{TEXTURES}/{name}.png"))
    texture.CreateInput("st", kinds.Float2).ConnectToSource(scale.CreateOutput("result", kinds.Float2))
    texture.CreateInput("sourceColorSpace", kinds.Token).Set("sRGB")
    for axis in ("wrapS", "wrapT"):
        texture.CreateInput(axis, kinds.Token).Set("repeat")
    texture.CreateInput("scale", kinds.Float4).Set(Gf.Vec4f(1.0))
    color.ConnectToSource(texture.CreateOutput("rgb", kinds.Float3))


def build_materials(path: str | Path) -> None:
    """Write the whole library as one layer with its textures beside it; the same library gives the same bytes.

    Args:
        path: File to write, `assets/usd/materials/materials.usda` for the shipped one.
    """
    schema.register()
    stage = Usd.Stage.CreateInMemory("materials.usda")
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    root = UsdGeom.Scope.Define(stage, ROOT).GetPrim()
    stage.SetDefaultPrim(root)
    for name, spec in LIBRARY.items():
        author_material(stage, f"{ROOT}/{name}", spec, TILES.get(name))
        if name in TILES:
            write_tile(Path(path).parent / TEXTURES / f"{name}.png", TILES[name], spec.color)
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    stage.GetRootLayer().Export(str(path))


if __name__ == "__main__":
    build_materials(assets_dir() / "materials" / "materials.usda")
