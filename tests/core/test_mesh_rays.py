"""Wheels as they are read: of the shipped vehicles against their catalogue, of a stage of one's own, and errors."""

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom

from mmw.scene.reader import read_stage
from mmw.scene.scene_data import Prototype
from mmw.usd.vehicle_catalog import load_catalog
from mmw.worlds.vehicles.models import BLUEPRINTS
from tests.fixtures.stages import add_box, add_material, new_stage


def role(prim: Usd.Prim) -> None:
    prim.CreateAttribute("mmw:actor:role", Sdf.ValueTypeNames.Token).Set("vehicle")


def set_wheel(prim: Usd.Prim, radius: float, center=None) -> None:
    prim.CreateAttribute("mmw:wheel:radius", Sdf.ValueTypeNames.Float).Set(radius)
    if center is not None:
        prim.CreateAttribute("mmw:wheel:center", Sdf.ValueTypeNames.Float3).Set(Gf.Vec3f(*map(float, center)))


def read_models(path: Path) -> tuple[Prototype, ...]:
    return read_stage(path, range(1), []).models


@pytest.mark.parametrize("name", sorted(BLUEPRINTS))
def test_shipped_vehicles_have_their_wheels(tmp_path: Path, name: str) -> None:
    catalog = load_catalog()[name]
    stage = new_stage(tmp_path / "a.usda")
    role(UsdGeom.Xform.Define(stage, "/World/car").GetPrim())
    held = stage.DefinePrim("/World/car/Model")
    held.GetReferences().AddReference(str(catalog.asset))
    held.SetInstanceable(True)
    stage.Save()
    (model,) = read_models(tmp_path / "a.usda")
    assert len(model.wheels) == 4
    x, y, z, radius = model.wheels.T
    half = 0.5 * catalog.wheelbase
    np.testing.assert_allclose(radius, catalog.wheel_radius, atol=1e-6)
    np.testing.assert_allclose(z, catalog.wheel_radius, atol=1e-6)
    np.testing.assert_allclose(sorted(x), [-half, -half, half, half], atol=1e-6)
    np.testing.assert_allclose(np.sort(y[x > 0.0]), [-0.5 * catalog.track, 0.5 * catalog.track], atol=1e-6)
    np.testing.assert_allclose(y[x < 0.0].sum(), 0.0, atol=1e-6)
    corners = model.points[model.faces]
    blueprint = BLUEPRINTS[name].wheels
    width = max(blueprint.width, blueprint.rear_width or 0.0)
    for k, (*center, r) in enumerate(model.wheels):
        from_center = corners[model.wheel == k] - center
        reach = np.hypot(from_center[..., 0], from_center[..., 2])
        assert reach.max() == pytest.approx(r, abs=2e-6) and np.abs(from_center[..., 1]).max() < 0.5 * width + 1e-6
        # Closed: the outside of a whole tyre with its rim, and nothing of the body.
        volume = np.einsum("mi,mi->", from_center[:, 0], np.cross(from_center[:, 1], from_center[:, 2])) / 6.0
        assert 0.5 * np.pi * r**2 * blueprint.width < volume < np.pi * r**2 * width
    low = model.points[model.faces[model.wheel < 0]][..., 2].min()
    assert low > 0.1, "only wheels reach the ground"


@pytest.mark.parametrize("up", ["Y", "Z"])
def test_a_stage_of_ones_own_names_wheels_by_their_radius(tmp_path: Path, up: str) -> None:
    """In centimeters, the wheel moved by its prim: the center is the middle of the mesh, or what is given."""
    stage = new_stage(tmp_path / "a.usda", up=up, metres_per_unit=0.01)
    steel = add_material(stage, "/World/steel", "itu_metal")
    role(UsdGeom.Xform.Define(stage, "/World/car").GetPrim())

    def point(x: float, y: float, z: float) -> tuple[float, float, float]:
        return (x, y, z) if up == "Z" else (x, z, -y)

    size = (60.0, 20.0, 60.0) if up == "Z" else (60.0, 60.0, 20.0)
    add_box(stage, "/World/car/body", np.abs(point(400.0, 180.0, 100.0)), point(0.0, 0.0, 90.0), steel)
    front, rear = (add_box(stage, f"/World/car/{name}", size, material=steel) for name in ("front", "rear"))
    for mesh, x in ((front, 140.0), (rear, -130.0)):
        UsdGeom.Xformable(mesh).AddTranslateOp().Set(Gf.Vec3d(*point(x, 80.0, 30.0)))
    set_wheel(front.GetPrim(), 30.0)
    set_wheel(rear.GetPrim(), 15.0, point(2.0, 0.0, 1.0))
    UsdGeom.Xformable(rear).AddScaleOp().Set(Gf.Vec3d(2.0, 2.0, 2.0))
    stage.Save()
    (model,) = read_models(tmp_path / "a.usda")
    np.testing.assert_allclose(model.wheels, [[1.4, 0.8, 0.3, 0.3], [-1.26, 0.8, 0.32, 0.3]], atol=1e-6)
    np.testing.assert_array_equal(model.wheel, np.repeat([-1, 0, 1], 12))


def test_subsets_of_one_wheel_make_one_wheel(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "a.usda")
    steel = add_material(stage, "/World/steel", "itu_metal")
    role(UsdGeom.Xform.Define(stage, "/World/car").GetPrim())
    for name in ("tyre", "trim"):
        box = add_box(stage, f"/World/car/{name}", (2.0, 1.0, 1.0), material=steel)
        for kind, indices, radius in (("left", [0, 1, 5], 0.3), ("right", [4], 0.4), ("none", [], 0.5)):
            subset = UsdGeom.Subset.CreateGeomSubset(UsdGeom.Imageable(box), kind, "face", indices, "wheel")
            set_wheel(subset.GetPrim(), radius, (1.0, 0.0, radius))
    stage.Save()
    (model,) = read_models(tmp_path / "a.usda")
    np.testing.assert_allclose(model.wheels, [[1.0, 0.0, 0.3, 0.3], [1.0, 0.0, 0.4, 0.4]], atol=1e-6)
    np.testing.assert_array_equal(model.wheel, [0, 0, -1, -1, 1, 0, *[-1] * 6] * 2)


def test_models_with_other_wheels_are_others(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "a.usda")
    steel = add_material(stage, "/World/steel", "itu_metal")
    for name, radius in (("a", 0.3), ("b", 0.4), ("c", 0.3)):
        role(UsdGeom.Xform.Define(stage, f"/World/{name}").GetPrim())
        set_wheel(add_box(stage, f"/World/{name}/wheel", (0.6, 0.2, 0.6), material=steel).GetPrim(), radius)
    stage.Save()
    arrays = read_stage(tmp_path / "a.usda", range(1), [])
    assert [actor.model for actor in arrays.actors] == [0, 1, 0]


@pytest.mark.parametrize("radius", [0.0, -0.3, float("nan")])
def test_a_radius_that_is_none_is_an_error(tmp_path: Path, radius: float) -> None:
    stage = new_stage(tmp_path / "a.usda")
    steel = add_material(stage, "/World/steel", "itu_metal")
    role(UsdGeom.Xform.Define(stage, "/World/car").GetPrim())
    set_wheel(add_box(stage, "/World/car/wheel", (0.6, 0.2, 0.6), material=steel).GetPrim(), radius)
    stage.Save()
    with pytest.raises(ValueError, match=r"/World/car/wheel: wheel of radius .*; a radius above 0"):
        read_models(tmp_path / "a.usda")
