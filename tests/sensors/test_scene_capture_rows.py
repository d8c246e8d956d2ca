"""A sample of one frame on an agent is the row of a run, bit for bit."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mmw.config import Config, load_config
from mmw.generation.capture import capture_sensors, started_sensors
from mmw.sensors.camera_group.launch_images import StartedImages
from mmw.sensors.lidar.rows import LISTS
from mmw.sensors.radar import capture as radar
from mmw.sensors.scene_capture import capture
from mmw.storage.codecs.images import (
    decode_instance,
    decode_metres,
    decode_rgb,
    decode_semantic,
    encode_flow,
    encode_normals,
)
from tests.conftest import DEVICES
from tests.fixtures.scene_captures import context, street
from tests.fixtures.sensor_runs import captured

CONFIG = """
scenarios: [{name: street, town: town03, traffic: {vehicle_count: 3, spawn_center_m: [0, 0, 0], cav_ranks: [1]}}]
weathers: [sunny, rainy]
channel: {enabled: false}
seed: 7
sensors:
  - {type: lidar, channels: 8, points_per_channel: 90}
  - {type: lidar, name: rolling, channels: 4, points_per_channel: 90, rolling: true, deskew: true, returns: dual,
     scene_flow: true}
  - {type: lidar, name: carla, mode: carla, channels: 4, points_per_channel: 90}
  - {type: radar, on: [cav, rsu], azimuth_rays: 40, elevation_rays: 12, azimuth_antennas: 8, elevation_antennas: 2,
     frame_time_s: 320.0e-6, maps: [range_azimuth, range_doppler], iq: true}
  - {type: radar, name: rays, output: dense, azimuth_rays: 40, elevation_rays: 12}
  - {type: rgb, name: front, width_px: 48, height_px: 32, format: png, segmentation: true, normals: true, flow: true,
     image: {motion_blur: true}}
  - {type: depth, on: [cav, rsu], width_px: 48, height_px: 32, format: float32, segmentation: true}
  - {type: imu, mode: physical, accel_lag_frames: 1, bias_correlation_s: 5}
  - {type: gnss, mode: physical, rate_hz: 50}
"""


@pytest.fixture(scope="module", params=DEVICES)
def device(request: pytest.FixtureRequest) -> str:
    """Name of a Warp device, as in `conftest.py`, for all tests of the module in turn."""
    return request.param


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Config:
    path = tmp_path_factory.mktemp("c") / "c.yaml"
    path.write_text(CONFIG)
    return load_config(path)


@pytest.fixture(scope="module")
def rows(config: Config, device: str) -> dict[tuple, dict[str, Any]]:
    """Rows of a run by weather, table, agent and sensor, all of frame 2."""

    def run(batch: Any, _: Any, frames: Any, collected: Any) -> None:
        capture_sensors(batch, frames, collected)

    tables = captured(run, config, street(), device, [[0, 1], [2, 3]])
    found: dict[tuple, Any] = {}
    for weather, by_name in tables.items():
        for name, table in by_name.items():
            for row in table.to_pylist():
                if row["frame"] == 2:
                    found.setdefault((weather, name, row["agent"], row["sensor"]), []).append(row)
    return found


def of_run(config: Config, device: str) -> SimpleNamespace:
    return context(street(), device, 2, {name: config.air[name].weather(name) for name in config.weathers})


def check_lidar(cloud: Any, row: Callable[..., dict]) -> None:
    own = row("lidar")
    assert own["point_count"] == len(cloud) > 50
    for name in LISTS:
        values = getattr(cloud, name)
        np.testing.assert_array_equal(values, np.array(own[name], dtype=values.dtype))
    np.testing.assert_array_equal(cloud.xyz, np.stack([cloud.x, cloud.y, cloud.z], axis=1))
    assert (cloud.scene_flow is None) == (own["flow_x"] is None)
    if cloud.scene_flow is not None:
        flow = np.array([own[f"flow_{axis}"] for axis in "xyz"], dtype=np.float32).T
        np.testing.assert_array_equal(cloud.scene_flow, flow)


def check_radar(points: Any, row: Callable[..., dict]) -> None:
    own = row("radar")
    assert own["point_count"] == len(points) > 3
    for name in ("range", "azimuth", "elevation", "velocity", "power_db", "snr_db", "rcs_dbsm", "object_id", "label"):
        values = getattr(points, name)
        np.testing.assert_array_equal(values, np.array(own[name], dtype=values.dtype))
    for index, maps in enumerate(points.maps):
        stored = row("radar_maps", index)
        assert (maps.kind, maps.row_step, maps.column_first) == (
            stored["kind"], stored["row_step"], stored["column_first"],
        )  # fmt: skip
        np.testing.assert_array_equal(maps.values.ravel(), np.array(stored["values"], dtype=np.float32))
    if points.iq is not None:
        stored = row("radar_iq")
        assert points.iq.shape == (stored["antennas"], stored["chirps"], stored["samples"])
        np.testing.assert_array_equal(points.iq.real.ravel(), np.array(stored["i"], dtype=np.float32))
        np.testing.assert_array_equal(points.iq.imag.ravel(), np.array(stored["q"], dtype=np.float32))


def check_objects(image: Any, row: Callable[..., dict]) -> None:
    np.testing.assert_array_equal(image.semantic, decode_semantic(row("segmentation")["semantic"]["bytes"]))
    boxes = image.boxes_2d
    for index in range(len(boxes)):
        stored = row("boxes_2d", index)
        for name in ("object_id", "pixels", "truncation", "distance"):
            assert getattr(boxes, name)[index] == stored[name]
        edges = ("u_min", "v_min", "u_max", "v_max")
        np.testing.assert_array_equal(boxes.amodal[index], [stored[f"amodal_{edge}"] for edge in edges])
        if stored["pixels"]:
            np.testing.assert_array_equal(boxes.bounds[index], [stored[edge] for edge in edges])


def check_rgb(image: Any, row: Callable[..., dict]) -> None:
    np.testing.assert_array_equal(image.rgb, decode_rgb(row("rgb")["image"]["bytes"]))
    assert image.rgb.shape == (32, 48, 3) and image.exposure == row("rgb")["exposure"]
    assert encode_normals(image.normals) == row("normals")["image"]["bytes"]
    assert encode_flow(image.flow) == row("flow")["image"]["bytes"]
    np.testing.assert_array_equal(image.instance, decode_instance(row("segmentation")["instance"]["bytes"]))
    check_objects(image, row)


def check_depth(image: Any, row: Callable[..., dict]) -> None:
    own = row("depth")
    np.testing.assert_array_equal(image.depth_m, decode_metres(own["image"]["bytes"], own["depth_m"]))
    np.testing.assert_array_equal(image.object_id, decode_instance(row("segmentation")["instance"]["bytes"]))
    assert np.isinf(image.depth_m).any() and np.array_equal(np.isinf(image.depth_m), image.object_id < 0)
    check_objects(image, row)


def check_imu(sample: Any, row: Callable[..., dict]) -> None:
    own = row("imu")
    for name, prefix, dtype in (("accel", "a", np.float32), ("gyro", "g", np.float32)):
        for values, end, kind in (
            (name, "", dtype),
            (f"{name}_true", "_true", float),
            (f"{name}_bias", "_bias", dtype),
        ):
            stored = [own[f"{prefix}{axis}{end}"] for axis in "xyz"]
            np.testing.assert_array_equal(getattr(sample, values).astype(kind), stored)
    assert sample.compass == own["compass"]


def check_gnss(sample: Any, row: Callable[..., dict]) -> None:
    own = row("gnss")
    assert sample.latitude_deg == own["latitude_deg"] and sample.longitude_deg == own["longitude_deg"]
    assert sample.altitude_m == own["altitude_m"]
    stored = [own["latitude_true_deg"], own["longitude_true_deg"], own["altitude_true_m"]]
    np.testing.assert_array_equal(sample.geodetic_true, stored)
    np.testing.assert_array_equal(sample.velocity.astype(np.float32), [own["v_east"], own["v_north"], own["v_up"]])
    assert (np.float32(sample.speed), np.float32(sample.heading)) == (own["speed"], own["heading"])


CHECKS = {
    "lidar": check_lidar, "radar": check_radar, "rgb": check_rgb, "depth": check_depth, "imu": check_imu,
    "gnss": check_gnss,
}  # fmt: skip


@pytest.mark.parametrize("name", ["lidar", "rolling", "carla", "radar", "rays", "front", "depth", "imu", "gnss"])
def test_a_sample_on_an_agent_is_the_row_of_a_run(device: str, config: Config, rows: dict, name: str) -> None:
    """Bit for bit, in each weather, for all agents that carry the sensor in the run."""
    sensor = next(sensor for sensor in config.sensors if sensor.name == name)
    agents = [{"cav": "cav_1", "rsu": "rsu_1"}[role] for role in sensor.on]
    found = capture(of_run(config, device), sensor, actor=agents, weather=["sunny", "rainy"])
    for weather, samples in found.items():
        for agent, sample in zip(agents, samples, strict=True):

            def row(table: str, index: int = 0, weather: str = weather, agent: str = agent) -> dict:
                return rows[weather, table, agent, name][index]

            CHECKS[sensor.type](sample, row)


@pytest.mark.parametrize("puts_off", [True, False])
def test_cameras_start_first_and_are_waited_for_last(
    config: Config, device: str, monkeypatch: pytest.MonkeyPatch, puts_off: bool
) -> None:
    """In a live frame; in a run, whose launches are as large as the memory allows, they come after everything else."""
    events: list[str] = []

    def logged(owner: Any, name: str, event: str) -> None:
        call = getattr(owner, name)
        monkeypatch.setattr(owner, name, lambda *args: events.append(event) or call(*args))

    logged(StartedImages, "__init__", "start")
    logged(StartedImages, "wait", "wait")
    logged(radar, "scans", "radar")

    def run(batch: Any, _: Any, frames: Any, collected: Any) -> None:
        with started_sensors(batch, frames, collected):
            events.append("within")

    captured(run, config, street(), device, [[0]], puts_off=puts_off)
    others = ["within", "radar", "radar"]
    launches = events.count("start")  # RGB with its depth camera, and perhaps depth of another agent
    assert launches in (1, 2)
    ahead = ["start"] * launches + others + ["wait"] * launches
    assert events == (ahead if puts_off else others + ["start", "wait"] * launches)
