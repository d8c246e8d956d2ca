"""Textures of Material prims: the nodes between `st` of a mesh and the inputs of UsdPreviewSurface."""

from pxr import Gf, Sdf, Usd, UsdShade

from mmw.worlds.materials.textures import Tile, roughness_scale
from mmw.worlds.materials.vehicle_decals import Picture

TEXTURES = "textures"
"""Folder of the texture tiles beside the library."""

_KINDS = Sdf.ValueTypeNames


def write_tile_nodes(
    stage: Usd.Stage, shader: UsdShade.Shader, tile: Tile, color: tuple[float, float, float], roughness: float
) -> None:
    """Connect a tile to color, normal and roughness, repeated every `size_m` of `st`: meters on town meshes.

    The inputs also have their own values, the means of the textures, for readers that draw none. Roughness is read from
    the red channel of the colors' file, through a scale.
    """
    path = shader.GetPath().GetParentPath()
    st = _write_repeat(stage, path.AppendChild("Repeat"), _write_reader(stage, path), tile.size_m)
    file = tile.file or path.name
    at = path.AppendChild("Texture")
    colors = _write_texture(stage, at, f"{file}.png", st, True, (*tile.tint, 1.0), (0.0,) * 4)
    shader.CreateInput("diffuseColor", _KINDS.Color3f).ConnectToSource(colors.CreateOutput("rgb", _KINDS.Float3))
    if tile.roughness:
        scale, bias = roughness_scale(tile, color, roughness)
        at = path.AppendChild("RoughnessTexture")
        rough = _write_texture(stage, at, f"{file}.png", st, False, (scale,) * 4, (bias,) * 4)
        shader.CreateInput("roughness", _KINDS.Float).ConnectToSource(rough.CreateOutput("r", _KINDS.Float))
    if tile.relief:
        if tile.relief_m:
            st = _write_repeat(stage, path.AppendChild("NormalRepeat"), _write_reader(stage, path), tile.relief_m)
        at = path.AppendChild("NormalTexture")
        scale, bias = (2.0, 2.0, 2.0, 1.0), (-1.0, -1.0, -1.0, 0.0)
        bent = _write_texture(stage, at, f"{file}_normal.png", st, False, scale, bias)
        shader.CreateInput("normal", _KINDS.Normal3f).ConnectToSource(bent.CreateOutput("rgb", _KINDS.Float3))


def write_picture_nodes(
    stage: Usd.Stage, shader: UsdShade.Shader, picture: Picture, emission: tuple[float, float, float]
) -> None:
    """Connect a picture, which fills `st` from 0 to 1, to the color, and to the emission if it shines."""
    path = shader.GetPath().GetParentPath()
    st = _write_reader(stage, path)
    colors = _write_texture(stage, path.AppendChild("Texture"), f"{path.name}.png", st, True, (1.0,) * 4, (0.0,) * 4)
    shader.CreateInput("diffuseColor", _KINDS.Color3f).ConnectToSource(colors.CreateOutput("rgb", _KINDS.Float3))
    if picture.shines or picture.light:
        file = f"{path.name}_light.png" if picture.light else f"{path.name}.png"
        light = _write_texture(stage, path.AppendChild("Light"), file, st, True, (*emission, 1.0), (0.0,) * 4)
        shader.CreateInput("emissiveColor", _KINDS.Color3f).ConnectToSource(light.CreateOutput("rgb", _KINDS.Float3))


def _write_reader(stage: Usd.Stage, path: Sdf.Path) -> UsdShade.Output:
    """Return the texture coordinates of the mesh."""
    reader = UsdShade.Shader.Define(stage, path.AppendChild("St"))
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", _KINDS.String).Set("st")
    return reader.CreateOutput("result", _KINDS.Float2)


def _write_repeat(stage: Usd.Stage, path: Sdf.Path, st: UsdShade.Output, size_m: float) -> UsdShade.Output:
    """Return coordinates that grow by 1 every `size_m`."""
    scale = UsdShade.Shader.Define(stage, path)
    scale.CreateIdAttr("UsdTransform2d")
    scale.CreateInput("in", _KINDS.Float2).ConnectToSource(st)
    scale.CreateInput("scale", _KINDS.Float2).Set(Gf.Vec2f(1.0 / size_m))
    return scale.CreateOutput("result", _KINDS.Float2)


def _write_texture(
    stage: Usd.Stage,
    path: Sdf.Path,
    file: str,
    st: UsdShade.Output,
    is_srgb: bool,
    scale: tuple[float, ...],
    bias: tuple[float, ...],
) -> UsdShade.Shader:
    """Return a node that reads a file of the library's texture folder: value times scale, plus bias."""
    texture = UsdShade.Shader.Define(stage, path)
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", _KINDS.Asset).Set(Sdf.AssetPath(f"./{TEXTURES}/{file}"))
    texture.CreateInput("st", _KINDS.Float2).ConnectToSource(st)
    texture.CreateInput("sourceColorSpace", _KINDS.Token).Set("sRGB" if is_srgb else "raw")
    for axis in ("wrapS", "wrapT"):
        texture.CreateInput(axis, _KINDS.Token).Set("repeat")
    texture.CreateInput("scale", _KINDS.Float4).Set(Gf.Vec4f(*scale))
    texture.CreateInput("bias", _KINDS.Float4).Set(Gf.Vec4f(*bias))
    return texture
