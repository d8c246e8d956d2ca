"""Wrong input for sensors and weather: exit code 2, and one line a problem with the place, the value and the cure."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from mmw.cli.run import main
from mmw.config import ConfigError, load_config
from mmw.generation.configuration_warnings import configuration_warnings
from mmw.sensors import DepthCamera, Gnss, Imu, Lidar, Radar, RgbCamera
from mmw.sensors.camera_group import launch_images as cameras
from tests.fixtures.own_world import STAGE, write_own_world
from tests.fixtures.scenes import two_cars

CONFIG = """
scenarios:
  - {name: s1, town: town03, traffic: {vehicle_count: 8, spawn_center_m: [0, 0, 0], cav_ranks: [1]}}
frames: {count: 10}
channel: {enabled: false}
"""

LIDAR = [
    ("horizontal_fov_deg: 0", "horizontal_fov_deg = 0", "greater than 0"),
    ("upper_fov_deg: -25", "upper_fov_deg = lower_fov_deg = -25 with channels = 64", "set them apart"),
    ("upper_fov_deg: -30", "lower_fov_deg = -25.0 lies above upper_fov_deg = -30.0", "swap them"),
    ("channels: 0", "channels = 0", "greater than or equal to 1"),
    ('channels: "64"', 'channels = "64"', "without quotes"),
    ("channels: 4, elevations_deg: [1, 0, -1]", "3 elevations and channels = 4", "leave channels out"),
    ("elevations_deg: [2, 0, -1], upper_fov_deg: 5", "upper_fov_deg = 5", "leave the two limits out"),
    ("elevations_deg: []", "elevations_deg is empty", "leave the key out"),
    ("elevations_deg: [1, 3]", "goes up from 1 to 3", "sort the table"),
    ("elevations_deg: [95, 5]", "elevations_deg holds 95", "-90 to 90"),
    ("elevations_deg: [1, x]", 'elevations_deg[1] = "x"', "a number is needed"),
    (f"elevations_deg: {[0] * 300}", "elevations_deg: holds 300 values", "at most 256"),
    ("preset: hdl32", 'preset = "hdl32"', "'hdl64'"),
    ("mode: compat", 'mode = "compat"', "'carla' or 'physical'"),
    ("mode: carla, returns: dual", "returns = 'dual' in mode carla", "use mode: physical"),
    ("range_m: 1", "range_m = 1", "raise it"),
    ("range_m: .nan", "range_m = NaN", "finite number"),
    ("optics: {wavelength_nm: 532}", "optics: wavelength_nm = 532", "905 or 1550"),
    ("optics: {overlap_start_m: 5, overlap_full_m: 2}", "overlap_full_m = 2", "overlap_start_m or more"),
    ("optics: {foo: 1}", "optics.foo = 1: unknown key", "wavelength_nm"),
    ("carla: {dropoff_general_rate: 2}", "carla.dropoff_general_rate = 2", "less than or equal to 1"),
    ("deskew: true", "deskew = true without rolling", "set rolling"),
    ("rolling: true, scene_flow: true", "scene_flow with rolling", "deskew: true"),
    ("on: cav", 'on = "cav"', "a list is needed, such as [cav]"),
    ("on: [car]", "on names 'car'", "did you mean `cav`?"),
    ("on: [cav, cav]", "names one twice", "name each once"),
    ("mount: {truck: {}}", "mount names 'truck'", "there are cav, rsu, vru, uav, bs, cav_1"),
    ("mount: {cav: {position_m: [0, 0]}}", "mount.cav.position_m: holds 2", "more are needed"),
    ("mount: {cav: {position_m: [0, 0, 2500]}}", "mount.cav.position_m", "more than 1000 m from the agent"),
    ('name: "1x"', 'name = "1x"', "a letter, then letters"),
]
DEPTH = [
    ("fov_deg: 0", "fov_deg = 0", "greater than 0"),
    ("fov_deg: 180", "fov_deg = 180", "less than 180"),
    ("range_m: 700", "range_m = 700.0", "format: float32"),
    ("format: exr", 'format = "exr"', "'png16' or 'float32'"),
    ("segmentation: yes", 'segmentation = "yes"', "true or false"),
    ("width_px: 640.5", "width_px = 640.5", "whole number"),
]
IMU = [
    ("mode: real", 'mode = "real"', "'carla' or 'physical'"),
    ("handedness: both", 'handedness = "both"', "'right' or 'left'"),
    ("accel_noise_std: -1", "accel_noise_std = -1", "greater than or equal to 0"),
    ("gyro_bias: 1e300", "gyro_bias = 1", "less than or equal to 100"),
    ("bias_correlation_s: 0", "bias_correlation_s = 0", "greater than 0"),
    ("voltage: 1", "voltage = 1: unknown key", "known keys here"),
]
GNSS = [
    ("rate_hz: 30", "30 Hz does not divide them", "give 33.3333 or 25"),
    ("reference_latitude_deg: 95", "reference_latitude_deg = 95", "less than or equal to 89"),
    ("mode: rtk", 'mode = "rtk"', "'carla', 'physical' or 'ray_traced'"),
    ("horizontal_drift_std_m: 1e9", "horizontal_drift_std_m = 1000000000", "less than or equal to 10000"),
]
RGB = [
    ("fov_deg: 180", "fov_deg = 180", "fisheye"),
    ("samples: 2", "samples = 2", "1, 4 or 9"),
    ("format: webp", 'format = "webp"', "'jpeg' or 'png'"),
    ("lens: {model: brown_conrady, k1: -0.9}", "brown_conrady", "folds"),
    ("lens: {k1: 0.1}", "k1", "choose another model"),
    ("image: {exposure: {mode: auto, ev100: 12}}", "ev100 = 12", "mode: fixed"),
    ("image: {bloom: 1}", "image.bloom = 1", "unknown key"),
]
RADAR = [
    ("horizontal_fov_deg: 0", "horizontal_fov_deg = 0", "greater than 0"),
    ("mode: carla, maps: [range_azimuth]", "mode = carla has no power", "mode: physical"),
    ("mode: carla, iq: true", "mode = carla has no power", "mode: physical"),
    ("maps: [doppler]", 'maps[0] = "doppler"', "'range_azimuth' or 'range_doppler'"),
    ("maps: range_azimuth", 'maps = "range_azimuth"', "a list is needed, such as [range_azimuth]"),
    ("maps: [range_azimuth, range_azimuth]", "names one twice", "name each once"),
    ("iq: true, azimuth_antennas: 1024", "iq of 8192 x 500 x 202", "at most 16777216"),
    ("bandwidth_hz: 1e5", "bandwidth_hz = 100000", "raise bandwidth_hz"),
    ("carrier_hz: 1e9, bandwidth_hz: 9e8", "bandwidth_hz = 9e+08", "half of carrier_hz"),
    ("mode: carla, output: dense", "mode = carla has no power", "mode: physical"),
    ("carrier_hz: 77", "carrier_hz = 77", "greater than or equal to 1000000000"),
    ("chirp_time_s: 0.005, frame_time_s: 0.001", "chirp_time_s = 0.005", "shorten it"),
    ("false_alarm_probability: 0", "false_alarm_probability = 0", "greater than 0"),
    ("false_alarm_probability: 0.05", "false_alarm_probability = 0.05", "lower it"),
]
SENSORS = [
    (f"sensors=[{{type: {kind}, {keys}}}]", "sensors[0]", place, cure)
    for kind, cases in {"lidar": LIDAR, "depth": DEPTH, "imu": IMU, "gnss": GNSS, "radar": RADAR, "rgb": RGB}.items()
    for keys, place, cure in cases
]
OTHERS = [
    ("sensors=[{name: x}]", "sensors[0]", "`type` is missing", "lidar, depth, imu, gnss, radar or rgb"),
    ("sensors=[{type: sonar}]", "sensors[0]", 'type = "sonar"', "'gnss', 'radar'"),
    ("sensors=[{type: lidar}, {type: lidar}]", "sensors", "['lidar', 'lidar']", "its own name"),
    ("sensors.0.type=radar", "sensors", "'radar', 'depth', 'imu', 'gnss', 'radar'", "its own name"),
    ("air.sunny.rain_mm_h=-5", "air.sunny.rain_mm_h", "= -5", "greater than or equal to 0"),
    ("air.sunny.visibility_m=0", "air.sunny.visibility_m", "= 0", "greater than or equal to 10"),
    ("air.sunny.fog_type=sea", "air.sunny.fog_type", '"sea"', "'radiation'"),
    ("air.sunny.preset=snow", "air.sunny.preset", '"snow"', "'rainy'"),
    ("air.sunny.carla=SnowNoon", "air.sunny.carla", '"SnowNoon"', "HardRainNoon"),
    ("air.sunny.carla={precipitation: 200}", "air.sunny.carla.precipitation", "= 200", "0 to 100"),
    ("air.sunny.carla={precip: 20}", "air.sunny.carla.precip", "unknown key", "did you mean `precipitation`"),
    ("air.sunny.variant=snowy", "weathers", "town03 has the variants foggy, rainy, sunny", "air.sunny.variant"),
    ("air.monsoon.rain_mm_h=90", "air", "'monsoon' is described", "add it there"),
    ("air.1.rain_mm_h=3", "air.1", "a letter, then letters", "digits"),
    ("weathers=[monsoon]", "weathers", "'monsoon', of which nothing is known", "describe it here"),
    ("weathers=[sunny, sunny]", "weathers", "names one twice", "name each once"),
    ("weathers=sunny", "weathers", '= "sunny"', "such as [sunny]"),
]


BOUNDS = [
    (Lidar, {"horizontal_fov_deg": 361, "channels": 257, "returns": "first", "points_per_channel": 0}),
    (Lidar, {"range_m": -1, "detection_margin_db": -3, "carla": {"noise_stddev": -0.1}, "optics": {"min_power": -1}}),
    (Lidar, {"optics": {"divergence": -0.001}, "carla": {"dropoff_zero_intensity": 1.5}}),
    (DepthCamera, {"range_m": 0, "width_px": 7, "boxes": True}),
    (RgbCamera, {"fov_deg": 230, "jpeg_quality": 0, "rate_hz": 0, "shutter_ms": 5}),
    (Imu, {"accel_noise_density": -1e-3, "gyro_noise_density": -1e-9, "accel_random_walk": -1, "gyro_scale_std": 0.5}),
    (Imu, {"gyro_random_walk": np.nan, "accel_turn_on_std": -1, "misalignment_std_deg": 45, "accel_lag_frames": 2}),
    (Gnss, {"rate_hz": 2000, "reference_longitude_deg": 200, "horizontal_noise_std_m": -1, "drift_correlation_s": 0}),
    (Gnss, {"rate_hz": 0, "latitude_noise_std_deg": -1e-9}),
    (Radar, {"vertical_fov_deg": 180, "range_m": -1, "points": 0, "azimuth_rays": 0, "frame_time_s": 0.02}),
]
"""Sensors, and values each of which is refused."""


@pytest.mark.parametrize(("kind", "key", "value"), [(kind, *item) for kind, bad in BOUNDS for item in bad.items()])
def test_values_out_of_bounds_are_refused(kind: type, key: str, value: object) -> None:
    with pytest.raises(ConfigError, match=key):
        kind(**{key: value})


@pytest.fixture
def config_file(tmp_path: Path) -> Path:
    path = tmp_path / "c.yaml"
    path.write_text(CONFIG)
    return path


@pytest.mark.parametrize(("override", "place", "value", "cure"), [*SENSORS, *OTHERS])
def test_wrong_values_are_one_clear_line_and_exit_code_2(
    config_file: Path, override: str, place: str, value: str, cure: str, capsys: pytest.CaptureFixture
) -> None:
    assert main(["--config", str(config_file), override, "--device", "cpu", "--dry-run"]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and lines[0].startswith(f"mmw: {config_file}: ")
    for part in (place, value, cure):
        assert part in lines[0]
    assert not (config_file.parent / "out").exists()


@pytest.fixture
def own_world(tmp_path: Path) -> Path:
    return write_own_world(tmp_path)


def make_own(own_world: Path, sensor: str, *changes: str) -> int:
    settings = [f"sensors=[{sensor}]", "channel.enabled=false", "frames.count=1", "--device", "cpu", *changes]
    return main(["--config", str(own_world / "mine.yaml"), *settings, "--out", str(own_world / "d")])


@pytest.mark.parametrize("kind", ["lidar", "rgb", "depth", "radar"])
def test_a_sensor_inside_a_mesh_is_refused(own_world: Path, kind: str, capsys: pytest.CaptureFixture) -> None:
    """The vehicle is a closed box from 1 m below its origin to 1 m above, the plate on it at 1 m."""
    sensor = f"{{type: {kind}, on: [cav], mount: {{cav: {{position_m: [0, 0, %s]}}}}}}"
    assert make_own(own_world, sensor % 0.5) == 2
    (line,) = capsys.readouterr().err.splitlines()
    name = "front" if kind == "rgb" else kind
    assert line.startswith(f"mmw: Ego: {name} at (0.0, 0.0, 0.5) m is inside its own body in frame 0; ")
    assert line.endswith("raise or move its mount, as in mount: {Ego: {position_m: [0, 0, 1], relative_to: roof}}")


@pytest.mark.parametrize(
    ("sensor", "part"),
    [
        ("{type: lidar, mount: {cav: {position_m: [0, 0, 0.5]}}}", "raise or move its mount"),
        ("{type: radar, azimuth_antennas: 512, elevation_antennas: 512}", "at most 2147483647 can be counted"),
    ],
)
def test_what_only_the_run_refuses_does_not_block_the_folder(
    own_world: Path, sensor: str, part: str, capsys: pytest.CaptureFixture
) -> None:
    """The next try, with the sensor mended, goes into the same folder; what it made is then kept from others."""
    assert make_own(own_world, sensor) == 2
    assert part in capsys.readouterr().err
    assert make_own(own_world, "{type: imu}") == 0
    assert make_own(own_world, "{type: imu, mode: physical}") == 2
    assert "--overwrite" in capsys.readouterr().err


def test_drops_of_rain_have_carriers(own_world: Path, capsys: pytest.CaptureFixture) -> None:
    sensor = "{type: radar, carrier_hz: 10e9, azimuth_rays: 4, elevation_rays: 2}"
    assert make_own(own_world, sensor, "weathers=[rainy]") == 2
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("mmw: ")]
    assert "10 GHz" in line and "24 to 81 GHz" in line and "set carrier_hz within" in line


def test_a_shard_of_more_depths_than_a_column_holds_is_refused(own_world: Path, capsys: pytest.CaptureFixture) -> None:
    sensor = "{type: depth, on: [cav, rsu], format: float32, width_px: 8192, height_px: 8192}"
    (own_world / "mine.usda").write_text(STAGE.replace("endTimeCode = 9", "endTimeCode = 99"))
    assert make_own(own_world, sensor, "output.shard_frames=1000", "frames.count=20") == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "format = float32 gives 2684354560 depths a shard" in line and "output.shard_frames: 15 or less" in line


def no_host_memory() -> None:
    np.empty(2**50, dtype=np.uint8)


def no_device_memory() -> None:
    wp.empty((2**30, 2**20), dtype=wp.uint8, device="cpu")


@pytest.mark.parametrize("use", [no_host_memory, no_device_memory])
def test_a_memory_that_is_full_with_one_frame_is_exit_code_1_and_resumable(
    own_world: Path, use: Callable[[], None], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    small = "{type: depth, width_px: 8, height_px: 8}"
    with monkeypatch.context() as patch:
        patch.setattr(cameras, "trace_launch", lambda *_, **__: use())
        assert make_own(own_world, small, "frames.count=7", "compute.batch_frames=7") == 1
    lines = capsys.readouterr().err.splitlines()
    assert [line for line in lines if line.startswith("note: memory")] == [
        "note: memory is full with 7 frames a launch; going on with 3",
        "note: memory is full with 3 frames a launch; going on with 1",
    ]
    (line,) = [line for line in lines if line.startswith("mmw: ")]
    assert "memory is full (" in line and "fewer --workers" in line and "the same command resumes" in line
    assert make_own(own_world, small, "frames.count=7") == 0


def test_a_sensor_of_the_defaults_takes_a_table_of_elevations(config_file: Path) -> None:
    """An override puts the default sensors into the file: only what it says is set, so the table says the channels."""
    lidar = load_config(config_file, ["sensors.0.elevations_deg=[2, 0, -3]"]).sensors[0]
    assert (lidar.channels, lidar.upper_fov_deg, lidar.lower_fov_deg) == (3, 2, -3)
    changed = load_config(config_file, ["sensors.0.type=radar", "sensors.0.name=bumper"])
    assert [(sensor.type, sensor.name) for sensor in changed.sensors[:2]] == [("radar", "bumper"), ("depth", "depth")]


def test_what_gives_no_rows_is_noted(config_file: Path) -> None:
    arrays = two_cars(10)
    assert {actor.role for actor in arrays.actors} >= {"cav", "rsu"}
    sensors = "sensors=[{type: lidar}, {type: gnss, rate_hz: 10}, {type: imu, on: []}, {type: depth}]"

    def found(roles: tuple[str, ...], *changes: str) -> list[str]:
        config = load_config(config_file, [sensors, *changes])
        keep = [k for k, actor in enumerate(arrays.actors) if actor.role in roles]
        own = replace(arrays, actors=tuple(arrays.actors[k] for k in keep), poses=arrays.poses[:, keep])
        return list(configuration_warnings(own, config, config.scenarios[0]))

    assert found(("cav", "rsu")) == []
    assert found(("cav",)) == ["sensors: there is no RSU to carry depth: no rows of them"]
    late = found(("cav", "rsu"), "frames={start: 11, count: 9}")
    assert late == ["sensors: gnss samples frames 0, 10, 20, ...; none of 11 to 19 is one: no rows of it"]
    assert found(("cav", "rsu"), "frames={start: 11, count: 10}") == []
