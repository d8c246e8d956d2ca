"""Every shipped town: its builder, its size, its payload, and the places of buildings, props and roadside units."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import shapely
from pxr import Usd

from mmw.config import load_config
from mmw.core.resources import assets_dir, configs_dir
from mmw.usd.semantics import CARLA_TAG
from mmw.usd.validate import validate_stage
from mmw.worlds.towns.build import build_town
from mmw.worlds.towns.write_usd import PAYLOAD
from tests.fixtures import town_checks as checks
from tests.fixtures.town_compare import assert_same_town

SCENARIOS = sorted((configs_dir() / "scenarios").glob("*.yaml"))
TOWNS = {"town03": 100, "town05": 120, "town07": 50, "town10": 45}
"""Town -> it has more buildings than this (count)."""


def test_these_are_all() -> None:
    assert sorted(path.parent.name for path in (assets_dir() / "towns").glob("*/*.yaml")) == list(TOWNS)


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name != "town10")) for name in TOWNS])
def test_committed_files_are_what_the_description_builds(name: str, tmp_path: Path) -> None:
    """Build the town again, beside the same libraries: it is the same town, whatever CPU and libraries build it.

    Builds on x86-64 with SSE4.2, AVX2 and AVX-512 have the same bytes; other versions of SciPy, GEOS or earcut may cut
    polygons into other triangles.
    """
    shutil.copytree(assets_dir() / "materials", tmp_path / "materials")
    shutil.copytree(assets_dir() / "vehicles", tmp_path / "vehicles")
    materials = tmp_path / "materials" / "materials.usda"
    built = build_town(checks.folder_of(name) / f"{name}.yaml", tmp_path / "towns" / name, materials).path
    assert_same_town(built.parent, checks.folder_of(name), name)


@pytest.mark.parametrize("name", TOWNS)
def test_asset_is_valid_and_within_the_budget(name: str) -> None:
    """OpenUSD's validators are content; 180 to 330 thousand triangles; every mesh has a material and a class."""
    stage = checks.stage_of(name)
    assert validate_stage(stage) == []
    triangles = 0
    for mesh in checks.meshes_below(stage.GetPseudoRoot()):
        if not mesh.GetPrim().IsInstanceProxy():  # parked cars share the shapes of the moving ones
            triangles += len(mesh.GetFaceVertexCountsAttr().Get())
        prim = mesh.GetPrim()
        bound = checks.material_of(prim)
        assert bound.GetAttribute("mmw:radio:itu").Get() or bound.GetAttribute("mmw:radio:model").Get() == "constant"
        assert checks.deepest_label(prim) in CARLA_TAG, prim.GetPath()
    assert 180_000 < triangles < 330_000
    assert sum((checks.folder_of(name) / file).stat().st_size for file in (PAYLOAD, f"{name}.usda")) < 10_000_000
    assert len(stage.GetPrimAtPath("/Town/Buildings").GetChildren()) > TOWNS[name]


@pytest.mark.parametrize("name", TOWNS)
def test_opens_without_what_is_not_needed(name: str) -> None:
    """The roads, buildings and props come as a payload; without it nothing but the interface and materials is read."""
    path = checks.folder_of(name) / f"{name}.usda"
    light = Usd.Stage.Open(str(path), Usd.Stage.LoadNone)
    layers = {Path(layer.realPath).name for layer in light.GetUsedLayers() if layer.realPath}
    assert not checks.meshes_below(light.GetPseudoRoot()) and f"{name}.usda" in layers and PAYLOAD not in layers
    light.Load()
    assert checks.meshes_below(light.GetPseudoRoot())
    models = [prim for prim in light.Traverse() if prim.GetName() == "Model"]
    assert all(prim.IsInstance() for prim in models) and len(light.GetPrototypes()) <= len(models)


@pytest.mark.parametrize("name", TOWNS)
def test_every_lane_can_be_reached(name: str) -> None:
    assert len(checks.assert_connected(checks.stage_of(name)).lanes) > 100


@pytest.mark.parametrize("name", TOWNS)
def test_no_building_touches_a_road_or_floats(name: str) -> None:
    """No building reaches into a road or another building, and all feet are below the ground."""
    stage, network = checks.stage_of(name), checks.network_of(name)
    plans = []
    for component, points in checks.components(stage, "Buildings"):
        low = points[points[:, 2] < points[:, 2].min() + 3.5]
        plan = shapely.convex_hull(shapely.multipoints(low[:, :2]))
        assert not plan.intersects(network.corridor), component.GetPath()
        feet = points[points[:, 2] < points[:, 2].min() + 1e-3]
        assert np.all(feet[:, 2] < network.height(*feet[:, :2].T) - 0.3), component.GetPath()
        plans.append(plan)
    first, second = shapely.STRtree(plans).query(plans, predicate="intersects")
    assert np.all(first == second)


@pytest.mark.parametrize("name", TOWNS)
def test_no_prop_stands_in_a_lane_or_floats(name: str) -> None:
    """No prop reaches into a lane below 4.5 m, the height of a double-decker, and none floats."""
    stage, network = checks.stage_of(name), checks.network_of(name)
    driven = shapely.union_all(
        [shapely.LineString(lane.points[:, :2]).buffer(0.5 * lane.width) for lane in network.lanes.lanes.values()]
    )
    shapely.prepare(driven)
    for component, points in checks.components(stage, "Props"):
        ground = network.height(*points[:, :2].T)
        low = points[points[:, 2] < ground + 4.5]
        assert not shapely.intersects_xy(driven, *low[:, :2].T).any(), component.GetPath()
        assert (points[:, 2] < ground).any(), component.GetPath()


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_units_stand_beside_the_road_in_nothing_solid(path: Path) -> None:
    """A roadside unit is off the carriageway, within 12 m of it, and in nothing solid."""
    (scenario,) = load_config(path).scenarios
    assert scenario.name == path.stem and scenario.town is not None and scenario.name.startswith(scenario.town)
    if scenario.name == "town05_ring_road":
        return  # on the parapet: `tests/worlds/towns/test_town05.py`
    stage, network = checks.stage_of(scenario.town), checks.network_of(scenario.town)
    for unit in scenario.rsus:
        foot = shapely.Point(unit.position_m[:2])
        assert 0.3 < shapely.distance(network.carriageway, foot) < 12.0
        for group in ("Buildings", "Props"):
            for component, points in checks.components(stage, group):
                near = points[(points[:, 2] > unit.position_m[2] - 1) & (points[:, 2] < unit.position_m[2] + 5)]
                if len(near) and np.hypot(*(near[:, :2] - unit.position_m[:2]).T).min() < 12.0:
                    plan = shapely.convex_hull(shapely.multipoints(near[:, :2]))
                    assert not shapely.dwithin(plan, foot, 0.2), component.GetPath()
