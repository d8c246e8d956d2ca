"""Any USD stage becomes a world: axes, units, handedness, instances, materials, labels, lanes; nothing missing."""

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, UsdShade

from mmw.config.material_map import MaterialEntry
from mmw.physics.materials.material import RadioMaterial
from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.traffic.roads.lane_prims import write_lanes
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.importers.material_map import apply_material_map
from mmw.worlds.importers.mesh_cleanup import bounds
from mmw.worlds.importers.usd_stage import read_usd
from tests.fixtures.import_files import HIGH, HOUSE_HIGH, HOUSE_LOW, LOW, write_stage
from tests.fixtures.meshes import part_at, volume
from tests.fixtures.scenes import box_mesh
from tests.fixtures.stages import add_box, add_material, add_polygons, bind, new_stage, saved, write_town


@pytest.fixture
def stage(tmp_path: Path) -> Usd.Stage:
    return write_stage(tmp_path / "a.usda")


def read(stage: Usd.Stage, **options) -> ImportedScene:
    return read_usd(saved(stage), **options)


@pytest.mark.parametrize("up", ["Y", "Z"])
@pytest.mark.parametrize("metres_per_unit", [1.0, 0.01, 0.0254])
def test_axes_and_units(tmp_path: Path, up: str, metres_per_unit: float) -> None:
    world = read(write_stage(tmp_path / "a.usda", up=up, metres_per_unit=metres_per_unit))
    assert np.allclose(bounds(world), (LOW, HIGH), atol=1e-4)
    assert [(part.path, part.label) for part in world.parts] == [
        ("World/ground", "unlabeled"), ("World/house/walls", "building")
    ]  # fmt: skip
    assert np.allclose(world.parts[1].mesh.bounds, (HOUSE_LOW, HOUSE_HIGH), atol=1e-4)
    assert volume(world.parts[1]) == pytest.approx(480, rel=1e-5)
    assert world.components == {"World/house"}
    assert world.lanes is None
    assert world.notes == ()
    brick = world.materials["brick"]
    assert (brick.base, brick.radio) == ("brick", RadioMaterial("itu", itu="itu_brick", thickness=0.1))


def test_left_handed_mirrored_and_sheared_meshes_look_outward(stage: Usd.Stage) -> None:
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/World/house/walls"))
    mesh.CreateOrientationAttr("leftHanded")
    mesh.GetFaceVertexIndicesAttr().Set([k for face in box_mesh((1, 1, 1))[1][:, ::-1].tolist() for k in face])
    mirrored = add_box(stage, "/World/twin", (10, 8, 6), (12, 9, 3))
    UsdGeom.Xformable(mirrored).AddTransformOp().Set(Gf.Matrix4d(-1, 0, 0, 0, 0.5, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1))
    world = read(stage)
    assert volume(part_at(world.parts, "World/house/walls")) == pytest.approx(480)
    twin = part_at(world.parts, "World/twin")
    assert volume(twin) == pytest.approx(480)
    assert np.allclose((twin.points[:, 0].min(), twin.points[:, 0].max()), (-17 + 2.5, -7 + 6.5))


def test_instances_and_point_instancers_are_made_real(stage: Usd.Stage) -> None:
    for k in range(2):
        prim = stage.DefinePrim(f"/World/copy_{k}", "Xform")
        prim.GetReferences().AddInternalReference("/World/house")
        prim.SetInstanceable(True)
        UsdGeom.Xformable(prim).AddTranslateOp().Set(Gf.Vec3d(-20.0 - 15 * k, 0, 0))
    instancer = UsdGeom.PointInstancer.Define(stage, "/World/posts")
    pole = add_box(stage, "/World/posts/proto/pole", (0.2, 0.2, 4), (0, 0, 2))
    bind(pole.GetPrim(), UsdShade.Material(stage.GetPrimAtPath("/World/Looks/brick")))
    instancer.CreatePrototypesRel().AddTarget("/World/posts/proto")
    instancer.CreateProtoIndicesAttr([0, 0, 0])
    instancer.CreatePositionsAttr([Gf.Vec3f(-10, -9, 0), Gf.Vec3f(0, -9, 0), Gf.Vec3f(10, -9, 0)])
    world = read(stage)
    assert sorted(part.path for part in world.parts) == [
        "World/copy_0/walls", "World/copy_1/walls", "World/ground", "World/house/walls",
        "World/posts/pole", "World/posts/pole_2", "World/posts/pole_3",
    ]  # fmt: skip
    assert np.allclose(part_at(world.parts, "World/copy_1/walls").points.min(axis=0), np.add(HOUSE_LOW, (-35, 0, 0)))
    poles = [part.points.mean(axis=0) for part in world.parts if "posts" in part.path]
    assert np.allclose(poles, [(-10, -9, 2), (0, -9, 2), (10, -9, 2)], atol=1e-5)
    assert {"World/copy_0", "World/copy_1", "World/house"} == world.components


def test_subsets_meshes_above_meshes_and_components(stage: Usd.Stage) -> None:
    walls = stage.GetPrimAtPath("/World/house/walls")
    glass = add_material(stage, "/Materials/glass", base="clear_glass")
    subset = UsdGeom.Subset.CreateGeomSubset(UsdGeom.Mesh(walls), "pane", "face", [0, 1], "materialBind")
    bind(subset.GetPrim(), glass)
    add_box(stage, "/World/house/walls/knob", (0.1, 0.1, 0.1), material=glass)
    add_box(stage, "/Materials/sphere", (1, 1, 1), material=glass)
    Usd.ModelAPI(stage.GetPrimAtPath("/World/ground")).SetKind(Kind.Tokens.component)
    world = read(stage)
    faces = {part.path: (len(part.faces), part.material) for part in world.parts}
    assert faces == {
        "World/ground": (2, "brick"),
        "World/house/walls/brick": (10, "brick"),
        "World/house/walls/glass": (2, "glass"),
        "World/house/walls/knob": (12, "glass"),
        "Materials_2/sphere": (12, "glass"),
    }
    assert np.ptp(part_at(world.parts, "World/house/walls/glass").points[:, 0]) == 0
    assert world.components == {"World/ground", "World/house"}
    assert world.materials["glass"].radio == RadioMaterial("itu", itu="itu_glass")  # of its SimReady base


def test_what_a_stage_says_about_looks_and_what_is_left_out(stage: Usd.Stage) -> None:
    shader = UsdShade.Shader.Define(stage, "/World/Looks/brick/Preview")
    shader.CreateIdAttr("UsdPreviewSurface")
    for name, kind, value in (
        ("diffuseColor", Sdf.ValueTypeNames.Color3f, Gf.Vec3f(0.25, 0.125, 0.0)),
        ("roughness", Sdf.ValueTypeNames.Float, 0.7), ("opacity", Sdf.ValueTypeNames.Float, 0.5),
    ):  # fmt: skip
        shader.CreateInput(name, kind).Set(value)
    brick = UsdShade.Material(stage.GetPrimAtPath("/World/Looks/brick"))
    brick.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    plain = add_material(stage, "/World/Looks/plain")
    picture = UsdShade.Shader.Define(stage, "/World/Looks/plain/Picture")
    shader = UsdShade.Shader.Define(stage, "/World/Looks/plain/Preview")
    shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(picture.ConnectableAPI(), "rgb")
    plain.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
    add_box(stage, "/World/textured", (1, 1, 1), material=plain)
    add_box(stage, "/World/bare", (1, 1, 1))
    hidden = add_box(stage, "/World/hidden", (99, 99, 99))
    UsdGeom.Imageable(hidden).MakeInvisible()
    UsdGeom.Imageable(add_box(stage, "/World/guide", (99, 99, 99))).CreatePurposeAttr("guide")
    mover = UsdGeom.Xformable(stage.GetPrimAtPath("/World/bare")).AddTranslateOp()
    mover.Set(Gf.Vec3d(1, 0, 0), 0)
    mover.Set(Gf.Vec3d(5, 0, 0), 10)
    variants = stage.GetPrimAtPath("/World").GetVariantSets().AddVariantSet("season")
    for name in ("summer", "winter"):
        variants.AddVariant(name)
    variants.SetVariantSelection("winter")
    world = read(stage)
    look = world.materials["brick"]
    assert (look.color, look.roughness, look.opacity) == ((0.25, 0.125, 0.0), 0.7, 0.5)
    assert (world.materials["plain"].radio, world.materials["plain"].color) == (None, None)
    assert part_at(world.parts, "World/bare").material == "no_material"
    assert part_at(world.parts, "World/bare").points[:, 0].mean() == pytest.approx(1)
    assert [part.path for part in world.parts][-2:] == ["World/textured", "World/bare"]
    assert world.notes == (
        "/World: of variant set season only 'winter' is kept",
        "1 prims move; they stay where they are at the start (to keep motion, use `stage:`)",
        "textures are not kept, these materials have a plain color: plain",
    )


def test_a_name_that_holds_no_row_is_left_to_the_map(stage: Usd.Stage) -> None:
    bind(add_box(stage, "/World/crate", (1, 1, 1), (30, 0, 1)).GetPrim(), add_material(stage, "/World/m_itu_cheese"))
    world = read(stage)
    assert world.materials[part_at(world.parts, "World/crate").material].radio is None
    with pytest.raises(ValueError, match="material 'm_itu_cheese': the radio material 'itu_cheese' does not exist"):
        apply_material_map("file", world, {"/World/ground": MaterialEntry(radio="itu_brick")})
    found = apply_material_map("file", world, {"*": MaterialEntry(radio="itu_brick")})
    assert all(material.radio and material.radio.itu == "itu_brick" for material in found.materials.values())


def test_lanes_come_along_in_metres(tmp_path: Path) -> None:
    stage = write_stage(tmp_path / "a.usda", up="Y", metres_per_unit=0.01)
    ahead = np.array([[0.0, 0, 0], [0, 0, -1000]])
    write_lanes(stage, "/World/Lanes", LaneGraph({"a": Lane("a", ahead, 3.5, 8.0, successors=("a",))}))
    world = read(stage, origin=(1, 0, 0))
    lane = world.lanes.lanes["a"]
    assert np.allclose(lane.points, [[-1, 0, 0], [-1, 10, 0]])
    assert (lane.width, lane.speed, lane.successors) == (pytest.approx(3.5), 8.0, ("a",))


def test_a_town_of_mmw_is_read_back(tmp_path: Path) -> None:
    world = read_usd(write_town(tmp_path / "town.usda"))
    assert {part.path: part.label for part in world.parts} == {
        "Town/Roads/street": "road", "Town/Buildings/b_001/facade": "building",
        "Town/Buildings/b_001/window": "building",
    }  # fmt: skip
    assert "of variant set weather only 'sunny'" in world.notes[0]


def test_a_unit_that_is_not_said(tmp_path: Path) -> None:
    stage = Usd.Stage.CreateNew(str(tmp_path / "a.usda"))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.Xform.Define(stage, "/World")
    add_box(stage, "/World/house", (10, 8, 6), (12, 9, 3))
    assert np.allclose(bounds(read(stage))[1], np.multiply(HOUSE_HIGH, 0.01))
    world = read(stage, unit_m=1.0)
    assert np.allclose(bounds(world)[1], HOUSE_HIGH)
    assert "does not say its unit" in world.notes[0]


@pytest.mark.parametrize("arc", ["payload", "references", "subLayers"])
def test_a_missing_layer_is_named(stage: Usd.Stage, arc: str) -> None:
    if arc == "subLayers":
        stage.GetRootLayer().subLayerPaths.append("./gone.usdc")
    else:
        prim = stage.DefinePrim("/World/annex")
        (prim.GetPayloads().AddPayload if arc == "payload" else prim.GetReferences().AddReference)("./gone.usdc")
    with pytest.raises(ValueError, match=r"a\.usda: 1 references or payloads do not resolve") as caught:
        read(stage)
    assert "gone.usdc" in str(caught.value)
    assert arc == "subLayers" or "/World/annex" in str(caught.value)


@pytest.mark.parametrize(
    ("name", "content"), [("a.usda", b"#usda 1.0\ndef {"), ("a.usdc", b""), ("a.usdz", b"PK\x03\x04")]
)
def test_broken_files(tmp_path: Path, name: str, content: bytes) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ValueError, match="USD cannot read it"):
        read_usd(tmp_path / name)
    with pytest.raises(ValueError, match="no such file"):
        read_usd(tmp_path / "nowhere.usda")


FLAT = (
    'def Mesh "L0" {\nint[] faceVertexCounts = [3]\nint[] faceVertexIndices = [0, 1, 2]\n'
    "point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]\n}\n"
)
TENFOLD = FLAT + "".join(
    f'def "L{k}" {{\n' + "".join(f'def "c{n}" (references = </L{k - 1}>) {{}}\n' for n in range(10)) + "}\n"
    for k in range(1, 9)
)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('def "a" {' * 100_000 + "}" * 100_000, r"a\.usda:2: nested more than 200 deep"),
        ('def "a" { int[] b = ' + "[" * 100_000, r"a\.usda:2: nested more than 200 deep"),
        (TENFOLD, r"a\.usda: /L\d: would become over 2,000,000 prims"),
        (TENFOLD.replace("references", "instanceable = true\nreferences"), "would become over 2,000,000 prims"),
        ('def "A" (references = </B>) {}\ndef "B" (references = </A>) {}', "do not resolve"),
        ("(subLayers = [@./a.usda@])", "do not resolve"),
        ("(metersPerUnit = 0)" + "\n" + FLAT, "metersPerUnit = 0; 1e-9 to 1e9 is needed"),
        (FLAT.replace("int[] faceVertexCounts", "string faceVertexCounts").replace("[3]", '"3"'), "numbers are needed"),
        (
            FLAT.replace("[3]", "[-1, 4]"),
            "/L0: a face has -1 corners",
        ),
        (
            FLAT + 'def PointInstancer "P" {\nrel prototypes = </L0>\nint[] protoIndices = [0, 9]\n'
            "point3f[] positions = [(0, 0, 0), (1, 0, 0)]\n}",
            "/P: protoIndices from 0 to 9, of 1 prototypes",
        ),
    ],
    ids=lambda text: text[:20],
)
def test_stages_that_would_end_the_process_or_fill_the_memory(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "a.usda").write_text(f"#usda 1.0\n{text}\n")
    with pytest.raises(ValueError, match=words):
        read_usd(tmp_path / "a.usda")


def test_brackets_in_strings_are_no_nesting(tmp_path: Path) -> None:
    (tmp_path / "a.usda").write_text(f'#usda 1.0\n(doc = "{"{" * 500}")\n{FLAT}# {"(" * 500}\n')
    assert len(read_usd(tmp_path / "a.usda").parts) == 1


def test_a_damaged_crate_is_named(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "b.usda")
    add_polygons(stage, "/World/t", np.arange(3000.0).reshape(-1, 3), [[k, k + 1, k + 2] for k in range(900)])
    stage.Export(str(tmp_path / "a.usdc"))
    data = (tmp_path / "a.usdc").read_bytes()
    messages = set()
    for at in range(90, len(data), max(1, len(data) // 40)):
        (tmp_path / f"a{at}.usdc").write_bytes(
            data[:at] + bytes(255 - byte for byte in data[at : at + 9]) + data[at + 9 :]
        )
        try:
            read_usd(tmp_path / f"a{at}.usdc")
        except ValueError as error:
            messages.add(str(error).partition(": ")[0])
    assert messages  # every other exception fails the test
    assert all(name.startswith((str(tmp_path), "/World/t")) for name in messages)


@pytest.mark.parametrize(
    ("attribute", "value", "part"),
    [("points", [Gf.Vec3f(0, 0, 0), Gf.Vec3f(float("nan"), 0, 0), Gf.Vec3f(0, 1, 0)], "not finite"),
     ("faceVertexIndices", [0, 1, 7], "over 3 points")],
)  # fmt: skip
def test_broken_meshes(tmp_path: Path, attribute: str, value: list, part: str) -> None:
    stage = new_stage(tmp_path / "a.usda")
    mesh = add_polygons(stage, "/World/t", np.eye(3), [[0, 1, 2]])
    mesh.GetPrim().GetAttribute(attribute).Set(value)
    with pytest.raises(ValueError, match=f"/World/t: .*{part}"):
        read(stage)
