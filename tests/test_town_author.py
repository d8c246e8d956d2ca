"""Town assets: the USD that is written, and the shipped Town03 against a rebuild from its description."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import shapely
from pxr import Kind, Usd, UsdGeom, UsdSemantics, UsdShade

from mmw.paths import assets_dir
from mmw.town.author import GROUND_MATERIALS, PAYLOAD, write_town
from mmw.town.block_description import SHIPPED_WEATHER, TownWeather
from mmw.town.build import build_shipped_town, build_town
from mmw.town.description import load_town
from mmw.town.lane_prims import read_lanes
from mmw.town.lanes import LaneGraph
from mmw.town.network import RoadNetwork, build_network
from mmw.town.parts import MeshPart
from mmw.town.props import build_prop
from mmw.town.solids import box
from mmw.usd import schema
from mmw.usd.library import LIBRARY
from mmw.usd.semantics import CARLA_TAG
from mmw.usd.validate import validate_stage

TOWN = assets_dir() / "towns" / "town03"
ITU, ROUGHNESS = "mmw:radio:itu", "Preview.inputs:roughness"


def small_town() -> list[MeshPart]:
    return [
        MeshPart("Roads/slab", *box((20, 8, 0.2), (0, 0, -0.1)), "asphalt", "road"),
        MeshPart("Terrain/slab", *box((20, 8, 0.2), (0, 10, -0.1)), "grass", "terrain"),
        MeshPart("Buildings/b_001/facade", *box((4, 4, 9), (0, 10, 4.5)), "marble_facade", "building"),
        MeshPart("Buildings/b_001/roof", *box((4.2, 4.2, 0.2), (0, 10, 9.1)), "concrete_roof", "building"),
        *build_prop("give_way_sign_001", "give_way_sign", (6, 10, 0), 0.0, np.random.default_rng(0)),
        *build_prop("street_lamp_001", "street_lamp", (-6, 7, 0), 0.0, np.random.default_rng(0)),
    ]


@pytest.fixture
def asset(tmp_path) -> Path:
    return write_town(tmp_path / "towns" / "toy", "toy", small_town(), LaneGraph(), SHIPPED_WEATHER)


def open_stage(path: Path, weather: str = "") -> Usd.Stage:
    schema.register()
    stage = Usd.Stage.Open(str(path))
    if weather:
        stage.GetPrimAtPath("/Town").GetVariantSet("weather").SetVariantSelection(weather)
    return stage


def value(stage: Usd.Stage, path: str):
    return stage.GetAttributeAtPath(path).Get()


def test_town_is_valid_usd_with_kinds_and_units(asset):
    stage = open_stage(asset)
    assert validate_stage(stage) == []
    assert stage.GetDefaultPrim().GetPath() == "/Town"
    assert UsdGeom.GetStageUpAxis(stage) == "Z" and UsdGeom.GetStageMetersPerUnit(stage) == 1
    kinds = {path: Usd.ModelAPI(stage.GetPrimAtPath(path)).GetKind() for path in ("/Town", "/Town/Buildings")}
    assert kinds == {"/Town": Kind.Tokens.assembly, "/Town/Buildings": Kind.Tokens.group}
    for path in ("/Town/Buildings/b_001", "/Town/Props/street_lamp_001"):
        assert Usd.ModelAPI(stage.GetPrimAtPath(path)).GetKind() == Kind.Tokens.component


def test_meshes_keep_points_faces_materials_and_labels(asset):
    stage = open_stage(asset)
    for part in small_town():
        prim = stage.GetPrimAtPath(f"/Town/{part.path}")
        mesh = UsdGeom.Mesh(prim)
        points = np.array(mesh.GetPointsAttr().Get())
        assert np.allclose(points, part.points, atol=1e-5)
        assert np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3).tolist() == part.faces.tolist()
        assert np.allclose(mesh.GetExtentAttr().Get(), [points.min(axis=0), points.max(axis=0)])
        assert mesh.GetSubdivisionSchemeAttr().Get() == "none"
        for purpose in (UsdShade.Tokens.allPurpose, "radio"):
            bound = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial(purpose)[0]
            assert bound.GetPath() == f"/Town/Materials/{part.material}"
        assert deepest_label(prim) == part.label


def deepest_label(prim: Usd.Prim) -> str:
    while prim and not prim.HasAPI(UsdSemantics.LabelsAPI, "class"):
        prim = prim.GetParent()
    return UsdSemantics.LabelsAPI(prim, "class").GetLabelsAttr().Get()[0]


def test_labels_stand_as_high_as_they_hold(asset):
    stage = open_stage(asset)
    labelled = {str(p.GetPath()) for p in stage.Traverse() if p.HasAPI(UsdSemantics.LabelsAPI, "class")}
    assert labelled == {
        "/Town/Roads", "/Town/Terrain", "/Town/Buildings", "/Town/Props/give_way_sign_001",
        "/Town/Props/give_way_sign_001/post", "/Town/Props/street_lamp_001",
    }  # fmt: skip


@pytest.mark.parametrize("weather", SHIPPED_WEATHER)
def test_weather_variant_wins_over_the_library(asset, weather):
    stage = open_stage(asset, weather)
    state = SHIPPED_WEATHER[weather]
    assert value(stage, "/Town.mmw:weather:rainRate") == pytest.approx(state.rain_rate_mm_h)
    assert value(stage, "/Town.mmw:weather:visibility") == pytest.approx(state.visibility_m)
    for material in GROUND_MATERIALS:
        spec, path = LIBRARY[material], f"/Town/Materials/{material}"
        wanted = spec.radio.itu if weather == "sunny" else "itu_wet_ground"
        assert value(stage, f"{path}.{ITU}") == wanted
        roughness, color = value(stage, f"{path}/{ROUGHNESS}"), value(stage, f"{path}/Preview.inputs:diffuseColor")
        if weather == "sunny":
            assert roughness == pytest.approx(spec.roughness) and np.allclose(color, spec.color)
        else:
            assert roughness < spec.roughness and np.all(np.array(color) < spec.color)
    assert value(stage, f"/Town/Materials/marble_facade.{ITU}") == "itu_marble"
    assert validate_stage(stage) == []


def test_weather_can_be_the_users_own(tmp_path):
    weather = {"drizzle": TownWeather(rain_rate_mm_h=2, visibility_m=4000, ground_itu="itu_concrete")}
    stage = open_stage(write_town(tmp_path, "toy", small_town(), LaneGraph(), weather))
    assert stage.GetPrimAtPath("/Town").GetVariantSet("weather").GetVariantNames() == ["drizzle"]
    assert value(stage, f"/Town/Materials/asphalt.{ITU}") == "itu_concrete"


def test_rainy_and_foggy_are_equally_wet_for_radio_but_not_for_cameras(asset):
    rough = [value(open_stage(asset, w), f"/Town/Materials/asphalt/{ROUGHNESS}") for w in ("sunny", "foggy", "rainy")]
    assert rough[0] > rough[1] > rough[2] > 0


def test_same_parts_give_the_same_bytes(tmp_path):
    for name in "ab":
        write_town(tmp_path / name, "toy", small_town(), LaneGraph(), SHIPPED_WEATHER)
    for file in ("toy.usda", PAYLOAD):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"material": "cheese"}, "material 'cheese'; the library holds"),
        ({"label": "cheese"}, "label 'cheese'; labels are"),
        ({"path": "Roads"}, "'Roads': not a prim path"),
        ({"path": "Roads/2 x"}, "not a prim path"),
        ({"path": "Buildings/b_001/roof"}, "'Buildings/b_001/roof' is given twice"),
    ],
)
def test_bad_parts_are_refused(tmp_path, change, message):
    parts = small_town()
    first = parts[0]
    data = {"path": "Roads/more", "material": first.material, "label": first.label} | change
    parts.append(MeshPart(data["path"], first.points, first.faces, data["material"], data["label"]))
    with pytest.raises(ValueError, match=message):
        write_town(tmp_path, "toy", parts, LaneGraph(), SHIPPED_WEATHER)


def test_unknown_shipped_town_is_refused():
    with pytest.raises(ValueError, match=r"shipped towns are: .*town03"):
        build_shipped_town("atlantis")


@pytest.fixture(scope="module")
def rebuilt(tmp_path_factory) -> Path:
    """Build Town03 again, beside a copy of the material library, as in the assets folder."""
    root = tmp_path_factory.mktemp("usd")
    (root / "materials").mkdir()
    materials = shutil.copy(assets_dir() / "materials" / "materials.usda", root / "materials")
    return build_town(TOWN / "town03.yaml", root / "towns" / "town03", materials).path


@pytest.fixture(scope="module")
def network() -> RoadNetwork:
    return build_network(load_town(TOWN / "town03.yaml"))


@pytest.fixture(scope="module")
def town03() -> Usd.Stage:
    return open_stage(TOWN / "town03.usda")


def test_shipped_town03_is_what_its_description_builds(rebuilt):
    """The same prims and properties everywhere, arrays within 0.1 mm; mostly the same bytes, and then at once."""
    ours, theirs = (path.read_text().splitlines() for path in (rebuilt, TOWN / "town03.usda"))
    assert [line for line in ours if "extentsHint" not in line] == [
        line for line in theirs if "extentsHint" not in line
    ]
    if (rebuilt.parent / PAYLOAD).read_bytes() == (TOWN / PAYLOAD).read_bytes():
        return
    ours, theirs = (Usd.Stage.Open(str(path / PAYLOAD)) for path in (rebuilt.parent, TOWN))
    assert [p.GetPath() for p in ours.TraverseAll()] == [p.GetPath() for p in theirs.TraverseAll()]
    for prim in ours.TraverseAll():
        other = theirs.GetPrimAtPath(prim.GetPath())
        assert prim.GetTypeName() == other.GetTypeName()
        assert prim.GetPropertyNames() == other.GetPropertyNames()
        for attribute in prim.GetAttributes():
            a, b = attribute.Get(), other.GetAttribute(attribute.GetName()).Get()
            if attribute.GetName() in ("points", "extent"):
                assert np.allclose(a, b, rtol=0, atol=1e-4), attribute.GetPath()
            else:
                assert a == b, attribute.GetPath()
        for relation in prim.GetRelationships():
            assert relation.GetTargets() == other.GetRelationship(relation.GetName()).GetTargets()


def test_shipped_town03_is_valid_and_of_real_size(town03):
    assert validate_stage(town03) == []
    meshes = [UsdGeom.Mesh(prim) for prim in town03.Traverse() if prim.IsA(UsdGeom.Mesh)]
    triangles = sum(len(mesh.GetFaceVertexCountsAttr().Get()) for mesh in meshes)
    assert 100_000 < triangles < 250_000
    assert sum((TOWN / file).stat().st_size for file in (PAYLOAD, "town03.usda")) < 6_000_000
    assert len(town03.GetPrimAtPath("/Town/Buildings").GetChildren()) > 100
    for mesh in meshes:
        prim = mesh.GetPrim()
        bound = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0].GetPrim()
        assert bound.GetAttribute(ITU).Get() or bound.GetAttribute("mmw:radio:model").Get() == "constant"
        assert deepest_label(prim) in CARLA_TAG
    assert len(read_lanes(town03, "/Town").lanes) > 100


def points_below(stage: Usd.Stage, group: str):
    """Yield (component prim, all its points [N, 3]) of a group."""
    for component in stage.GetPrimAtPath(f"/Town/{group}").GetChildren():
        meshes = [UsdGeom.Mesh(prim) for prim in Usd.PrimRange(component) if prim.IsA(UsdGeom.Mesh)]
        yield component, np.concatenate([np.array(mesh.GetPointsAttr().Get(), np.float64) for mesh in meshes])


def test_no_building_of_town03_touches_a_road_or_floats(town03, network):
    plans = []
    for component, points in points_below(town03, "Buildings"):
        plan = shapely.convex_hull(shapely.multipoints(points[:, :2]))
        assert not plan.intersects(network.corridor), component.GetPath()
        feet = points[points[:, 2] < points[:, 2].min() + 1e-3]
        assert np.all(feet[:, 2] < network.height(*feet[:, :2].T) - 0.3), component.GetPath()
        plans.append(plan)
    tree = shapely.STRtree(plans)
    first, second = tree.query(plans, predicate="intersects")
    assert np.all(first == second)


def test_no_prop_of_town03_stands_in_a_lane_or_floats(town03, network):
    driven = shapely.union_all(
        [shapely.LineString(lane.points[:, :2]).buffer(0.5 * lane.width) for lane in network.lanes.lanes.values()]
    )
    shapely.prepare(driven)
    for component, points in points_below(town03, "Props"):
        ground = network.height(*points[:, :2].T)
        low = points[points[:, 2] < ground + 4.5]  # a double-decker is 4.4 m tall
        assert not shapely.intersects_xy(driven, *low[:, :2].T).any(), component.GetPath()
        assert (points[:, 2] < ground).any(), component.GetPath()


def test_reflectors_stand_around_the_roundabout_and_the_t_junction(town03):
    """Within 60 m of either spot, facades look at it from three sides or more."""
    for spot in ((-0.5, -0.5), (150.0, 133.0)):
        seen = set()
        for _, points in points_below(town03, "Buildings"):
            offset = points[:, :2].mean(axis=0) - spot
            if np.linalg.norm(offset) < 60:
                seen.add(int(np.degrees(np.arctan2(offset[1], offset[0])) // 90))
        assert len(seen) >= 3, spot
