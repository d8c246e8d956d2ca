"""Stages with surface shaders and textures, written by tests of how things look."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from PIL import Image
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

from tests.stages import add_material, add_polygons, new_stage

KINDS = Sdf.ValueTypeNames
TYPES = {
    "diffuseColor": KINDS.Color3f, "emissiveColor": KINDS.Color3f, "specularColor": KINDS.Color3f,
    "normal": KINDS.Normal3f, "useSpecularWorkflow": KINDS.Int,
}  # fmt: skip


def stage_in(folder: Path, **options) -> Usd.Stage:
    """Return an empty stage of two frames."""
    folder.mkdir(parents=True, exist_ok=True)
    stage = new_stage(folder / "stage.usda", **options)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(1)
    return stage


def corner_image(path: Path) -> str:
    """Write an image of four colours: red bottom left, green bottom right, blue top left, white top right."""
    codes = np.zeros((8, 8, 3), dtype=np.uint8)
    codes[4:, :4], codes[4:, 4:], codes[:4, :4], codes[:4, 4:] = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255)
    Image.fromarray(codes).save(path)
    return path.name


def preview(
    stage: Usd.Stage, path: str, inputs: Mapping[str, object] = {}
) -> tuple[UsdShade.Material, UsdShade.Shader]:
    """Write a material with radio attributes and a UsdPreviewSurface."""
    material = add_material(stage, path, "itu_concrete", "concrete")
    shader = UsdShade.Shader.Define(stage, f"{path}/Surface")
    shader.CreateIdAttr("UsdPreviewSurface")
    for name, value in inputs.items():
        shader.CreateInput(name, TYPES.get(name, KINDS.Float)).Set(value)
    material.CreateSurfaceOutput().ConnectToSource(shader.CreateOutput("surface", KINDS.Token))
    return material, shader


def connect(
    stage: Usd.Stage,
    shader: UsdShade.Shader,
    name: str,
    file: str,
    *,
    output: str = "rgb",
    varname: str = "st",
    transforms: Sequence[Mapping[str, object]] = (),
    **inputs,
) -> UsdShade.Shader:
    """Connect a UsdUVTexture to an input; `transforms` lie between mesh and texture, the mesh's first."""
    base = f"{shader.GetPath()}_{name}"
    reader = UsdShade.Shader.Define(stage, base + "_st")
    reader.CreateIdAttr("UsdPrimvarReader_float2")
    reader.CreateInput("varname", KINDS.String).Set(varname)
    source = reader.CreateOutput("result", KINDS.Float2)
    for k, transform in enumerate(transforms):
        node = UsdShade.Shader.Define(stage, f"{base}_transform{k}")
        node.CreateIdAttr("UsdTransform2d")
        node.CreateInput("in", KINDS.Float2).ConnectToSource(source)
        for key, value in transform.items():
            node.CreateInput(key, KINDS.Float if key == "rotation" else KINDS.Float2).Set(value)
        source = node.CreateOutput("result", KINDS.Float2)
    texture = UsdShade.Shader.Define(stage, base + "_texture")
    texture.CreateIdAttr("UsdUVTexture")
    texture.CreateInput("file", KINDS.Asset).Set(Sdf.AssetPath(file))
    texture.CreateInput("st", KINDS.Float2).ConnectToSource(source)
    for key, value in inputs.items():
        kind = KINDS.Token if isinstance(value, str) else KINDS.Float4
        texture.CreateInput(key, kind).Set(value if isinstance(value, str) else Gf.Vec4f(*value))
    is_color = output == "rgb"
    shader.CreateInput(name, TYPES.get(name, KINDS.Float)).ConnectToSource(
        texture.CreateOutput(output, KINDS.Float3 if is_color else KINDS.Float)
    )
    return texture


def add_quad(
    stage: Usd.Stage, path: str, material: UsdShade.Material | None = None, points: Sequence[Sequence[float]] = ()
) -> UsdGeom.Mesh:
    """Write a square from (0, 0, 0) to (2, 2, 0) that faces up, as one polygon, with no texture coordinates."""
    corners = points or [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0)]
    return add_polygons(stage, path, np.array(corners, dtype=float), [[0, 1, 2, 3]], material)


def give_uv(
    mesh: UsdGeom.Mesh,
    values: Sequence[Sequence[float]] = ((0, 0), (1, 0), (1, 1), (0, 1)),
    interpolation: str = "vertex",
    *,
    indices: Sequence[int] | None = None,
    name: str = "st",
) -> UsdGeom.Mesh:
    """Write texture coordinates."""
    primvar = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar(name, KINDS.TexCoord2fArray, interpolation)
    primvar.Set(Vt.Vec2fArray([Gf.Vec2f(*map(float, value)) for value in values]))
    if indices is not None:
        primvar.SetIndices(Vt.IntArray(list(indices)))
    return mesh
