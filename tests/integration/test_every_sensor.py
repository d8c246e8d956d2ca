"""Every sensor in every mode and with every key set, in one run: tables, batches, weathers, resuming, stored values."""

import os
from pathlib import Path

import duckdb
import pytest

from mmw.__main__ import main as mmw
from mmw.cli.run import main
from mmw.config import load_config
from mmw.config.load import to_yaml
from mmw.config.section import Section
from mmw.config.sensors import default_sensors
from mmw.dataset import connect, open_dataset
from mmw.storage import atomic_files as publish
from mmw.storage.schemas import TABLES
from tests.fixtures.own_world import STAGE
from tests.integration.test_end_to_end import assert_same_rows, rows_of

CONFIG = """
scenarios:
  - name: mine
    stage: mine.usda
    actor_roles: {/World/Ego: cav, /World/Mast: rsu}
    material_map: {"/World/*": itu_concrete}
weathers: [sunny, foggy, mine]
air:
  mine: {carla: {precipitation: 80, fog_density: 20, wetness: 90}, temperature_c: 4}
frames: {start: 3, count: 2}
output: {shard_frames: 1}
channel: {candidates: exhaustive, carriers_hz: [28e9]}
compute: {batch_frames: 2}
sensors:
  - type: lidar
    name: compat
    mode: compat
    on: [rsu]
    channels: 4
    points_per_channel: 32
    range_m: 80
    upper_fov_deg: -2
    lower_fov_deg: -30
    horizontal_fov_deg: 270
    mount: {rsu: {position_m: [0.1, 0, 3.6], yaw_deg: 180}}
    carla:
      atmosphere_attenuation_rate: 0.01
      dropoff_general_rate: 0.1
      dropoff_intensity_limit: 0.9
      dropoff_zero_intensity: 0.5
      noise_stddev: 0.02
  - type: lidar
    name: physical
    elevations_deg: [3.0, 1.0, -2.0, -8.0, -20.0]
    points_per_channel: 32
    returns: dual
    preset: nir1550
    optics:
      wavelength_nm: 905
      aperture_m: 0.03
      divergence: 0.002
      min_power: 1e-5
      overlap_start_m: 0.5
      overlap_full_m: 3.0
      pulse_s: 1e-8
      nearest_m: 1.5
      range_resolution_m: 0.05
      drop_backscatter: 0.6
    detection: absolute
    detection_margin_db: 6
    rolling: true
    deskew: true
    scene_flow: true
  - type: depth
    name: camera
    on: [cav, rsu]
    width_px: 48
    height_px: 32
    fov_deg: 90
    range_m: 900
    format: float32
    segmentation: true
    mount: {rsu: {position_m: [0, 0, 3.9], yaw_deg: 180, pitch_deg: 10, roll_deg: 2}}
  - {type: depth, name: plain, boxes_2d: false, width_px: 16, height_px: 16}
  - type: rgb
    name: colour
    on: [cav]
    every_frames: 2
    width_px: 48
    height_px: 32
    fov_deg: 90
    range_m: 2000
    samples: 9
    shadows: false
    sky_light: false
    reflections: false
    format: png
    jpeg_quality: 80
    jpeg_subsampling: "4:4:4"
    segmentation: true
    boxes_2d: false
    normals: true
    flow: true
    debug: true
    mount: {cav: {position_m: [1, 0, 2.2], yaw_deg: 10, pitch_deg: 5}}
    lens:
      model: brown_conrady
      k1: -0.05
      k2: 0.01
      k3: -0.001
      k4: 0.02
      k5: 0.003
      k6: 0.0004
      p1: 0.001
      p2: -0.002
      fx_px: 30
      fy_px: 31
      cx_px: 23
      cy_px: 17
    image:
      exposure: {mode: auto, ev_compensation: 0.5, min_ev100: 0, max_ev100: 16}
      shutter_ms: 8
      motion_blur: true
      tone_map: none
      noise: {enabled: true, full_well: 5000, read_noise: 5}
      vignette: 0.3
      streak_strength: 2
      lens_drops: 6
  - {type: rgb, name: still, width_px: 16, height_px: 16, image: {streaks: false, exposure: {ev100: 13}}}
  - type: imu
    name: physical_imu
    on: [cav, rsu]
    mode: physical
    handedness: left
    accel_lag_frames: 1
    gyro_bias: 0.002
    accel_noise_std: 0.2
    gyro_noise_std: 0.004
    accel_noise_density: 0.02
    gyro_noise_density: 4e-4
    accel_random_walk: 2e-4
    gyro_random_walk: 2e-5
    bias_correlation_s: 50
    accel_turn_on_std: 0.1
    gyro_turn_on_std: 0.01
    accel_scale_std: 0.01
    gyro_scale_std: 0.02
    misalignment_std_deg: 1
    mount: {cav: {position_m: [0.5, 0, 0.3]}}
  - {type: imu}
  - type: gnss
    name: physical_gnss
    on: [cav, rsu]
    mode: physical
    rate_hz: 25
    reference_latitude_deg: 12
    reference_longitude_deg: -30
    reference_altitude_m: 100
    heading_noise_std_deg: 0.5
    latitude_noise_std_deg: 2e-5
    longitude_noise_std_deg: 3e-5
    altitude_noise_std_m: 0.1
    speed_noise_std_m_s: 0.1
    horizontal_drift_std_m: 2
    vertical_drift_std_m: 3
    drift_correlation_s: 60
    horizontal_noise_std_m: 0.2
    vertical_noise_std_m: 0.3
    velocity_noise_std_m_s: 0.1
    mount: {cav: {position_m: [0, 0, 2.2]}}
  - {type: gnss}
  - {type: radar, name: carla, mode: compat, points: 100, on: [cav, rsu], range_m: 80}
  - type: radar
    name: maps
    horizontal_fov_deg: 100
    vertical_fov_deg: 40
    azimuth_rays: 24
    elevation_rays: 8
    carrier_hz: 79e9
    bandwidth_hz: 100e6
    chirp_time_s: 5e-4
    frame_time_s: 5e-3
    azimuth_antennas: 16
    elevation_antennas: 2
    transmit_power_dbm: 15
    antenna_gain_dbi: 12
    horizontal_beam_deg: 60
    vertical_beam_deg: 20
    reference_snr_db: 20
    false_alarm_probability: 1e-4
    wet_radome_db: 3
    maps: [range_azimuth, range_doppler]
    iq: true
    mount: {rsu: {position_m: [0, 0, 4.2], yaw_deg: 180, pitch_deg: 5}}
  - {type: radar, name: dense, on: [cav], output: dense, azimuth_rays: 24, elevation_rays: 8}
"""
VIEWS = 2
"""Samples that one agent's sensor gives in one weather: the frames."""
ROWS = {
    "frames": VIEWS,
    "poses": VIEWS * 2,
    "imu": VIEWS * 3,
    "lidar": VIEWS * 3,
    "depth": VIEWS * 3,
    "rgb": 1 + VIEWS * 2,  # one frame of two, and CAV and roadside unit
    "normals": 1,
    "flow": 1,
    "radar": VIEWS * 4,
    "radar_maps": VIEWS * 2,
    "radar_iq": VIEWS,
    "segmentation": VIEWS * 2 + 1,
    "gnss": VIEWS + 2,  # 25 samples a second: frame 4, not 3
}
"""Rows of one weather: two frames, one CAV, one roadside unit."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("every")
    (folder / "mine.usda").write_text(STAGE)
    (folder / "mine.yaml").write_text(CONFIG)
    return folder


def make(folder: Path, out: str, *changes: str, config: str = "mine.yaml") -> int:
    return main(["--config", str(folder / config), *changes, "--out", str(folder / out), "--device", "cpu"])


@pytest.fixture(scope="module")
def dataset(folder: Path) -> Path:
    assert make(folder, "d") == 0
    return folder / "d"


def test_every_key_of_every_sensor_is_set(folder: Path) -> None:
    """Of each sensor's keys, and of those of its sub-sections, some sensor of the file has another value."""
    sensors = load_config(folder / "mine.yaml").sensors
    for default in default_sensors():
        own = [sensor for sensor in sensors if sensor.type == default.type]
        for name in set(type(default).model_fields) - {"type"}:
            usual, values = getattr(default, name), [getattr(sensor, name) for sensor in own]
            assert any(value != usual for value in values), (default.type, name)
            if isinstance(usual, Section):
                for key in type(usual).model_fields:
                    assert any(getattr(value, key) != getattr(usual, key) for value in values), (
                        default.type,
                        name,
                        key,
                    )


def test_every_table_has_its_rows(dataset: Path, capsys: pytest.CaptureFixture) -> None:
    assert mmw(["verify", str(dataset)]) == 0
    assert "every file is there and unchanged" in capsys.readouterr().out
    connection = connect(dataset)
    assert open_dataset(dataset).tables == tuple(TABLES)
    for table in (*TABLES, "lidar_points", "radar_points"):
        assert len(connection.sql(f"SELECT * FROM {table}").fetchall()) > 0, table
    for table, rows in ROWS.items():
        counts = connection.sql(f"SELECT weather, count(*) FROM {table} GROUP BY weather ORDER BY weather").fetchall()
        assert counts == [("foggy", rows), ("mine", rows), ("sunny", rows)], table


def test_every_mode_leaves_its_mark(dataset: Path) -> None:
    connection = connect(dataset)

    def one(query: str) -> list:
        return [value for (value,) in connection.sql(query).fetchall()]

    assert one("SELECT DISTINCT kind FROM radar_maps ORDER BY kind") == ["range_azimuth", "range_doppler"]
    assert one("SELECT DISTINCT sensor FROM radar WHERE power_db IS NULL") == ["carla"]
    assert one("SELECT DISTINCT sensor FROM lidar WHERE flow_x IS NULL") == ["compat"]
    assert one("SELECT DISTINCT sensor FROM depth WHERE depth_m IS NULL") == ["plain"]
    assert one("SELECT DISTINCT sensor FROM rgb WHERE format = 'png'") == ["colour"]
    assert one("SELECT frame FROM rgb WHERE sensor = 'colour' AND weather = 'mine'") == [4]
    assert one("SELECT DISTINCT round(ev100, 3) FROM rgb WHERE sensor = 'still'") == [13.0]
    assert one("SELECT DISTINCT sensor FROM sensors WHERE lens = 'brown_conrady'") == ["colour"]
    assert one("SELECT DISTINCT sensor FROM imu WHERE handedness = 'left'") == ["physical_imu"]
    assert one("SELECT DISTINCT weather FROM lidar_points WHERE label = 2 AND sensor = 'compat'") == []
    assert "foggy" in one("SELECT DISTINCT weather FROM lidar_points WHERE label = 2")
    assert one("SELECT min(time_offset) < 0 FROM lidar_points WHERE sensor = 'physical'") == [True]
    assert one("SELECT max(time_offset) = 0 FROM lidar_points WHERE sensor = 'compat'") == [True]


@pytest.mark.parametrize(("table", "sensor"), [("lidar", "compat"), ("radar", "carla")])
def test_compat_does_not_know_the_weather(dataset: Path, table: str, sensor: str) -> None:
    """CARLA's LiDAR and radar have equal points in every weather."""
    query = f"SELECT * EXCLUDE weather FROM {table} WHERE sensor = '{sensor}' AND weather = '%s' ORDER BY frame, agent"
    connection = connect(dataset)
    sunny, foggy, mine = (connection.sql(query % weather).fetchall() for weather in ("sunny", "foggy", "mine"))
    assert len(sunny) == VIEWS * (1 if table == "lidar" else 2) and max(row[4] for row in sunny) > 0
    assert foggy == sunny == mine


def test_batch_size_does_not_change_a_row(folder: Path, dataset: Path) -> None:
    assert make(folder, "batch", "compute.batch_frames=1") == 0
    assert_same_rows(dataset, folder / "batch")


def test_a_weather_alone_has_the_rows_that_it_has_among_others(folder: Path, dataset: Path) -> None:
    assert make(folder, "alone", "weathers=[mine]") == 0
    own, all_ = rows_of(folder / "alone"), rows_of(dataset)
    own = {path: table for path, table in own.items() if "weather=" in path}
    assert list(own) == [path for path in all_ if "weather=mine" in path]
    for path, table in own.items():
        assert table.equals(all_[path]), path


def test_interrupted_and_resumed_gives_the_same_rows(
    folder: Path, dataset: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    real, calls = os.fsync, []

    def full(descriptor: int) -> None:
        calls.append(descriptor)
        if len(calls) > 100:
            raise OSError(28, "No space left on device")
        real(descriptor)

    with monkeypatch.context() as patch:
        patch.setattr(publish.os, "fsync", full)
        assert make(folder, "torn", "compute.writer_threads=1") == 1  # one shard after the other
    assert "resume" in capsys.readouterr().err
    done = len(list((folder / "torn" / "_shards").glob("mine.*.json")))
    assert 0 < done < len(list((dataset / "_shards").glob("mine.*.json")))
    assert make(folder, "torn") == 0
    assert_same_rows(dataset, folder / "torn")


def test_what_is_printed_and_what_is_stored_load_again(
    folder: Path, dataset: Path, capsys: pytest.CaptureFixture
) -> None:
    config = load_config(folder / "mine.yaml")
    assert main(["--config", str(folder / "mine.yaml"), "--print-config"]) == 0
    printed = capsys.readouterr().out
    (folder / "printed.yaml").write_text(printed)
    again = load_config(folder / "printed.yaml")
    assert again == config and again.sha256() == config.sha256() and to_yaml(again) == printed
    stored = load_config(dataset / "config.yaml")
    assert (stored.sensors, stored.air, stored.weathers) == (config.sensors, config.air, config.weathers)
    assert make(folder, "again", config="d/config.yaml") == 0
    assert_same_rows(dataset, folder / "again")
    params = duckdb.sql(f"SELECT DISTINCT sensor, params FROM '{dataset}/sensors/**/*.parquet'").fetchall()
    assert {name for name, _ in params} == {sensor.name for sensor in config.sensors} | {"antenna"}
