"""Sensors that are inside something are refused, those in the open are not, whatever the winding of the faces."""

from dataclasses import replace

import numpy as np
import pytest

from mmw.config import Config, MountConfig
from mmw.physics.materials.material import Material, RadioMaterial
from mmw.scene.device_scene import DeviceScene
from mmw.scene.enclosing_objects import enclosing_objects
from mmw.scene.scene_data import SceneData
from mmw.sensors import DepthCamera, Lidar
from mmw.sensors.mount_checks import check_mounts
from tests.fixtures.device_rays import loaded
from tests.fixtures.scenes import arrays_from_parts, box_model, box_part, ground_part, pose, quad_part

HOUSE = box_part("Buildings/house", (20.0, 10.0, 8.0), (30.0, 0.0, 4.0), "concrete_facade", "building")
CANOPY = quad_part("Props/canopy", [(-40, -6, 5), (-20, -6, 5), (-20, 6, 5), (-40, 6, 5)], "metal_pole", "static")


def world(actors=(), poses=None, models=(), flip: bool = False) -> SceneData:
    parts = [ground_part(), HOUSE, CANOPY]
    if flip:
        parts = [replace(part, faces=part.faces[:, ::-1]) for part in parts]
    return arrays_from_parts(parts, models, actors, poses)


def scene_of(arrays: SceneData, device: str) -> DeviceScene:
    return loaded(arrays, device, [arrays.frames[0]])


def configured(sensors: list, **channel) -> Config:
    traffic = {"vehicle_count": 1, "spawn_center_m": [0, 0, 0], "cav_ranks": [0]}
    return Config(
        scenarios=[{"name": "s", "town": "town03", "traffic": traffic}],
        sensors=[sensor.model_dump() for sensor in sensors],
        channel={"enabled": False, **channel},
    )


@pytest.mark.parametrize("flip", [False, True])
def test_places_in_the_open_inside_and_below(device: str, flip: bool) -> None:
    scene = scene_of(world(flip=flip), device)
    names = {o.prim_path.rsplit("/", 1)[1]: o.object_id for o in scene.arrays.objects}
    places = np.array(
        [(0, 0, 4), (30, 0, 4), (30, 0, 9), (0, 0, -2), (-30, 0, 3), (19.9, 0, 1), (39.9, 4.9, 7.9)], dtype=float
    )
    expected = [-1, names["house"], -1, names["ground"], -1, -1, names["house"]]
    assert enclosing_objects(scene, places).tolist() == expected


def test_a_sensor_in_its_own_body_or_a_house_is_refused(device: str) -> None:
    models, actors = (
        (box_model("truck", (8.0, 2.5, 3.4), (0.0, 0.0, 1.7)),),
        [("cav_1", "cav", 0), ("rsu_1", "rsu", -1)],
    )
    arrays = world(actors, np.array([[pose(0.0, -20.0), pose(30.0, 0.0)]]), models)
    scene = scene_of(arrays, device)
    high = {"cav": MountConfig(position_m=(0, 0, 4.0)), "rsu": MountConfig(position_m=(0, 0, 9.0))}
    check_mounts(scene, configured([Lidar(mount=high), DepthCamera(mount=high)]))
    with pytest.raises(ValueError) as caught:
        check_mounts(scene, configured([Lidar(), DepthCamera(mount=high)]))
    first, second = str(caught.value).split("\n")
    assert "cav_1: lidar at (0.0, 0.0, 2.5) m is inside its own body in frame 0" in first
    assert "the agent, a car, is at (0.0, -20.0, 0.0) m in the world" in first
    assert "raise or move its mount, as in mount: {cav_1: {position_m: [0, 0, 1], relative_to: roof}}" in first
    assert "rsu_1: lidar" in second and "Buildings/house (building)" in second and "the unit or its mount" in second
    with pytest.raises(ValueError, match="antenna at"):
        check_mounts(scene, configured([], enabled=True))


def test_an_antenna_may_be_inside_foliage_that_waves_pass_and_no_other_sensor(device: str) -> None:
    crown = box_part("Props/tree", (4.0, 4.0, 4.0), (0.0, 0.0, 6.0), "leaf", "vegetation")
    leaf = Material("leaf", RadioMaterial("itu", itu="itu_wood", medium="foliage"), "leaf_grass", 0.5, (0.1, 0.2, 0.1))
    arrays = arrays_from_parts(
        [ground_part(), crown], (), [("rsu_1", "rsu", -1)], np.array([[pose(0.0, 0.0)]]), materials={"leaf": leaf}
    )
    scene, inside = scene_of(arrays, device), {"rsu": MountConfig(position_m=(0, 0, 6.0))}
    antenna = [{"name": "roof", "on": ["rsu"], "mount": inside}]
    check_mounts(scene, configured([], enabled=True, antennas=antenna, foliage=True))
    with pytest.raises(ValueError, match=r"rsu_1: roof at .* is inside .*tree"):
        check_mounts(scene, configured([], enabled=True, antennas=antenna))
    lidar = Lidar(on=["rsu"], mount=inside)
    with pytest.raises(ValueError, match=r"rsu_1: lidar at .* is inside .*tree"):
        check_mounts(scene, configured([lidar], enabled=True, antennas=antenna, foliage=True))
