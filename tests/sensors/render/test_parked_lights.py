"""Lights of parked vehicles are dark; those of vehicles that stand in traffic are not. Which is which a stage says."""

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom

from mmw.core.transforms import pose_from_ypr
from mmw.physics.weather.weather import PRESETS, Weather
from mmw.scene.device_scene import DeviceScene
from mmw.scene.reader import read_stage
from mmw.scene.scene_data import SceneData
from mmw.sensors import RgbCamera
from mmw.sensors.render.lights import brake_levels, make_lights
from mmw.usd.actors import PARKED, find_actors
from mmw.usd.prim_specs import new_prim
from mmw.usd.vehicle_catalog import load_catalog
from mmw.worlds.towns.parked_prims import ParkedCar, write_parked
from mmw.worlds.vehicles.actor_prims import describe_actor
from tests.fixtures.rgb_scenes import at, render
from tests.fixtures.stages import add_box, add_material, add_polygons, animate, new_stage

FRAMES = 12
WEATHERS = {"day": Weather(), "fog": PRESETS["foggy"], "night": Weather(sun_altitude_deg=-15.0)}
CAMERA = RgbCamera(width_px=96, height_px=72, fov_deg=40.0)
WHERE = {"parked": 0.0, "waits": 10.0, "brakes": 20.0, "rolls": 30.0}
"""Actor -> y of its way along x [m]."""


def role(stage: Usd.Stage, path: str, name: str) -> None:
    stage.GetPrimAtPath(path).CreateAttribute("mmw:actor:role", Sdf.ValueTypeNames.Token).Set(name)


def boxes(stage: Usd.Stage, path: str, positions: np.ndarray | None = None) -> None:
    """Write a box below an Xform that moves along positions, or stands if there are none."""
    if positions is None:
        UsdGeom.Xform.Define(stage, path).AddTranslateOp().Set(Gf.Vec3d(3.0, 4.0, 0.0))
    else:
        animate(stage, path, positions)
    add_box(stage, f"{path}/body", (4.5, 1.8, 1.5), (0.0, 0.0, 0.75))


def test_who_is_parked_follows_from_where_a_prim_lies(tmp_path: Path) -> None:
    """Vehicles anywhere below a prim called Parked, in a town or in the user's own stage, as long as they stand."""
    stage = new_stage(tmp_path / "stage.usda")
    drive = np.array([[k, 0.0, 0.0] for k in range(FRAMES)])
    boxes(stage, "/World/Town/Parked/p_001")
    boxes(stage, "/World/Parked/row_1/p_002")
    boxes(stage, "/World/Parked/leaves", drive)
    boxes(stage, "/World/Parked/p_003", drive[:1])  # one time sample: it stands
    boxes(stage, "/World/Parked/guard")
    boxes(stage, "/World/Parked/ego")
    boxes(stage, "/World/Parked/mast")
    boxes(stage, "/World/Actors/waits")
    boxes(stage, "/World/Actors/Parked")
    boxes(stage, "/World/ParkedCars/other")
    for path in ("Town/Parked/p_001", "Parked/row_1/p_002", "Actors/waits", "Actors/Parked", "ParkedCars/other"):
        role(stage, f"/World/{path}", "vehicle")
    role(stage, "/World/Parked/p_003", "vehicle")
    role(stage, "/World/Parked/guard", "pedestrian")
    role(stage, "/World/Parked/ego", "cav")
    found = {actor.name: actor.is_parked for actor in find_actors(stage, {"/World/Parked/mast": "rsu"})}
    assert found == {
        "p_001": True, "p_002": True, "p_003": True, "ego": True, "leaves": False, "guard": False, "mast": False,
        "waits": False, "Parked": False, "other": False,
    }  # fmt: skip


@pytest.fixture(scope="module")
def road(tmp_path_factory: pytest.TempPathFactory) -> SceneData:
    """Return level ground with the shipped sedan four times: parked as in a town, and in traffic that waits, brakes at
    3 m/s2 and rolls at 8 m/s."""
    path = tmp_path_factory.mktemp("road") / "stage.usda"
    stage, time = new_stage(path), np.arange(FRAMES) / 100.0
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(FRAMES - 1)
    asphalt = add_material(stage, "/World/Looks/asphalt", "itu_concrete", "asphalt")
    corners = [[-60, -60, 0], [60, -60, 0], [60, 60, 0], [-60, 60, 0]]
    add_polygons(stage, "/World/ground", corners, [[0, 1, 2, 3]], asphalt)
    catalog, layer = load_catalog(), stage.GetRootLayer()
    sedan = catalog["sedan"]
    ways = {"waits": 0.0 * time, "brakes": 8.0 * time - 1.5 * time**2, "rolls": 8.0 * time}
    for name, x in ways.items():
        animate(stage, f"/World/Actors/{name}", np.stack([x, np.full(FRAMES, WHERE[name]), 0.0 * x], axis=1))
        describe_actor(layer.GetPrimAtPath(f"/World/Actors/{name}"), "vehicle", sedan, sedan.asset.as_posix(), "white")
    new_prim(layer, Sdf.Path("/World/Town"), "Xform")
    cars = [ParkedCar("parked", "sedan", "white", pose_from_ypr((0.0, WHERE["parked"], 0.0), 0.0))]
    write_parked(layer, Sdf.Path(f"/World/Town/{PARKED}"), cars, catalog, path.parent)
    stage.Save()
    return read_stage(path, range(FRAMES), dict.fromkeys(WEATHERS, ("",)))


def test_no_light_of_a_parked_vehicle_burns(road: SceneData, device: str) -> None:
    """By its numbers: no brake light in any frame, no beam in any weather, unlike the car beside it that waits."""
    names = [actor.name for actor in road.actors]
    assert {actor.name for actor in road.actors if actor.is_parked} == {"parked"}
    levels = brake_levels(road, range(FRAMES))
    expected = {"parked": -1.0, "waits": 1.0, "brakes": 1.0, "rolls": 0.0}
    for name, level in expected.items():
        assert levels[:, names.index(name)] == pytest.approx(level, abs=1e-3)
    scene = DeviceScene(road, device, 1)
    scene.load_batch([5])
    for name, weather in WEATHERS.items():
        lights = make_lights(scene, name, weather)
        lit = [names[scene.instance_actor[k]] for k in lights.beam_instance.numpy()[: lights.beam_count]]
        assert lit == ([] if name == "day" else [name for name in names if name != "parked"])


def test_a_parked_car_is_dark_in_a_picture(road: SceneData, device: str) -> None:
    """From behind and in front, by day, in fog and at night: lenses that nothing lights from within look like those of
    the car that rolls by day, and are black at night."""
    x, y = road.poses[5, :, 0], road.poses[5, :, 1]  # the same places about each car, so that lights alone differ
    behind = [(x[k] - 7.0, y[k], 1.0) for k in range(len(x))]
    before = [(x[k] + 9.0, y[k], 0.6, 180.0, 0.0, 0.0) for k in range(len(x))]
    rendering = render(road, device, at(*behind, *before, frame=5), config=CAMERA, weathers=WEATHERS)
    own = rendering.objects() == np.array([actor.object_id for actor in road.actors] * 2)[:, None, None]
    assert own.sum(axis=(1, 2)).min() > 500
    peak = {}
    for name, images in rendering.light().items():
        values = np.where(own[..., None], images, 0.0).reshape(2, len(x), -1, 3)
        for actor, rear, front in zip(road.actors, *values, strict=True):
            peak[actor.name, name] = float((rear[:, 0] - rear[:, 1]).max()), float(front[:, 1].max())
    for name in WEATHERS:
        rear = {actor: peak[actor, name][0] for actor in WHERE}
        assert rear["waits"] == pytest.approx(rear["brakes"], rel=0.02)
        assert rear["brakes"] > 2.5 * max(rear["rolls"], rear["parked"])
    assert peak["parked", "day"] == pytest.approx(peak["rolls", "day"], rel=0.02)
    for name, rear_share, front_share in (("fog", 0.6, 0.2), ("night", 1e-3, 1e-2)):
        assert peak["parked", name][0] < rear_share * peak["rolls", name][0]
        assert peak["parked", name][1] < front_share * peak["rolls", name][1]
