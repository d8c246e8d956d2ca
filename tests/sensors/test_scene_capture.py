"""Samples of one frame as arrays: at free poses, many at once, on the device, of other packages, and bad input."""

from dataclasses import fields, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import warp as wp

from mmw.config import MountConfig, SensorConfig
from mmw.config.sensor_spec import SENSORS, register_sensor
from mmw.core.constants import GRAVITY
from mmw.core.errors import InputError
from mmw.core.transforms import compose, make_pose, pose_from_ypr
from mmw.physics.weather.weather import PRESETS
from mmw.scene.scene_data import SceneData
from mmw.scene.views import mount_pose
from mmw.sensors import DepthCamera, Gnss, Imu, Lidar, Radar, RgbCamera, SensorInput
from mmw.sensors.lidar import simulate as lidar
from mmw.sensors.scene_capture import capture
from tests.conftest import DEVICES
from tests.fixtures.plugin_sensor import Thermometer, thermometer
from tests.fixtures.scene_captures import FREE, KINDS, OTHER, SMALL, are_equal, assert_same, context, street
from tests.fixtures.scenes import ABSENT, arrays_from_parts, box_model, box_part, ground_part, pose, two_cars, wall_part


@pytest.fixture(scope="module", params=DEVICES)
def device(request: pytest.FixtureRequest) -> str:
    """Name of a Warp device, as in `conftest.py`, for all tests of the module in turn."""
    return request.param


@pytest.mark.parametrize("sensor", KINDS, ids=lambda sensor: sensor.type)
def test_many_poses_at_once_are_those_one_by_one(device: str, sensor: SensorConfig) -> None:
    arrays, velocity = street(), np.array([[3.0, 0.0, 0.0], [0.0, -1.0, 0.5]])
    scene = context(arrays, device, 1)
    together = capture(scene, sensor, pose=[FREE, OTHER], velocity=velocity)
    assert isinstance(together, list) and len(together) == 2
    for place, speed, sample in zip((FREE, OTHER), velocity, together, strict=True):
        assert_same(capture(scene, sensor, pose=place, velocity=speed), sample)
    assert not are_equal(*together)
    assert scene.device_scene.arrays is arrays and scene.device_scene.batch_frames == (1,)


def test_poses_and_weathers_are_traced_once(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    launches, trace = [], lidar.trace_lidar_hits
    monkeypatch.setattr(lidar, "trace_lidar_hits", lambda *args: launches.append(len(args[1])) or trace(*args))
    sensor = Lidar(channels=4, points_per_channel=60)
    found = capture(context(street(), device, 1), sensor, pose=[FREE] * 3, weather=["rainy", "sunny"])
    assert launches == [3] and list(found) == ["rainy", "sunny"] and len(found["sunny"]) == 3


@pytest.mark.parametrize("sensor", [KINDS[0], KINDS[2]], ids=lambda sensor: sensor.type)
def test_weathers_together_are_those_one_by_one(device: str, sensor: SensorConfig) -> None:
    scene = context(street(), device, 1)
    found = capture(scene, sensor, pose=FREE, weather=("rainy", "sunny"))
    for weather in ("sunny", "rainy"):
        assert_same(capture(context(street(), device, 1), sensor, pose=FREE, weather=weather), found[weather])
    assert_same(capture(scene, sensor, pose=FREE), found["sunny"])  # the first of the scene
    assert not are_equal(found["sunny"], found["rainy"])


def test_a_list_of_sensors_gives_a_list(device: str) -> None:
    scene, sensors = context(street(), device, 1), [KINDS[3], KINDS[4]]
    found = capture(scene, sensors, actor="cav_1")
    for sensor, sample in zip(sensors, found, strict=True):
        assert_same(sample, capture(scene, sensor, actor="cav_1"))


@pytest.mark.parametrize(("actor", "role"), [("cav_1", "cav"), ("rsu_1", "rsu"), ("veh_001", "cav")])
def test_a_pose_is_that_of_the_mounted_sensor(device: str, actor: str, role: str) -> None:
    """Any actor carries it; a vehicle that is no agent as a CAV does."""
    arrays = street()
    sensor = DepthCamera(**SMALL, on=(), mount={"cav": MountConfig(position_m=(0.5, 0, 3.0), yaw_deg=20)})
    scene, index = context(arrays, device, 2), [actor.name for actor in arrays.actors].index(actor)
    place = compose(arrays.poses[2, index], mount_pose(sensor, role, actor))
    assert_same(capture(scene, sensor, actor=actor), capture(scene, sensor, pose=place))


@pytest.mark.parametrize("frames", [1, 2, 12])
def test_a_pose_moves_at_its_velocity(device: str, frames: int) -> None:
    """In a recording of one frame and at the ends of one too."""
    wall = wall_part("wall", (30.0, 20.0), (30.0, -20.0), 10.0)
    for frame in {0, frames // 2, frames - 1}:
        scene = context(arrays_from_parts([ground_part(), wall], poses=np.zeros((frames, 0, 7))), device, frame)
        place, velocity = pose(0.0, 0.0, 5.0, 0.2), np.array([4.0, 1.0, 0.0])
        silent = {"horizontal_drift_std_m": 0, "vertical_drift_std_m": 0, "horizontal_noise_std_m": 0}
        silent |= {"vertical_noise_std_m": 0, "velocity_noise_std_m_s": 0}
        fix = capture(scene, Gnss(mode="physical", **silent), pose=place, velocity=velocity)
        np.testing.assert_allclose(fix.velocity, velocity, atol=1e-9)
        sample = capture(scene, Imu(), pose=place, velocity=velocity)
        np.testing.assert_allclose(sample.accel_true, [0.0, 0.0, GRAVITY], atol=1e-7)
        np.testing.assert_array_equal(sample.gyro_true, 0.0)
        radar = Radar(output="dense", azimuth_rays=20, elevation_rays=8, horizontal_fov_deg=30, vertical_fov_deg=5)
        echoes = capture(scene, radar, pose=place, velocity=velocity)
        azimuth = echoes.azimuth + 0.2
        ahead = np.stack([np.cos(azimuth), np.sin(azimuth), np.tan(echoes.elevation)], axis=1)
        ahead *= np.cos(echoes.elevation)[:, None]
        assert len(echoes) > 100
        np.testing.assert_allclose(echoes.velocity, -ahead @ velocity, atol=1e-4)


def test_noise_belongs_to_the_pose(device: str) -> None:
    """And to the seed: the same again, and another one elsewhere; 0 and -0 are one place."""
    arrays = street()
    scene, other_seed = context(arrays, device, 1), context(arrays, device, 1, seed=8)
    place = (0.0, 2.0, 2.5, 0.0, 0.0, 0.0, 1.0)

    def noise(scene: SimpleNamespace, pose: tuple[float, ...]) -> tuple[float, ...]:
        sample = capture(scene, Imu(), pose=pose)
        return tuple(sample.accel - sample.accel_true)

    assert noise(scene, place) == noise(scene, place) == noise(scene, (-0.0, *place[1:]))
    assert len({noise(scene, place), noise(scene, FREE), noise(other_seed, place)}) == 3


def glowing_van(arrays: SceneData) -> SceneData:
    """Return the scene with a van whose faces, of material 4, are brake lights."""
    *others, glass = arrays.materials["sunny"]
    lit = replace(glass, appearance=replace(glass.appearance, lamp="brake", emission=(2.0, 0.0, 0.0)))
    return replace(arrays, materials={"sunny": (*others, lit)})


def test_a_cached_renderer_sees_other_poses(device: str) -> None:
    """Positions, motion and brake lights in the dark."""
    night = {"sunny": replace(PRESETS["sunny"], sun_altitude_deg=-20.0)}
    first = glowing_van(two_cars(4))
    moved = first.poses.copy()
    moved[:, 1, 0] = 3.0  # veh_001 stands still, so that it brakes, nearer to cav_1 and with its rear to it
    moved[:, 1, 3:] = moved[:, 0, 3:]
    second = replace(first, poses=moved)
    sensor = RgbCamera(width_px=48, height_px=32, flow=True, fov_deg=60)
    scene = context(first, device, 1, night)
    before = capture(scene, sensor, actor="cav_1")
    renderer = scene.cache["rgb", 7, False]
    scene.arrays = second
    scene.device_scene.replace_arrays(second)
    scene.device_scene.load_batch([1])
    after = capture(scene, sensor, actor="cav_1")
    assert scene.cache["rgb", 7, False] is renderer
    assert_same(after, capture(context(second, device, 1, night), sensor, actor="cav_1"))
    assert not np.array_equal(before.rgb, after.rgb) and not np.array_equal(before.flow, after.flow)
    drives = second.poses.copy()
    drives[:, 1, 0] = 3.0 + 0.1 * np.arange(-1, 3)  # in the same place in frame 1, and does not brake
    third = replace(first, poses=drives)
    scene.device_scene.replace_arrays(third)
    scene.device_scene.load_batch([1])
    rolling = capture(scene, sensor, actor="cav_1")
    assert_same(rolling, capture(context(third, device, 1, night), sensor, actor="cav_1"))
    assert not np.array_equal(rolling.rgb, after.rgb)


@pytest.mark.parametrize("sensor", [KINDS[0], KINDS[2], KINDS[3]], ids=lambda sensor: sensor.type)
@pytest.mark.parametrize("count", [1, 2])
def test_warp_arrays_are_those_of_numpy(device: str, sensor: SensorConfig, count: int) -> None:
    scene, places = context(street(), device, 1), [FREE, OTHER][:count]
    there, here = (capture(scene, sensor, pose=places, output=output) for output in ("warp", "numpy"))
    names = {"lidar": ("values", "scene_flow"), "rgb": ("rgb", "normals"), "depth": ("depth_m", "semantic")}
    for one, other in zip(there, here, strict=True):
        for name in names[sensor.type]:
            assert isinstance(getattr(one, name), wp.array) and str(getattr(one, name).device) == device
        for field in fields(one):
            value = getattr(one, field.name)
            if isinstance(value, wp.array):
                np.testing.assert_array_equal(value.numpy(), getattr(other, field.name))
            else:
                assert_same(value, getattr(other, field.name))


def test_images_beyond_one_launch_are_joined(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, sensors = context(street(), device, 1), (KINDS[2], KINDS[3])
    for sensor in sensors:
        for output in ("numpy", "warp"):
            whole = capture(scene, sensor, pose=[FREE, OTHER, FREE], output=output)
            with monkeypatch.context() as patch:
                patch.setattr("mmw.sensors.camera_group.launches.max_pixels", lambda _: 1)
                pieces = capture(scene, sensor, pose=[FREE, OTHER, FREE], output=output)
            for one, other in zip(whole, pieces, strict=True):
                assert_same(one, other)


def test_tensors_share_the_memory(device: str) -> None:
    torch = pytest.importorskip("torch")
    scene = context(street(), device, 1)
    rgb = capture(scene, KINDS[2], pose=FREE, output="warp").rgb
    tensor = torch.from_dlpack(rgb)
    assert tensor.shape == (16, 24, 3) and tensor.dtype == torch.uint8 and tensor.data_ptr() == rgb.ptr
    cloud = capture(scene, KINDS[0], pose=FREE, output="warp")
    points = torch.from_dlpack(cloud.xyz)
    assert points.shape == (len(cloud), 3) and points.data_ptr() == cloud.values.ptr
    np.testing.assert_array_equal(points.cpu().numpy(), capture(scene, KINDS[0], pose=FREE).xyz)


def test_sensors_of_other_packages_are_captured(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Samples with `view` one by one, others whole."""
    scene = context(street(), device, 1)
    with thermometer():
        assert capture(scene, Thermometer(), pose=[FREE, OTHER]) == 2
    seen: list[SensorInput] = []
    with thermometer(simulate=lambda data, _: seen.append(data) or dict.fromkeys(data.weathers, np.arange(3.0))):
        np.testing.assert_array_equal(capture(scene, Thermometer(), actor="cav_1"), np.arange(3.0))
    assert seen[0].seed == 7 and list(seen[0].weathers) == ["sunny"] and len(seen[0].views) == 1
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "examples" / "altimeter")
    import mmw_altimeter  # pyright: ignore[reportMissingImports]

    register_sensor(mmw_altimeter.SPEC)
    try:
        sensor = mmw_altimeter.Altimeter(noise_m=0.0)
        high, low = capture(scene, sensor, pose=[pose(0.0, 0.0, 9.0), pose(1.0, 0.0, 4.0)])
        assert high.height == pytest.approx(9.0) and low.height == pytest.approx(4.0)
        assert street().objects[high.object_id].label == "road"
    finally:
        del SENSORS._added["altimeter"]


def test_what_sensors_keep_is_made_once(device: str) -> None:
    made: list[int] = []

    def simulate(data: SensorInput, _: Thermometer) -> dict[str, int]:
        return dict.fromkeys(data.weathers, data.cached("thermometer", lambda: made.append(1) or len(made)))

    scene = context(street(), device, 1)
    with thermometer(simulate=simulate):
        assert [capture(scene, Thermometer(), pose=FREE) for _ in range(3)] == [1, 1, 1]
    assert made == [1]


def room() -> SceneData:
    """Return a closed box on the ground beside a car, and an actor that leaves before the last frame."""
    parts = [ground_part(), box_part("Buildings/house", (8, 8, 8), (20, 0, 4), "concrete_facade", "building")]
    rows = [[pose(0.0, 0.0), pose(0.0, 9.0)], [pose(0.0, 0.0), ABSENT]]
    return arrays_from_parts(parts, [box_model("car")], [("cav_1", "cav", 0), ("veh_001", "vehicle", 0)], rows)


INSIDE = (20.0, 0.0, 4.0, 0.0, 0.0, 0.0, 1.0)
LOW = Lidar(mount={"cav": MountConfig(position_m=(0.0, 0.0, 0.7))})


@pytest.mark.parametrize(
    ("sensor", "options", "words"),
    [
        (KINDS[0], {}, "neither of pose and actor"),
        (KINDS[0], {"pose": FREE, "actor": "cav_1"}, "both of pose and actor"),
        (KINDS[0], {"actor": "cav_2"}, "actor 'cav_2': the scene has cav_1, veh_001; name one"),
        (KINDS[0], {"actor": ["cav_1", "veh_001"]}, "'veh_001': is absent in frame 1; frames 0 to 0 have it"),
        (KINDS[0], {"actor": "cav_1", "velocity": (1, 0, 0)}, "velocity = .* leave velocity out"),
        (KINDS[0], {"pose": (np.nan, *FREE[1:])}, r"pose = \(nan, .*finite numbers are needed"),
        (KINDS[0], {"pose": [FREE, (0, 0, 9, 0, 0, 0, 0)]}, "the quaternion is zero"),
        (KINDS[0], {"pose": FREE[:6]}, r"pose: has shape \(6,\); .* shape \[7\]"),
        (KINDS[0], {"pose": np.zeros((2, 2, 7))}, r"pose: has shape \(2, 2, 7\)"),
        (KINDS[0], {"pose": "here"}, "pose = 'here': x, y, z, qx"),
        (KINDS[0], {"pose": FREE, "velocity": (1.0, 0.0)}, r"velocity = \(1.0, 0.0\): finite .* shape \[3\]"),
        (KINDS[0], {"pose": FREE, "velocity": (np.inf, 0.0, 0.0)}, r"velocity = \(inf, "),
        (KINDS[0], {"pose": FREE, "velocity": "fast"}, "velocity = 'fast': finite numbers are needed"),
        (KINDS[0], {"pose": FREE, "weather": "foggy"}, "weather 'foggy': the scene has sunny; name one"),
        (KINDS[0], {"pose": FREE, "weather": ["sunny", "dry"]}, "weather 'dry'"),
        (KINDS[0], {"pose": FREE, "output": "torch"}, "output = 'torch'; one of numpy, warp"),
        (KINDS[4], {"pose": FREE, "output": "warp"}, "sensor 'imu': .* makes its arrays on the host"),
        (KINDS[5], {"pose": FREE, "output": "warp"}, "sensor 'gnss': .* makes its arrays on the host"),
        (KINDS[1], {"pose": FREE, "output": "warp"}, "sensor 'radar': .* makes its arrays on the host"),
        (Thermometer(), {"pose": FREE}, "sensor 'thermometer': no type 'thermometer' is registered, but lidar, "),
        ("lidar", {"pose": FREE}, "sensor = 'lidar': is a str; a sensor is needed"),
        ([KINDS[0], Lidar], {"pose": FREE}, "is a ModelMetaclass; a sensor is needed"),
        (KINDS[0], {"pose": INSIDE}, r"pose: lidar at \(20, 0, 4\) m in the world is inside .*house \(building\)"),
        (KINDS[3], {"pose": [FREE, INSIDE]}, "pose 1: depth at .* in frame 1; it .*; move the pose"),
        (LOW, {"actor": "cav_1"}, "cav_1: lidar at .* is inside its own body in frame 1; .* move its mount"),
    ],
)  # fmt: skip
def test_bad_input_is_one_message(sensor: Any, options: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        capture(context(room(), "cpu", 1), sensor, **options)
    assert len(str(caught.value).splitlines()) == 1


def test_sensors_that_need_no_view_work_inside() -> None:
    scene = context(room(), "cpu", 1)
    np.testing.assert_allclose(capture(scene, Imu(), pose=INSIDE).accel_true, [0.0, 0.0, GRAVITY], atol=1e-7)


def test_an_empty_list_gives_an_empty_list() -> None:
    scene = context(room(), "cpu", 1)
    assert capture(scene, KINDS[0], pose=np.zeros((0, 7))) == capture(scene, KINDS[0], actor=[]) == []
    assert capture(scene, [], pose=FREE) == []
    assert capture(scene, KINDS[0], pose=FREE, weather=[]) == {}


def test_a_pose_may_tilt_and_need_no_unit_quaternion() -> None:
    scene, sensor = context(room(), "cpu", 1), KINDS[3]
    tilted = pose_from_ypr((0.0, 5.0, 3.0), 0.4, 0.5, 0.2)
    longer = make_pose(tilted[:3], 3.0 * tilted[3:])
    np.testing.assert_array_equal(
        capture(scene, sensor, pose=longer).object_id, capture(scene, sensor, pose=tilted).object_id
    )
