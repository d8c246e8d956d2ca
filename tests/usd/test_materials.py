"""Surface shaders of a stage: every input, coordinate chains, what is not read, and where colors come from."""

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, UsdUtils, Vt

from mmw.config.material_map import MaterialEntry
from mmw.physics.materials.appearance import Appearance
from mmw.scene.device_scene import DeviceScene
from mmw.scene.reader import read_stage
from mmw.scene.scene_data import SceneData
from mmw.sensors.render.appearance_buffers import AppearanceArrays
from mmw.usd.material_library import LIBRARY
from mmw.usd.materials import Copies, MaterialUse, read_material, read_materials
from mmw.usd.preview_surface import metallic_workflow, read_appearance
from tests.fixtures.material_stages import KINDS, add_quad, connect, corner_image, give_uv, preview, stage_in
from tests.fixtures.stages import add_material, animate, saved


@pytest.fixture
def stage(tmp_path: Path) -> Usd.Stage:
    return stage_in(tmp_path)


def read(stage: Usd.Stage, *weathers: str, **options) -> SceneData:
    """Return the first frame of a stage."""
    return read_stage(saved(stage), range(1), weathers or ["sunny"], **options)


def appearance_of(material: UsdShade.Material, notes: dict[str, None] | None = None) -> Appearance:
    return read_appearance(material.GetPrim(), {} if notes is None else notes)


def test_numbers(stage: Usd.Stage) -> None:
    given = {
        "diffuseColor": Gf.Vec3f(0.1, 0.2, 0.3), "emissiveColor": Gf.Vec3f(2, 3, 4), "roughness": 0.7, "metallic": 0.9,
        "ior": 1.4, "opacity": 0.3, "opacityThreshold": 0.1, "clearcoat": 0.8, "clearcoatRoughness": 0.05,
    }  # fmt: skip
    material, _ = preview(stage, "/World/a", given)
    material.GetPrim().CreateAttribute("mmw:lamp", KINDS.Token).Set("headlight")
    notes: dict[str, None] = {}
    assert appearance_of(material, notes) == Appearance(
        (0.1, 0.2, 0.3), (2.0, 3.0, 4.0), 0.7, 0.9, 1.4, 0.3, 0.1, 0.8, 0.05, lamp="headlight"
    )
    assert not notes
    assert appearance_of(preview(stage, "/World/b")[0]) == Appearance((0.18, 0.18, 0.18))
    material.GetPrim().GetAttribute("mmw:lamp").Set("torch")
    with pytest.raises(ValueError, match=r"/World/a: mmw:lamp = 'torch'; needed is one of none, headlight"):
        appearance_of(material)


def test_copies_of_a_material_are_told_from_changed_ones(stage: Usd.Stage) -> None:
    preview(stage, "/World/library/paint", {"roughness": 0.7})
    preview(stage, "/World/library/odd", {"roughness": 0.7})[1].CreateIdAttr("MyShader")
    _, surface = preview(stage, "/World/library/shared")
    node = UsdShade.Shader.Define(stage, "/World/library/Texture")  # beside the material
    node.CreateIdAttr("UsdUVTexture")
    node.CreateInput("fallback", KINDS.Float4).Set(Gf.Vec4f(0.1, 0.2, 0.3, 1.0))
    surface.CreateInput("diffuseColor", KINDS.Color3f).ConnectToSource(node.CreateOutput("rgb", KINDS.Float3))
    for k in range(3):
        stage.DefinePrim(f"/World/copy_{k}").GetReferences().AddInternalReference("/World/library")
    UsdShade.Shader(stage.GetPrimAtPath("/World/copy_1/paint/Surface")).GetInput("roughness").Set(0.4)
    UsdShade.Shader(stage.GetPrimAtPath("/World/copy_1/Texture")).GetInput("fallback").Set(Gf.Vec4f(0.9, 0.8, 0.7, 1.0))
    uses = [MaterialUse(name, f"/World/copy_{k}/{name}", None) for name in ("paint", "shared", "odd") for k in range(3)]
    notes: dict[str, None] = {}
    found = read_materials(stage, uses, notes, copies := Copies())
    assert [material.appearance.roughness for material in found[:3]] == [0.7, 0.4, 0.7]
    assert [material.appearance.color[0] for material in found[3:6]] == [0.1, 0.9, 0.1]
    assert found == [read_material(stage, use) for use in uses]
    assert [material.appearance.prim_path for material in found] == [use.prim_path for use in uses]
    assert len(notes) == 3, "every copy of what is not read is named"
    specs = [copies.specs(stage.GetPrimAtPath(use.prim_path)) for use in uses]
    assert specs[0] == specs[2] != specs[1] and specs[3:6] == [None] * 3
    node.GetInput("fallback").Set(Gf.Vec4f(0.5, 0.5, 0.5, 1.0))  # as a weather would
    found = read_materials(stage, uses, notes, copies)
    assert [material.appearance.color[0] for material in found[3:6]] == [0.5, 0.9, 0.5]


def test_values_through_a_material_interface(stage: Usd.Stage) -> None:
    material, shader = preview(stage, "/World/a")
    port = material.CreateInput("tint", KINDS.Color3f)
    port.Set(Gf.Vec3f(0.4, 0.5, 0.6))
    shader.CreateInput("diffuseColor", KINDS.Color3f).ConnectToSource(port)
    assert appearance_of(material).color == (0.4, 0.5, 0.6)


def test_textures(stage: Usd.Stage, tmp_path: Path) -> None:
    material, shader = preview(stage, "/World/a")
    file = corner_image(tmp_path / "a.png")
    connect(stage, shader, "diffuseColor", file, wrapS="clamp", wrapT="mirror", scale=(1, 2, 3, 4), bias=(0.5, 0, 0, 1))
    connect(stage, shader, "roughness", file, output="g")
    connect(stage, shader, "normal", file, wrapS="black", wrapT="useMetadata")
    connect(stage, shader, "emissiveColor", file, sourceColorSpace="raw", fallback=(0.1, 0.2, 0.3, 1))
    connect(stage, shader, "opacity", file, output="a", sourceColorSpace="sRGB")
    shader.CreateInput("opacityThreshold", KINDS.Float).Set(0.25)
    appearance = appearance_of(material)
    names = ("color", "roughness", "normal", "emission", "opacity")
    color, roughness, normal, emission, opacity = (getattr(appearance, f"{name}_texture") for name in names)
    assert (color.file, color.wrap) == (str(tmp_path / "a.png"), ("clamp", "mirror"))
    assert (color.scale, color.bias) == ((1.0, 2.0, 3.0, 4.0), (0.5, 0.0, 0.0, 1.0))
    assert normal.wrap == ("black", "repeat")
    assert (roughness.channel, opacity.channel) == (1, 3)
    uses = (color, roughness, normal, emission, opacity)
    assert [use.is_srgb for use in uses] == [None, False, False, False, True]
    assert appearance.emission == (0.1, 0.2, 0.3)  # drawn where the file is missing
    assert (appearance.opacity_threshold, appearance.metallic_texture) == (0.25, None)


def test_opacity_texture_without_threshold_is_noted(stage: Usd.Stage, tmp_path: Path) -> None:
    material, shader = preview(stage, "/World/a")
    connect(stage, shader, "opacity", corner_image(tmp_path / "a.png"), output="r")
    notes: dict[str, None] = {}
    assert appearance_of(material, notes).opacity_threshold == 0.5
    assert [line for line in notes if "/World/a" in line and "0.5" in line]


def test_transforms_of_coordinates(stage: Usd.Stage, tmp_path: Path) -> None:
    """Each is out = turn(in * scale) + translation, counter-clockwise, one after the other, by Gf's own rotation."""
    material, shader = preview(stage, "/World/a")
    chain = [
        {"scale": Gf.Vec2f(2, 3), "rotation": 30.0, "translation": Gf.Vec2f(0.1, -0.4)},
        {"rotation": -100.0},
        {"scale": Gf.Vec2f(-1, 0.5), "translation": Gf.Vec2f(5, 6)},
    ]
    connect(stage, shader, "diffuseColor", corner_image(tmp_path / "a.png"), transforms=chain)
    use = appearance_of(material).color_texture
    for st in np.random.default_rng(0).normal(size=(5, 2)):
        point = Gf.Vec3d(*st, 0.0)
        for step in chain:
            scale, move = step.get("scale", Gf.Vec2f(1)), step.get("translation", Gf.Vec2f(0))
            turn = Gf.Rotation(Gf.Vec3d(0, 0, 1), step.get("rotation", 0.0))
            point = turn.TransformDir(Gf.CompMult(point, Gf.Vec3d(*scale, 1))) + Gf.Vec3d(*move, 0)
        found = [float(np.dot(row, (*st, 1.0))) for row in (use.row_u, use.row_v)]
        np.testing.assert_allclose(found, tuple(point)[:2], atol=1e-5)


def test_node_that_is_not_read_is_named(stage: Usd.Stage) -> None:
    material, shader = preview(stage, "/World/a", {"diffuseColor": Gf.Vec3f(0.2, 0.3, 0.4)})
    node = UsdShade.Shader.Define(stage, "/World/a/Noise")
    node.CreateIdAttr("ND_fractal3d_color3")
    for name in ("diffuseColor", "roughness"):
        kind = KINDS.Color3f if name == "diffuseColor" else KINDS.Float
        shader.CreateInput(name, kind).ConnectToSource(node.CreateOutput("out", kind))
    notes: dict[str, None] = {}
    appearance = appearance_of(material, notes)
    assert (appearance.color, appearance.roughness) == ((0.2, 0.3, 0.4), 0.5)
    first, second = notes
    for text in ("/World/a", "diffuseColor", "ND_fractal3d_color3", "/World/a/Noise", "(0.2, 0.3, 0.4) is drawn"):
        assert text in first
    assert "roughness" in second and "its default is drawn" in second


def surface(stage, material, context: str, shader_id: str) -> None:
    shader = UsdShade.Shader.Define(stage, f"{material.GetPath()}/Other")
    shader.CreateIdAttr(shader_id)
    material.CreateSurfaceOutput(context).ConnectToSource(shader.CreateOutput("out", KINDS.Token))


@pytest.mark.parametrize(
    ("context", "shader_id"),
    [("mtlx", "ND_standard_surface_surfaceshader"), ("mdl", "OmniPBR"), ("", "HwPtexTexture_1")],
)
def test_surface_that_is_not_read(stage: Usd.Stage, tmp_path: Path, context: str, shader_id: str) -> None:
    """One note a material, which names node, path and color; the mesh's one displayColor is drawn, else gray."""
    material = add_material(stage, "/World/Looks/foreign", "itu_wood")
    surface(stage, material, context, shader_id)
    quad = add_quad(stage, "/World/a", material)
    quad.CreateDisplayColorAttr([Gf.Vec3f(0.7, 0.6, 0.5)])
    add_quad(stage, "/World/b", material, x=10)
    arrays = read(stage)
    colors = [arrays.materials["sunny"][k].appearance.color for k in arrays.material[[0, -1]]]
    assert colors == [(0.7, 0.6, 0.5), (0.5, 0.5, 0.5)]
    assert len(arrays.look_notes) == 2  # one for each color that is drawn
    for note, color in zip(sorted(arrays.look_notes), ("(0.5, 0.5, 0.5)", "(0.7, 0.6, 0.5)"), strict=True):
        for text in ("/World/Looks/foreign", shader_id, "/World/Looks/foreign/Other", color):
            assert text in note


def test_preview_surface_beside_others_counts(stage: Usd.Stage) -> None:
    material, _ = preview(stage, "/World/a", {"roughness": 0.25})
    surface(stage, material, "mtlx", "ND_standard_surface_surfaceshader")
    notes: dict[str, None] = {}
    assert appearance_of(material, notes).roughness == 0.25
    assert not notes


def test_display_color_of_a_mesh_without_material(stage: Usd.Stage, tmp_path: Path) -> None:
    UsdGeom.PrimvarsAPI(stage.GetPrimAtPath("/World")).CreatePrimvar(
        "displayColor", KINDS.Color3fArray, "constant"
    ).Set(Vt.Vec3fArray([Gf.Vec3f(0.1, 0.2, 0.3)]))
    add_quad(stage, "/World/own").CreateDisplayColorAttr([Gf.Vec3f(0.9, 0.8, 0.7)])
    add_quad(stage, "/World/inherited", None, x=10)
    arrays = read(stage, material_map={"/World/*": MaterialEntry(radio="itu_wood")})
    colors = {arrays.materials["sunny"][k].appearance.color for k in arrays.material}
    assert colors == {(0.9, 0.8, 0.7), (0.1, 0.2, 0.3)}


def test_a_name_that_holds_no_row_is_told_unless_something_else_describes_it(stage: Usd.Stage) -> None:
    """`mmw:radio:*` and entries of the map that name a material count before the name; others do not."""
    material = add_material(stage, "/World/Looks/mat_itu_cheese_1")
    add_quad(stage, "/World/a", material)
    message = (
        "/World/Looks/mat_itu_cheese_1: the radio material 'itu_cheese' of its name does not exist; use one of itu_"
    )
    for bare in ({}, {"/World/*": MaterialEntry(thickness=0.1)}):
        with pytest.raises(ValueError, match=message):
            read(stage, material_map=bare)
    for entry in (
        MaterialEntry(radio="itu_wood"),
        MaterialEntry(relative_permittivity=3.0),
        MaterialEntry(material="wood"),
    ):
        arrays = read(stage, material_map={"/World/*": entry})
        assert arrays.materials["sunny"][arrays.material[0]].radio.model == (
            "constant" if entry.relative_permittivity else "itu"
        )
    material.GetPrim().CreateAttribute("mmw:radio:model", KINDS.Token).Set("itu")
    material.GetPrim().CreateAttribute("mmw:radio:itu", KINDS.Token).Set("itu_brick")
    assert read(stage).materials["sunny"][0].radio.itu == "itu_brick"
    material.GetPrim().GetAttribute("mmw:radio:itu").Set("itu_cheese")
    with pytest.raises(
        ValueError, match=r"mat_itu_cheese_1: mmw:radio:itu = 'itu_cheese'; one of itu_.* is needed; correct"
    ):
        read(stage)


def test_material_of_the_library_has_its_look(device: str, stage: Usd.Stage, tmp_path: Path) -> None:
    """By the material map: color and roughness of the library, and its tile where the mesh has coordinates."""
    give_uv(add_quad(stage, "/World/with"))
    add_quad(stage, "/World/without", None, x=10)
    arrays = read(stage, material_map={"/World/*": MaterialEntry(material="brick_facade")})
    spec = LIBRARY["brick_facade"]
    with_uv, without = (arrays.materials["sunny"][k].appearance for k in arrays.material[[0, -1]])
    assert with_uv.has_uv and not without.has_uv
    assert Path(with_uv.color_texture.file).is_file()
    np.testing.assert_allclose(with_uv.color, spec.color, rtol=1e-6)
    (note,) = arrays.look_notes
    assert "/World/without" in note
    appearances = AppearanceArrays(DeviceScene(arrays, device, 1)).for_weather("sunny").appearances.numpy()
    assert sorted(appearances["color_texture"] >= 0) == [False, True]
    plain = appearances[appearances["color_texture"] < 0][0]
    np.testing.assert_allclose(plain["color"], spec.color, atol=0.01)


def test_looks_follow_the_weather(device: str, stage: Usd.Stage, tmp_path: Path) -> None:
    material, shader = preview(stage, "/World/a", {"roughness": 0.9})
    add_quad(stage, "/World/quad", material)
    variants = stage.GetPrimAtPath("/World").GetVariantSets().AddVariantSet("weather")
    for weather, roughness in (("sunny", 0.8), ("rainy", 0.1)):
        variants.AddVariant(weather)
        variants.SetVariantSelection(weather)
        with variants.GetVariantEditContext():
            stage.OverridePrim(shader.GetPath()).CreateAttribute("inputs:roughness", KINDS.Float).Set(roughness)
    shader.GetInput("roughness").GetAttr().Clear()
    arrays = read(stage, "sunny", "rainy")
    appearance = AppearanceArrays(DeviceScene(arrays, device, 1))
    sunny, rainy = (appearance.for_weather(name) for name in ("sunny", "rainy"))
    assert sunny.appearances.numpy()["roughness"][0] == pytest.approx(0.8)
    assert rainy.appearances.numpy()["roughness"][0] == pytest.approx(0.1)
    assert sunny.texels.ptr == rainy.texels.ptr and sunny.town_uv.ptr == rainy.town_uv.ptr


def test_equal_shapes_with_different_looks_are_two_models(stage: Usd.Stage, tmp_path: Path) -> None:
    quads = []
    for k, color in enumerate([(1, 0, 0), (0, 1, 0), (1, 0, 0), (1, 0, 0)]):
        material, _ = preview(stage, f"/World/Looks/m{k}/paint", {"diffuseColor": Gf.Vec3f(*color)})
        animate(stage, f"/World/car_{k}", np.array([(k, 0, 0), (k, 1, 0)], dtype=float))
        quads.append(add_quad(stage, f"/World/car_{k}/body", material))
    quads[3].CreateNormalsAttr([Gf.Vec3f(0, 0.6, 0.8)] * 4)
    quads[3].SetNormalsInterpolation("vertex")
    arrays = read(stage)
    assert [actor.model for actor in arrays.actors] == [0, 1, 0, 2]
    np.testing.assert_allclose(arrays.models[2].normals, np.tile((0, 0.6, 0.8), (2, 3, 1)), atol=1e-6)
    assert not arrays.models[0].normals.any()


@pytest.mark.parametrize(
    ("diffuse", "specular", "expected"),
    [
        ((0.5, 0.4, 0.3), (0.04, 0.04, 0.04), ((0.5, 0.4, 0.3), 0.0, 1.5)),
        ((0.0, 0.0, 0.0), (1.0, 0.77, 0.34), ((1.0, 0.77, 0.34), 1.0, 1.5)),
    ],
)
def test_specular_workflow(diffuse, specular, expected) -> None:
    color, metallic, ior = metallic_workflow(diffuse, specular, False)
    np.testing.assert_allclose(color, expected[0], atol=1e-6)
    assert metallic == pytest.approx(expected[1], abs=1e-6)
    assert ior == pytest.approx(expected[2])


def test_specular_workflow_keeps_both_colours() -> None:
    """In between, the metallic model gives back the brightness of both: F0 = 0.04 (1 - m) + b m, diffuse b (1 - m)."""
    color, metallic, _ = metallic_workflow((0.3, 0.3, 0.3), (0.4, 0.4, 0.4), False)
    assert 0.0 < metallic < 1.0
    assert 0.04 * (1 - metallic) + color[0] * metallic == pytest.approx(0.4, abs=0.02)
    assert color[0] * (1 - metallic) == pytest.approx(0.3 * 0.6 / 0.96, abs=0.02)


def test_textures_in_a_package(device: str, tmp_path: Path) -> None:
    stage = stage_in(tmp_path / "loose")
    material, shader = preview(stage, "/World/a")
    connect(stage, shader, "diffuseColor", corner_image(tmp_path / "loose" / "four.png"), sourceColorSpace="sRGB")
    give_uv(add_quad(stage, "/World/quad", material))
    stage.Save()
    package = tmp_path / "packed.usdz"
    assert UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(tmp_path / "loose" / "stage.usda")), str(package))
    arrays = read_stage(package, range(1), ["sunny"])
    use = arrays.materials["sunny"][0].appearance.color_texture
    assert use.file.startswith(str(package)) and use.file.endswith("four.png]")
    appearance = AppearanceArrays(DeviceScene(arrays, device, 1))
    assert not appearance.notes
    texels = appearance.for_weather("sunny").texels.numpy().view(np.float16).reshape(-1, 4)
    np.testing.assert_array_equal(texels[[0, 7, 56, 63], :3], [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)])


def test_broken_coordinates_are_noted(stage: Usd.Stage, tmp_path: Path) -> None:
    material, shader = preview(stage, "/World/a")
    connect(stage, shader, "diffuseColor", corner_image(tmp_path / "a.png"))
    give_uv(add_quad(stage, "/World/few", material), [(0, 0), (1, 1)])
    give_uv(add_quad(stage, "/World/index", material, x=10), indices=[0, 1, 2, 9])
    give_uv(add_quad(stage, "/World/nan", material, x=20), [(0, 0), (float("nan"), 0), (1, 1), (0, 1)])
    arrays = read(stage)
    assert np.isfinite(arrays.uv).all()
    for path in ("/World/few", "/World/index", "/World/nan"):
        assert [line for line in arrays.look_notes if line.startswith(f"{path}: primvars:st")], path


def test_ground_that_holds_puddles_and_pores(device: str, stage: Usd.Stage, tmp_path: Path) -> None:
    for k, (base, coating) in enumerate(
        [("asphalt", "none"), ("asphalt", "paint"), ("leaf_grass", "none"), ("brick", "none"), ("steel", "none")]
    ):
        material = add_material(stage, f"/World/Looks/m{k}", "itu_wood", base)
        material.GetPrim().CreateAttribute("omni:simready:nonvisual:coating", KINDS.Token).Set(coating)
        add_quad(stage, f"/World/q{k}", material, x=10 * k)
    arrays = read(stage)
    appearances = AppearanceArrays(DeviceScene(arrays, device, 1)).for_weather("sunny").appearances.numpy()
    names = [material.name for material in arrays.materials["sunny"]]
    assert {names[k] for k in np.flatnonzero(appearances["is_porous"])} == {"m0", "m3"}
    assert {names[k] for k in np.flatnonzero(appearances["holds_puddles"])} == {"m0", "m1"}
