"""Crowns of trees: the radio channel meets their hulls, light and radar their leaves."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import mmw
from mmw.config.foliage import FoliageModel
from mmw.core.choices import check_choice
from mmw.core.errors import InputError
from mmw.physics.materials.material import Material, RadioMaterial
from mmw.physics.weather.weather import PRESETS
from mmw.scene.device_scene import DeviceScene
from mmw.scene.foliage import foliage_faces, optical_arrays
from mmw.scene.scene import Scene
from mmw.scene.scene_data import SceneData
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.trees import sphere
from tests.fixtures.device_rays import cast, loaded
from tests.fixtures.scene_captures import assert_same
from tests.fixtures.scenes import arrays_from_parts, box_model, ground_part, pose, wall_part

LEAF = Material("leaf", RadioMaterial("itu", itu="itu_wood", medium="foliage"), "leaf_grass", 0.5, (0.05, 0.11, 0.025))
CENTER = np.array([10.0, 0.0, 4.0])


def ball(name: str, center: Sequence[float], radius: float = 2.0) -> MeshPart:
    mesh = sphere(4)
    return MeshPart(f"Props/{name}/crown", mesh.points * radius + np.array(center), mesh.faces, "leaf", "vegetation")


def world(*parts: MeshPart, foliage: str = "leaves", frames: int = 1) -> SceneData:
    """Return a crown before a wall, over ground, with a car beside."""
    town = [ground_part(), wall_part("wall", (20.0, -40.0), (20.0, 40.0), 30.0), ball("tree", CENTER), *parts]
    models, actors = (box_model("sedan"),), (("veh_001", "vehicle", 0),)
    poses = [[pose(10.0 + k, -8.0)] for k in range(frames)]
    weathers = ("sunny", "rainy")
    scene = arrays_from_parts(town, models, actors, poses, materials={"leaf": LEAF}, weathers=weathers)
    return replace(scene, foliage=check_choice("foliage", foliage, FoliageModel))


def grid(count: int = 40) -> np.ndarray:
    """Return the origins of parallel rays along x over the middle of the crown."""
    y, z = np.meshgrid(np.linspace(-1.2, 1.2, count), np.linspace(-1.2, 1.2, count))
    return np.stack([np.zeros(y.size), y.ravel(), 4.0 + z.ravel()], axis=1)


def object_named(arrays: SceneData, name: str) -> int:
    return next(one.object_id for one in arrays.objects if one.prim_path.endswith(name))


def test_hull_is_what_it_was() -> None:
    arrays = world(foliage="hull")
    assert optical_arrays(arrays) is arrays
    scene = DeviceScene(arrays, "cpu", 1)
    assert scene.optical is scene


def test_leaves_take_the_place_of_the_hull_alone() -> None:
    arrays = world()
    leafy = optical_arrays(arrays)
    is_hull, is_leaf = foliage_faces(arrays), foliage_faces(leafy)
    kept = int((~is_hull).sum())
    assert not is_leaf[:kept].any() and is_leaf[kept:].all()
    for name in ("faces", "material", "object_id", "surface", "uv", "normals"):
        np.testing.assert_array_equal(getattr(leafy, name)[:kept], getattr(arrays, name)[~is_hull])
    assert set(leafy.object_id[kept:]) == {object_named(arrays, "tree")}
    assert set(leafy.surface[kept:]) <= set(arrays.surface[is_hull])
    assert leafy.models is arrays.models and leafy.objects is arrays.objects
    away = np.linalg.norm(leafy.points[leafy.faces[kept:]] - CENTER, axis=2)
    assert away.max() < 2.0 + 1e-9


def test_leaves_of_a_tree_do_not_depend_on_other_objects() -> None:
    alone, among = world(), world(ball("another", (10.0, 9.0, 4.0)), ball("a_third", (30.0, 9.0, 4.0)))

    def corners(arrays: SceneData) -> np.ndarray:
        leafy = optical_arrays(arrays)
        own = foliage_faces(leafy) & (leafy.object_id == object_named(arrays, "/tree"))
        return leafy.points[leafy.faces[own]]

    np.testing.assert_allclose(corners(among), corners(alone), rtol=0, atol=1e-12)


def test_equal_trees_have_leaves_of_their_own() -> None:
    arrays = optical_arrays(world(ball("another", CENTER + np.array([0, 9.0, 0]))))
    one, other = (
        arrays.points[arrays.faces[foliage_faces(arrays) & (arrays.object_id == object_named(arrays, name))]]
        for name in ("/tree", "/another")
    )
    assert len(one) == len(other)
    assert np.abs(other - one - [0, 9.0, 0]).max() > 0.5


LEAF_CORNERS = np.array([(5.0, 5, 3), (6, 5, 3), (5, 6, 3)])
LEAF_SIDES = np.array([(0, 1, 2), (2, 1, 0)], dtype=np.int32)


@pytest.mark.parametrize("sides", [1, 2])
def test_leaves_of_the_stage_stay(sides: int) -> None:
    """One side closes nothing; two back to back close a body without volume."""
    own = MeshPart("Props/own/leaf", LEAF_CORNERS, LEAF_SIDES[:sides], "leaf", "vegetation")
    arrays = world(own)
    leafy, number = optical_arrays(arrays), object_named(arrays, "own")
    assert (leafy.object_id == number).sum() == sides
    only = optical_arrays(replace(arrays_from_parts([own], materials={"leaf": LEAF}), foliage="leaves"))
    assert len(only.faces) == sides


def test_hull_that_is_inside_out_has_leaves_too() -> None:
    turned = replace(
        arrays := world(), faces=np.where(foliage_faces(arrays)[:, None], arrays.faces[:, ::-1], arrays.faces)
    )
    np.testing.assert_allclose(optical_arrays(turned).points, optical_arrays(arrays).points, atol=1e-12)


def test_rays_pass_between_the_leaves(device: str) -> None:
    arrays = world()
    scene, origins = loaded(arrays, device), grid()
    direction = np.tile([1.0, 0.0, 0.0], (len(origins), 1))
    hull, leaves = cast(scene, 0, origins, direction), cast(scene.optical, 0, origins, direction)
    tree, wall = object_named(arrays, "tree"), object_named(arrays, "wall")
    assert (hull.object_id == tree).all()
    share = (leaves.object_id == wall).mean()
    assert set(leaves.object_id) == {tree, wall}
    assert 0.01 < share < 0.5
    assert (leaves.t[leaves.object_id == tree] >= hull.t[leaves.object_id == tree] - 1e-5).all()
    np.testing.assert_array_equal(leaves.occluded, leaves.t < 1e4)


def test_optical_scene_follows_the_batch(device: str) -> None:
    arrays = world(frames=3)
    scene = loaded(arrays, device, [0])
    optical = scene.optical
    for frame in (2, 1):
        scene.load_batch([frame])
        for one in (scene, scene.optical):
            hit = cast(one, 0, (10.0 + frame, -20.0, 0.7), [(0.0, 1.0, 0.0)])
            assert hit.instance[0] == 0
            assert one.batch_frames == (frame,)
    assert scene.optical is optical
    agents = scene.with_agents(replace(arrays, materials=dict(arrays.materials)))
    assert agents.optical is not agents
    assert agents.optical.arrays.faces is optical.arrays.faces
    moved = replace(arrays, poses=arrays.poses + np.array([0, 0, 0.3, 0, 0, 0, 0]))
    scene.replace_arrays(moved)
    scene.load_batch([1])
    hit = cast(scene.optical, 0, (11.0, -8.0, 20.0), [(0.0, 0.0, -1.0)])
    assert hit.t[0] == pytest.approx(20.0 - 1.5 - 0.3, abs=1e-4)
    np.testing.assert_array_equal(scene.optical.arrays.poses, moved.poses)


def test_another_medium_needs_a_new_device_scene() -> None:
    arrays = world()
    solid = replace(LEAF, radio=replace(LEAF.radio, medium="solid"))
    changed = {name: tuple(solid if one is LEAF else one for one in own) for name, own in arrays.materials.items()}
    with pytest.raises(ValueError, match="another mesh"):
        DeviceScene(arrays, "cpu", 1).replace_arrays(replace(arrays, materials=changed))


def make_scene(foliage: str, device: str) -> Scene:
    weathers = {name: PRESETS[name] for name in ("sunny", "rainy")}
    return Scene(world(foliage=foliage), weathers, device=device, name="crown")


LIDAR = mmw.sensors.Lidar(channels=32, points_per_channel=360, upper_fov_deg=25.0, lower_fov_deg=-5.0)
VIEW = (0.0, 0.0, 4.0, 0.0, 0.0, 0.0, 1.0)


def test_sensors_see_through_the_leaves(device: str) -> None:
    hull, leaves = (make_scene(foliage, device) for foliage in ("hull", "leaves"))
    tree, wall = (object_named(hull.arrays, name) for name in ("tree", "wall"))
    camera = mmw.sensors.DepthCamera(width_px=64, height_px=64, fov_deg=20.0)

    def behind(scene: Scene) -> list[float]:
        """Return the share of what lies in the cone of the crown that shows the wall: LiDAR, depth, free rays."""
        cloud = scene.capture(LIDAR, pose=VIEW)
        aside = np.linalg.norm(cloud.xyz[:, 1:], axis=1) / np.maximum(cloud.xyz[:, 0], 1e-6)
        near = (cloud.xyz[:, 0] > 0.0) & (aside < 0.12)
        image = scene.capture(camera.model_copy(update={"segmentation": True}), pose=VIEW)
        middle = image.object_id[20:44, 20:44]
        ray = scene.cast_rays(grid(), np.tile([1.0, 0.0, 0.0], (len(grid()), 1)))
        assert {tree} <= set(middle.ravel().tolist()) <= {tree, wall}
        return [float((ids == wall).mean()) for ids in (cloud.object_id[near], middle, ray.object_id)]

    assert behind(hull) == [0.0, 0.0, 0.0]
    assert all(0.01 < share < 0.5 for share in behind(leaves))


def test_rain_dims_leaves_as_it_does_hulls(device: str) -> None:
    def dimming(foliage: str) -> float:
        scene = make_scene(foliage, device)
        tree = object_named(scene.arrays, "tree")
        clouds = scene.capture(LIDAR, pose=VIEW, weather=["sunny", "rainy"])
        dry, wet = (cloud.intensity[cloud.object_id == tree].mean() for cloud in clouds.values())
        return float(wet / dry)

    assert dimming("leaves") < 0.99
    # Cards at other distances and angles: those that are seen at a small angle are lost first.
    assert dimming("leaves") == pytest.approx(dimming("hull"), abs=0.05)


def test_paths_are_those_of_the_hull_bit_by_bit(device: str) -> None:
    found = []
    for foliage in ("hull", "leaves"):
        scene = make_scene(foliage, device)
        scene.add(mmw.Transmitter("bs", position=(0.0, 0.5, 4.2)))
        scene.add(mmw.Receiver("ue", position=(18.0, 0.2, 3.8)))
        scene.add(mmw.Receiver("side", position=(5.0, 6.0, 1.5)))
        scene.capture(LIDAR, pose=VIEW)  # leaves are there by now
        solid = mmw.PathSolver(max_depth=2, samples_per_tx=10_000)(scene)
        passed = mmw.PathSolver(max_depth=2, samples_per_tx=10_000, foliage=True)(scene)
        found.append((solid.tau, solid.a, solid.vertices, passed.tau, passed.a, passed.vertices))
        assert len(solid.tau) < len(passed.tau)
    assert_same(*found)


def test_a_material_that_becomes_solid_has_its_hull_again(device: str) -> None:
    scene = make_scene("leaves", device)
    tree = object_named(scene.arrays, "tree")
    rays = grid(), np.tile([1.0, 0.0, 0.0], (len(grid()), 1))
    camera = mmw.sensors.RgbCamera(width_px=24, height_px=16, fov_deg=20.0)
    before = scene.capture(camera, pose=VIEW).rgb
    assert (scene.cast_rays(*rays).object_id != tree).any()
    scene.materials["leaf"].radio = replace(LEAF.radio, medium="solid")
    assert (scene.cast_rays(*rays).object_id == tree).all()
    assert (scene.capture(camera, pose=VIEW).rgb != before).any()


def test_load_scene_chooses() -> None:
    assert mmw.load_scene("town10", device="cpu").arrays.foliage == "hull"
    scene = mmw.load_scene("town10", foliage="leaves", device="cpu")
    assert scene.arrays.foliage == "leaves"
    leafy = optical_arrays(scene.arrays)
    count = len({*scene.arrays.object_id[foliage_faces(scene.arrays)]})
    assert count == 245
    assert 200 < (len(leafy.faces) - (~foliage_faces(scene.arrays)).sum()) / (2 * count) < 450
    unknown: Any = "cards"
    with pytest.raises(InputError, match=r"load_scene: foliage = 'cards'; one of hull, leaves is needed"):
        mmw.load_scene("town10", foliage=unknown, device="cpu")


@pytest.mark.slow  # traffic is simulated twice
def test_configuration_chooses() -> None:
    config = mmw.load_config("quickstart", ["foliage=leaves"])
    assert mmw.load_scene(config, device="cpu").arrays.foliage == "leaves"
    assert mmw.load_scene(config, foliage="hull", device="cpu").arrays.foliage == "hull"
    assert config.sha256() != mmw.load_config("quickstart").sha256()
    assert "foliage" not in mmw.load_config("quickstart").identity()
    with pytest.raises(InputError, match="foliage"):
        mmw.load_config("quickstart", ["foliage=cards"])
