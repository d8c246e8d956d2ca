"""Reading scenario stages, and the scene on the device."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom

from mmw.core.mesh import TriangleMesh
from mmw.core.transforms import quaternion_to_matrix
from mmw.scene.device_scene import DeviceScene
from mmw.scene.reader import read_stage
from mmw.scene.scene_data import SceneData
from tests.fixtures.device_rays import loaded
from tests.fixtures.meshes import volume
from tests.fixtures.scenes import ABSENT, arrays_from_parts, box_model, ground_part, two_cars
from tests.fixtures.stages import (
    add_box,
    add_material,
    add_polygons,
    animate,
    bind,
    label,
    new_stage,
    saved,
    write_scenario,
    write_town,
)


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    return write_scenario(tmp_path)


def test_actors_and_poses(scenario: Path) -> None:
    arrays = read_stage(scenario, range(5), ["sunny"])
    assert [actor.name for actor in arrays.actors] == ["cav_1", "veh_002", "veh_003", "rsu_1"]
    assert [actor.role for actor in arrays.actors] == ["cav", "vehicle", "vehicle", "rsu"]
    assert [actor.model for actor in arrays.actors] == [0, 0, 0, -1]
    assert [actor.label for actor in arrays.actors] == ["car", "car", "car", "unlabeled"]
    assert arrays.actors[0].size == (4.5, 1.8, 1.5)
    assert arrays.actors[0].center == (0.1, 0.0, 0.75)
    np.testing.assert_array_equal(arrays.poses[:, 0, :3], [[-10 + k, 0, 0] for k in range(5)])
    angle = 0.3 * np.arange(5)
    np.testing.assert_allclose(arrays.poses[:, 1, 5], np.sin(angle / 2), atol=1e-7)
    np.testing.assert_allclose(arrays.poses[:, 3], np.tile([1, 2, 6, 0, 0, 0, 1.0], (5, 1)), atol=1e-15)


def test_equal_vehicles_share_a_model(scenario: Path) -> None:
    (model,) = read_stage(scenario, range(5), ["sunny"]).models
    assert model.name == "sedan"
    assert len(model.faces) == 24
    np.testing.assert_allclose(model.points.min(axis=0), [-2.25, -0.9, 0.0], atol=1e-6)
    np.testing.assert_allclose(model.points.max(axis=0), [2.25, 0.9, 1.5], atol=1e-6)
    assert len(np.unique(model.surface)) == 12


def test_objects_are_components_then_actors(scenario: Path) -> None:
    arrays = read_stage(scenario, range(2), ["sunny"])
    found = [(o.object_id, o.prim_path, o.label, o.tag, o.materials, o.actor) for o in arrays.objects]
    assert found == [
        (0, "/World/Town/Buildings/b_001", "building", 3, ("glass", "marble"), ""),
        (1, "/World/Town/Roads/street", "road", 1, ("asphalt",), ""),
        (2, "/World/Actors/cav_1", "car", 14, ("car_glass", "paint"), "cav_1"),
        (3, "/World/Actors/veh_002", "car", 14, ("car_glass", "paint"), "veh_002"),
        (4, "/World/Actors/veh_003", "car", 14, ("car_glass", "paint"), "veh_003"),
        (5, "/World/RSU/rsu_1", "unlabeled", 0, (), "rsu_1"),
    ]
    assert set(arrays.object_id) == {0, 1}
    top = arrays.points[arrays.faces[arrays.object_id == 0]].reshape(-1, 3)
    np.testing.assert_allclose([top.min(axis=0), top.max(axis=0)], [[-10, 24.8, 0], [10, 35, 10]], atol=1e-5)


def test_weather_changes_materials_and_nothing_else(scenario: Path) -> None:
    arrays = read_stage(scenario, range(2), ["sunny", "rainy"])
    sunny, rainy = arrays.materials["sunny"], arrays.materials["rainy"]
    assert [m.name for m in sunny] == [m.name for m in rainy] == ["asphalt", "car_glass", "glass", "marble", "paint"]
    assert [m.radio.itu for m in sunny] == ["itu_very_dry_ground", "itu_glass", "itu_glass", "itu_marble", "itu_metal"]
    assert rainy[0].radio.itu == "itu_wet_ground"
    assert sunny[1:] == rainy[1:]
    assert sunny[0].radio.thickness == 0.1
    assert sunny[0].lidar_reflectance == 0.17
    alone = read_stage(scenario, range(2), ["rainy"])
    assert alone.materials["rainy"] == rainy
    for name in ("points", "faces", "material", "object_id", "surface", "poses"):
        np.testing.assert_array_equal(getattr(alone, name), getattr(arrays, name))


def test_reading_leaves_the_files_alone(scenario: Path) -> None:
    before = {path: path.read_bytes() for path in scenario.parent.iterdir()}
    read_stage(scenario, range(2), ["rainy"])
    assert {path: path.read_bytes() for path in scenario.parent.iterdir()} == before


def test_any_range_of_frames(scenario: Path) -> None:
    everything = read_stage(scenario, range(5), ["sunny"])
    part = read_stage(scenario, range(2, 4), ["sunny"])
    np.testing.assert_array_equal(part.poses, everything.poses[2:4])
    assert part.models[0].points.tobytes() == everything.models[0].points.tobytes()


@pytest.fixture
def stage(tmp_path: Path) -> Usd.Stage:
    """Return a stage of a user, without any mmw attribute: a floor, and a box below a moving Xform."""
    stage = new_stage(tmp_path / "user.usda")
    concrete = add_material(stage, "/World/Looks/itu_concrete")
    steel = add_material(stage, "/World/Looks/lacquer", base="steel")
    add_polygons(stage, "/World/floor", [[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]], [[0, 1, 2, 3]], concrete)
    animate(stage, "/World/cart", np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0]]), np.array([0.0, 0.5, 1.0]))
    add_box(stage, "/World/cart/box", (2, 1, 1), (0, 0, 0.5), steel)
    return stage


def read(stage: Usd.Stage, **options) -> SceneData:
    """Return the first three frames of a stage."""
    return read_stage(saved(stage), range(3), ["sunny"], **options)


def test_stage_without_any_mmw_attribute(stage: Usd.Stage) -> None:
    arrays = read_stage(saved(stage), range(3), ["sunny", "of_my_own"])
    (cart,) = arrays.actors
    assert (cart.name, cart.role, cart.size, cart.center) == ("cart", "vehicle", (2.0, 1.0, 1.0), (0.0, 0.0, 0.5))
    np.testing.assert_array_equal(arrays.poses[:, 0, 0], [0, 1, 2])
    assert {m.name: m.radio.itu for m in arrays.materials["of_my_own"]} == {
        "itu_concrete": "itu_concrete", "lacquer": "itu_metal"
    }  # fmt: skip
    assert arrays.frames == range(3)


def test_town_without_actors(tmp_path: Path, capfd: pytest.CaptureFixture) -> None:
    arrays = read_stage(write_town(tmp_path / "town.usda"), range(3), ["rainy"])
    assert arrays.poses.shape == (3, 0, 7)
    assert arrays.actors == arrays.models == ()
    assert len(arrays.objects) == 2
    assert arrays.materials["rainy"][0].radio.itu == "itu_wet_ground"
    DeviceScene(arrays, "cpu", 1).load_batch([2])
    assert "Warning" not in capfd.readouterr().err


def test_roles_name_actors(stage: Usd.Stage) -> None:
    arrays = read(stage, roles={"/World/cart": "cav", "/World/floor": "rsu"})
    assert {actor.name: actor.role for actor in arrays.actors} == {"cart": "cav", "floor": "rsu"}
    assert len(arrays.faces) == 2, "a roadside unit's meshes stay static"
    with pytest.raises(ValueError, match="/World/nobody is not a prim"):
        read(stage, roles={"/World/nobody": "cav"})


def test_other_frame_rate_and_start(stage: Usd.Stage) -> None:
    stage.SetTimeCodesPerSecond(25)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(2)
    path = saved(stage)
    arrays = read_stage(path, range(9), ["sunny"])
    np.testing.assert_allclose(arrays.poses[:, 0, 0], np.arange(9) / 4, atol=1e-12)
    with pytest.raises(ValueError, match="frame 9 is outside the stage, which holds frames 0 to 8"):
        read_stage(path, range(10), ["sunny"])


def test_y_up_centimetre_stage_gives_the_same_world(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "user.usda", up="Y", metres_per_unit=0.01)
    concrete = add_material(stage, "/World/Looks/itu_concrete")
    corners = [[-900, 0, 900], [900, 0, 900], [900, 0, -900], [-900, 0, -900]]  # 9 m east, faces up (+y)
    add_polygons(stage, "/World/floor", corners, [[0, 1, 2, 3]], concrete)
    cart = UsdGeom.Xform.Define(stage, "/World/cart")
    move, turn = cart.AddTranslateOp(), cart.AddRotateYOp()
    for frame in range(3):
        move.Set(Gf.Vec3d(100.0 * frame, 0.0, -300.0), frame)
        turn.Set(30.0 * frame, frame)
    add_box(stage, "/World/cart/box", (200, 100, 60), (0, 50, 0), concrete)
    arrays = read(stage)
    np.testing.assert_allclose(arrays.points.min(axis=0), [-9, -9, 0], atol=1e-6)
    np.testing.assert_allclose(TriangleMesh(arrays.points, arrays.faces).crosses[:, 2], 324.0, rtol=1e-6)
    assert arrays.actors[0].size == pytest.approx((2.0, 0.6, 1.0))
    np.testing.assert_allclose(arrays.poses[:, 0, :3], [[0, 3, 0], [1, 3, 0], [2, 3, 0]], atol=1e-9)
    yaw = np.radians([0.0, 30.0, 60.0])
    forward = quaternion_to_matrix(arrays.poses[:, 0, 3:])[:, :, 0]
    np.testing.assert_allclose(forward, np.stack([np.cos(yaw), np.sin(yaw), 0 * yaw], axis=1), atol=1e-9)


def test_constant_scale_of_an_actor_goes_into_its_model(stage: Usd.Stage) -> None:
    UsdGeom.Xformable(stage.GetPrimAtPath("/World/cart")).AddScaleOp().Set(Gf.Vec3f(1.0, -2.0, 3.0))
    arrays = read(stage)
    assert arrays.actors[0].size == pytest.approx((2.0, 2.0, 3.0))
    assert volume(arrays.models[0]) == pytest.approx(12.0), "faces of a mirrored box look outward"
    np.testing.assert_allclose(np.linalg.norm(arrays.poses[..., 3:], axis=-1), 1.0, atol=1e-12)


def test_invisible_actor_is_absent(stage: Usd.Stage) -> None:
    visibility = UsdGeom.Imageable(stage.GetPrimAtPath("/World/cart")).CreateVisibilityAttr("invisible")
    assert np.isnan(read(stage).poses).all()
    for frame, token in enumerate(("inherited", "invisible", "inherited")):
        visibility.Set(token, frame)
    arrays = read(stage)
    np.testing.assert_array_equal(np.isfinite(arrays.poses).all(axis=2)[:, 0], [True, False, True])
    assert arrays.actors[0].model == 0


def test_frames_fall_exactly_on_their_time_codes(tmp_path: Path) -> None:
    """Positions to the bit, and an actor that appears in a frame is there in that frame, not one later."""
    stage = new_stage(tmp_path / "user.usda")
    way = np.random.default_rng(0).uniform(-300.0, 300.0, (60, 3))
    actor = animate(stage, "/World/cart", way)
    add_box(stage, "/World/cart/body", (4, 2, 1.5), material=add_material(stage, "/World/paint", "itu_metal"))
    visibility = UsdGeom.Imageable(actor.GetPrim()).CreateVisibilityAttr()
    for frame in range(60):
        visibility.Set("invisible" if frame in (28, 56) else "inherited", frame)
    arrays = read_stage(saved(stage), range(60), [])
    present = np.isfinite(arrays.poses).all(axis=2)[:, 0]
    assert np.flatnonzero(~present).tolist() == [28, 56]
    np.testing.assert_array_equal(arrays.poses[present, 0, :3], way[present])


def test_radio_binding_comes_before_the_visual_one(stage: Usd.Stage) -> None:
    bind(stage.GetPrimAtPath("/World/floor"), add_material(stage, "/World/Looks/wet", "itu_wet_ground"), "radio")
    arrays = read(stage)
    assert {arrays.materials["sunny"][k].radio.itu for k in arrays.material} == {"itu_wet_ground"}


def test_material_map_describes_what_has_none(stage: Usd.Stage) -> None:
    add_box(stage, "/World/crates/one", (1, 1, 1))
    bare = add_material(stage, "/World/Looks/unknown")
    add_box(stage, "/World/crates/two", (1, 1, 1), material=bare)
    with pytest.raises(ValueError) as error:
        read(stage)
    for text in ("2 prims", "/World/crates/one (no material)", "/World/crates/two (material /World/Looks/unknown)",
                 "give `materials`"):  # fmt: skip
        assert text in str(error.value)
    arrays = read(stage, material_map={"/World/crates/*": "itu_wood"})
    crates = {name for o in arrays.objects if "crates" in o.prim_path for name in o.materials}
    assert crates == {"itu_wood", "unknown"}
    assert {m.radio.itu for m in arrays.materials["sunny"] if m.name in crates} == {"itu_wood"}


def test_bound_material_falls_back_to_the_class(stage: Usd.Stage) -> None:
    box = add_box(stage, "/World/house", (1, 1, 1), material=add_material(stage, "/World/Looks/plain"))
    label(box.GetPrim(), "building")
    arrays = read(stage)
    assert {m.name: m.radio.itu for m in arrays.materials["sunny"]}["plain"] == "itu_concrete"


def move(attribute: UsdGeom.XformOp | Usd.Attribute, first: object, last: object) -> None:
    """Give an attribute one value in the first frame, and another one in the last."""
    attribute.Set(first, 0)
    attribute.Set(last, 2)


def take_the_name_of_the_cart(stage: Usd.Stage) -> None:
    animate(stage, "/World/more/cart", np.array([[0, 0, 5], [1, 0, 5]]))
    add_box(stage, "/World/more/cart/box", (1, 1, 1), material=add_material(stage, "/World/Looks/itu_wood"))


@pytest.mark.parametrize(
    ("path", "spoil", "message"),
    [
        ("/World/floor", lambda prim: move(prim.GetAttribute("points"), [(0, 0, 0)] * 4, [(1, 0, 0)] * 4),
         "/World/floor: its points change over time"),
        ("/World/cart/box", lambda prim: move(UsdGeom.Xformable(prim).AddRotateZOp(), 0.0, 90.0),
         "/World/cart/box: moves inside the actor /World/cart"),
        ("/World/cart", lambda prim: move(UsdGeom.Xformable(prim).AddScaleOp(), Gf.Vec3f(1.0), Gf.Vec3f(2.0)),
         "/World/cart: its scale changes"),
        ("/World/cart", lambda prim: prim.CreateAttribute("mmw:actor:role", Sdf.ValueTypeNames.Token).Set("pilot"),
         "mmw:actor:role = 'pilot'"),
        ("/World", lambda prim: take_the_name_of_the_cart(prim.GetStage()), "are both called 'cart'"),
        ("/World/floor", lambda prim: prim.GetAttribute("faceVertexIndices").Set([0, 1, 2, 4]),
         "/World/floor: 1 faces need 4 corners"),
        ("/World", lambda prim: UsdGeom.Imageable(prim).MakeInvisible(), "no visible mesh"),
        ("/World", lambda prim: prim.GetReferences().AddReference("./lost.usda"), "payloads do not resolve"),
    ],
)  # fmt: skip
def test_stage_that_cannot_be_traced(stage: Usd.Stage, path: str, spoil, message: str) -> None:
    spoil(stage.GetPrimAtPath(path))
    with pytest.raises(ValueError, match=message):
        read(stage)


def test_unknown_weather_and_frames(scenario: Path) -> None:
    with pytest.raises(ValueError, match=r"weather 'foggy' is not a variant of /World/Town; it has .*sunny"):
        read_stage(scenario, range(5), ["sunny", "foggy"])
    with pytest.raises(ValueError, match="frame 5 is outside the stage, which holds frames 0 to 4"):
        read_stage(scenario, range(6), ["sunny"])
    with pytest.raises(ValueError, match="no frames are given"):
        read_stage(scenario, range(0), ["sunny"])


def test_batches_are_checked() -> None:
    scene = DeviceScene(two_cars(4), "cpu", 2)
    with pytest.raises(ValueError, match="batch of 3 frames"):
        scene.load_batch([0, 1, 2])
    with pytest.raises(ValueError, match="frame 4 is not in the scene, which covers 0 to 3"):
        scene.load_batch([4])
    with pytest.raises(ValueError, match="at least one frame"):
        DeviceScene(two_cars(1), "cpu", 0)


def test_instances_skip_actors_without_a_model() -> None:
    actors = [("rsu_1", "rsu", -1), ("cav_1", "cav", 0), ("rsu_2", "rsu", -1), ("veh_1", "vehicle", 0)]
    poses = np.zeros((1, 4, 7))
    poses[..., 6] = 1.0
    scene = DeviceScene(arrays_from_parts([ground_part()], [box_model("car")], actors, poses), "cpu", 1)
    np.testing.assert_array_equal(scene.instance_actor, [1, 3])
    assert scene.arrays.actors[3].object_id == scene.struct.instance_object.numpy()[1]


def test_boxes_hold_the_posed_models(device: str) -> None:
    rng = np.random.default_rng(3)
    poses = np.concatenate([rng.uniform(-50, 50, (2, 5, 3)), rng.normal(size=(2, 5, 4))], axis=2)
    poses[..., 3:] /= np.linalg.norm(poses[..., 3:], axis=2, keepdims=True)
    poses[1, 2] = ABSENT
    models = [box_model("a"), box_model("b", (9.0, 2.5, 3.0), (1.0, 0.0, 1.5))]
    actors = [(f"v{k}", "vehicle", k % 2) for k in range(5)]
    scene = DeviceScene(arrays_from_parts([], models, actors, poses), device, 3)
    scene.load_batch([0, 1])
    lower, upper = scene._lower.numpy().reshape(3, 5, 3), scene._upper.numpy().reshape(3, 5, 3)
    group = scene._group.numpy().reshape(3, 5)
    np.testing.assert_array_equal(group, [[0] * 5, [1, 1, 3, 1, 1], [3] * 5])
    for index in range(2):
        for v in range(5):
            if group[index, v] < 3:
                turn = quaternion_to_matrix(poses[index, v, 3:])
                corners = models[v % 2].points @ turn.T + poses[index, v, :3]
                np.testing.assert_allclose(lower[index, v], corners.min(axis=0) - 1e-3, atol=2e-5)
                np.testing.assert_allclose(upper[index, v], corners.max(axis=0) + 1e-3, atol=2e-5)


def test_length_of_a_quaternion_does_not_scale_a_vehicle(device: str) -> None:
    arrays = two_cars(1)
    long = arrays.poses.copy()
    long[..., 3:] *= 3.0
    reach = []
    for poses in (arrays.poses, long):
        scene = loaded(replace(arrays, poses=poses), device, [0])
        reach.append(scene.struct.instance_pose.numpy())
    np.testing.assert_array_equal(reach[0], reach[1])


def test_frames_are_consecutive() -> None:
    arrays = two_cars(3)
    with pytest.raises(ValueError, match="frames in steps of 2; poses are those of all frames"):
        replace(arrays, frames=range(0, 6, 2))


def test_further_agents_share_the_batch(device: str) -> None:
    arrays = two_cars(2)
    scene = loaded(arrays, device, [1])
    agent = replace(arrays.actors[2], name="rsu_2")
    poses = np.concatenate([arrays.poses, arrays.poses[:, 2:]], axis=1)
    others = replace(arrays, actors=(*arrays.actors, agent), poses=poses)
    shared = scene.with_agents(others)
    assert shared.arrays is others and scene.arrays is arrays
    assert shared.struct is scene.struct and shared.batch_frames == scene.batch_frames == (1,)
    np.testing.assert_array_equal(shared.instance_actor, [0, 1])
    with pytest.raises(ValueError, match="with_agents: another mesh"):
        scene.with_agents(two_cars(2))
    with pytest.raises(ValueError, match=r"with_agents: .* another actor with geometry"):
        scene.with_agents(replace(arrays, actors=arrays.actors[1:], poses=arrays.poses[:, 1:]))


def test_scene_at_other_frames_shares_the_rest() -> None:
    arrays = two_cars(4)
    other = arrays.at(range(7, 9), arrays.poses[1:3])
    assert other.frames == range(7, 9) and other.points is arrays.points and type(other) is SceneData
    assert (
        other.frame_row(8) == 1
        and other.frame_rows([8]).tolist() == [1]
        and other.frame_rows([8, 7]).tolist() == [1, 0]
    )
    assert arrays.frames == range(4) and len(arrays.poses) == 4
    with pytest.raises(ValueError, match=r"poses have shape \(3, .*; 2 frames of these actors"):
        arrays.at(range(2), arrays.poses[:3])
    with pytest.raises(ValueError, match="frame 9 is not in the scene, which covers 7 to 8"):
        other.frame_rows([9])
