"""Town assets: the USD that is written, and the shipped Town03 against a rebuild from its description."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Kind, Usd, UsdGeom, UsdSemantics, UsdShade

from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.usd import schema
from mmw.usd.material_library import LIBRARY
from mmw.usd.validate import validate_stage
from mmw.worlds.towns.block_description import SHIPPED_WEATHER, TownWeather
from mmw.worlds.towns.build import build_shipped_town
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.primitives import box
from mmw.worlds.towns.props import build_prop
from mmw.worlds.towns.write_usd import GROUND_MATERIALS, write_town
from tests.fixtures import town_checks as checks

ITU = "mmw:radio:itu"


def small_town() -> list[MeshPart]:
    return [
        MeshPart.of("Roads/slab", box((20, 8, 0.2), (0, 0, -0.1)), "asphalt", "road"),
        MeshPart.of("Terrain/slab", box((20, 8, 0.2), (0, 10, -0.1)), "grass", "terrain"),
        MeshPart.of("Buildings/b_001/facade", box((4, 4, 9), (0, 10, 4.5)), "marble_facade", "building"),
        MeshPart.of("Buildings/b_001/roof", box((4.2, 4.2, 0.2), (0, 10, 9.1)), "concrete_roof", "building"),
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
        assert checks.deepest_label(prim) == part.label


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
    assert value(stage, f"/Town/Materials/marble_facade.{ITU}") == "itu_marble"
    assert validate_stage(stage) == []


def test_weather_can_be_the_users_own(tmp_path):
    weather = {"drizzle": TownWeather(rain_rate_mm_h=2, visibility_m=4000, ground_itu="itu_concrete")}
    stage = open_stage(write_town(tmp_path, "toy", small_town(), LaneGraph(), weather))
    assert stage.GetPrimAtPath("/Town").GetVariantSet("weather").GetVariantNames() == ["drizzle"]
    assert value(stage, f"/Town/Materials/asphalt.{ITU}") == "itu_concrete"


def test_no_weather_changes_a_look(asset):
    """A camera darkens and smooths what is wet itself, from the state of the weather."""
    looks = []
    for weather in SHIPPED_WEATHER:
        stage = open_stage(asset, weather)
        shaders = [prim for prim in stage.Traverse() if prim.IsA(UsdShade.Shader)]
        looks.append({str(a.GetPath()): repr(a.Get()) for prim in shaders for a in prim.GetAttributes()})
    assert len(looks[0]) > 100 and all(look == looks[0] for look in looks[1:])


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
    parts.append(replace(parts[0], **{"path": "Roads/more"} | change))
    with pytest.raises(ValueError, match=message):
        write_town(tmp_path, "toy", parts, LaneGraph(), SHIPPED_WEATHER)


def test_unknown_shipped_town_is_refused():
    with pytest.raises(ValueError, match=r"shipped towns are: .*town03"):
        build_shipped_town("atlantis")


def test_reflectors_stand_around_the_roundabout_and_the_t_junction():
    """Within 60 m of either spot, facades look at it from three sides or more."""
    for spot in ((-0.5, -0.5), (150.0, 133.0)):
        seen = set()
        for _, points in checks.components(checks.stage_of("town03"), "Buildings"):
            offset = points[:, :2].mean(axis=0) - spot
            if np.linalg.norm(offset) < 60:
                seen.add(int(np.degrees(np.arctan2(offset[1], offset[0])) // 90))
        assert len(seen) >= 3, spot
