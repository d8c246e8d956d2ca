"""Write the material library as a USD layer: `python -m mmw.worlds.materials.library`."""

from pathlib import Path

from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade

from mmw.core.errors import InputError
from mmw.core.resources import assets_dir
from mmw.physics.materials.material import file_values
from mmw.usd import schema
from mmw.usd.material_library import LAMP, LIBRARY, NONVISUAL, ROOT, MaterialSpec
from mmw.worlds.materials.shading_networks import TEXTURES, write_picture_nodes, write_tile_nodes
from mmw.worlds.materials.textures import TILES, Tile, write_tile
from mmw.worlds.materials.town_decals import TOWN_PICTURES
from mmw.worlds.materials.vehicle_decals import PICTURES, Picture, write_picture


def write_material(
    stage: Usd.Stage, path: str, spec: MaterialSpec, tile: Tile | None = None, picture: Picture | None = None
) -> UsdShade.Material:
    """Write one Material prim: UsdPreviewSurface, SimReady non-visual attributes and `MmwRadioMaterialAPI`.

    Every attribute is authored, so a reader without the schema's plugin sees the same values; roughness and layers are
    where the material has them.

    Args:
        stage: Stage to write to, at its edit target.
        path: Path of the Material prim; an existing prim is overwritten.
        spec: The description.
        tile: Textures of color, normal and roughness, `textures/<name>*.png` beside the layer; none without one.
        picture: Picture in place of a tile, `textures/<name>.png`, which fills `st` from 0 to 1.

    Returns:
        The material.

    Raises:
        InputError: If the permittivity or the scattering pattern is a function.
    """
    if spec.radio.holds_function:
        raise InputError(
            f"{path}: its permittivity or scattering pattern is a function, which USD cannot hold; give a row or "
            "constants, and register the scattering pattern under a name"
        )
    schema.register()
    material = UsdShade.Material.Define(stage, path)
    prim = material.GetPrim()

    shader = UsdShade.Shader.Define(stage, f"{path}/Preview")
    shader.CreateIdAttr("UsdPreviewSurface")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*spec.color))
    shader.CreateInput("emissiveColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*spec.emission))
    scalars = {
        "roughness": spec.roughness, "metallic": spec.metallic, "opacity": spec.opacity, "clearcoat": spec.clearcoat,
        "ior": spec.ior,
    }  # fmt: skip
    for name, value in scalars.items():
        shader.CreateInput(name, Sdf.ValueTypeNames.Float).Set(value)
    if tile:
        write_tile_nodes(stage, shader, tile, spec.color, spec.roughness)
    if picture:
        write_picture_nodes(stage, shader, picture, spec.emission)
    output = shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
    material.CreateSurfaceOutput().ConnectToSource(output)

    for name, value in (("base", spec.base), ("coating", spec.coating)):
        prim.CreateAttribute(NONVISUAL + name, Sdf.ValueTypeNames.Token, custom=True).Set(value)
    attributes = prim.CreateAttribute(f"{NONVISUAL}attributes", Sdf.ValueTypeNames.TokenArray, custom=True)
    attributes.Set(list(spec.attributes))

    prim.CreateAttribute(LAMP, Sdf.ValueTypeNames.Token, custom=True, variability=Sdf.VariabilityUniform).Set(spec.lamp)

    prim.AddAppliedSchema(schema.RADIO_API)  # not ApplyAPI: that fails where a stage was opened before register()
    for name, value in file_values(spec.radio).items():
        attribute = schema.RADIO_ATTRIBUTES[name]
        if value or not attribute.is_optional:
            created = prim.CreateAttribute(attribute.name, attribute.type_name, False, attribute.variability)
            created.Set(value)
    return material


def build_materials(path: str | Path) -> None:
    """Write the whole library as one layer with its textures beside it; the same library gives the same bytes."""
    schema.register()
    stage = Usd.Stage.CreateInMemory("materials.usda")
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    root = UsdGeom.Scope.Define(stage, ROOT).GetPrim()
    stage.SetDefaultPrim(root)
    pictures = {**PICTURES, **TOWN_PICTURES}
    for name, spec in LIBRARY.items():
        write_material(stage, f"{ROOT}/{name}", spec, TILES.get(name), pictures.get(name))
        file = Path(path).parent / TEXTURES / f"{name}.png"
        if name in TILES and not TILES[name].file:
            write_tile(file, TILES[name], spec.color)
        if name in pictures:
            write_picture(file, pictures[name])
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    stage.GetRootLayer().Export(str(path))


if __name__ == "__main__":
    build_materials(assets_dir() / "materials" / "materials.usda")
