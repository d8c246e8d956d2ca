"""Every sensor in every mode and with every key set, in one run: tables, batches, weathers, resuming, stored values."""

import os
import shutil
from pathlib import Path

import duckdb
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

from mmw.__main__ import main as mmw
from mmw.cli.run import main
from mmw.config import load_config
from mmw.config.load import to_yaml
from mmw.config.sampling import UNSET
from mmw.config.section import Section
from mmw.config.sensor_spec import spec_of
from mmw.config.sensors import default_sensors
from mmw.dataset import connect, open_dataset
from mmw.storage import atomic_files as publish
from mmw.storage.schemas import TABLES
from tests.fixtures.own_world import DATA, assert_same_rows, run_own, table_files

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
    "gnss": VIEWS + 2 + 1,  # 25 and 50 samples a second: frame 4, not 3; the traced receiver has a fix
}
"""Rows of one weather: two frames, one CAV, one roadside unit."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("every")
    shutil.copy(DATA / "mine.usda", folder)
    shutil.copy(DATA / "every_sensor.yaml", folder / "mine.yaml")
    return folder


@pytest.fixture(scope="module")
def dataset(folder: Path) -> Path:
    assert run_own(folder, "d") == 0
    return folder / "d"


def test_every_key_of_every_sensor_is_set(folder: Path) -> None:
    """Of each sensor's keys, and of those of its sub-sections, some sensor of the file has another value."""
    sensors = load_config(folder / "mine.yaml").sensors
    for default in default_sensors():
        own = [sensor for sensor in sensors if sensor.type == default.type]
        for name in set(type(default).model_fields) - {"type", *UNSET}:  # rates: below
            usual, values = getattr(default, name), [getattr(sensor, name) for sensor in own]
            assert any(value != usual for value in values), (default.type, name)
            if isinstance(usual, Section):
                for key in type(usual).model_fields:
                    where = (default.type, name, key)
                    assert any(getattr(value, key) != getattr(usual, key) for value in values), where


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
    assert one("SELECT DISTINCT sensor FROM lidar WHERE flow_x IS NULL") == ["carla_lidar"]
    assert one("SELECT DISTINCT sensor FROM depth WHERE depth_m IS NULL") == ["plain"]
    assert one("SELECT DISTINCT sensor FROM rgb WHERE format = 'png'") == ["colour"]
    assert one("SELECT frame FROM rgb WHERE sensor = 'colour' AND weather = 'mine'") == [4]
    assert one("SELECT DISTINCT round(ev100, 3) FROM rgb WHERE sensor = 'still'") == [13.0]
    assert one("SELECT DISTINCT sensor FROM sensors WHERE lens = 'brown_conrady'") == ["colour"]
    assert one("SELECT DISTINCT sensor FROM imu WHERE handedness = 'left'") == ["physical_imu"]
    assert one("SELECT DISTINCT sensor FROM gnss_satellites") == ["traced_gnss"]
    assert one("SELECT count(*) >= 4 FROM gnss_satellites WHERE weather = 'mine' AND is_tracked") == [True]
    assert one("SELECT DISTINCT weather FROM lidar_points WHERE label = 2 AND sensor = 'carla_lidar'") == []
    assert "foggy" in one("SELECT DISTINCT weather FROM lidar_points WHERE label = 2")
    assert one("SELECT min(time_offset) < 0 FROM lidar_points WHERE sensor = 'physical'") == [True]
    assert one("SELECT max(time_offset) = 0 FROM lidar_points WHERE sensor = 'carla_lidar'") == [True]


@pytest.mark.parametrize(("table", "sensor"), [("lidar", "carla_lidar"), ("radar", "carla")])
def test_carla_does_not_know_the_weather(dataset: Path, table: str, sensor: str) -> None:
    """CARLA's LiDAR and radar have equal points in every weather."""
    query = f"SELECT * EXCLUDE weather FROM {table} WHERE sensor = '{sensor}' AND weather = '%s' ORDER BY frame, agent"
    connection = connect(dataset)
    sunny, foggy, mine = (connection.sql(query % weather).fetchall() for weather in ("sunny", "foggy", "mine"))
    assert len(sunny) == VIEWS * (1 if table == "lidar" else 2) and max(row[4] for row in sunny) > 0
    assert foggy == sunny == mine


def test_batch_size_does_not_change_a_row(folder: Path, dataset: Path) -> None:
    assert run_own(folder, "batch", "--batch-frames", "1") == 0
    assert_same_rows(dataset, folder / "batch")


def test_a_rate_leaves_the_samples_that_remain_as_they_are(folder: Path, dataset: Path) -> None:
    config = load_config(folder / "mine.yaml")
    slow = tuple(sensor.model_copy(update={"rate_hz": 50.0}) for sensor in config.sensors)
    (folder / "half.yaml").write_text(to_yaml(config.model_copy(update={"sensors": slow})))
    assert run_own(folder, "half", config="half.yaml") == 0
    assert mmw(["verify", str(folder / "half")]) == 0
    tables = {table.name for sensor in default_sensors() for table in spec_of(sensor).tables}
    filled = set()
    for name in table_files(folder / "half"):
        if (table := name.split("/")[0]) in tables:
            half, all_ = (pq.ParquetFile(root / name).read() for root in (folder / "half", dataset))
            same = all_.filter(pc.equal(all_["frame"], 4))  # the only even frame
            if table == "imu":  # the white noise of a physical IMU has its density at the rate of the samples
                assert half.num_rows == same.num_rows
                half, same = (part.filter(pc.equal(part["sensor"], "imu")) for part in (half, same))
            assert half.equals(same), name
            filled |= {table} if half.num_rows else set()
    assert filled == tables


def test_a_weather_alone_has_the_rows_that_it_has_among_others(folder: Path, dataset: Path) -> None:
    assert run_own(folder, "alone", "weathers=[mine]") == 0
    names = [name for name in table_files(dataset) if "weather=mine" in name]
    assert names == [name for name in table_files(folder / "alone") if "weather=" in name] != []
    for name in names:
        own, among = (pq.ParquetFile(root / name).read() for root in (folder / "alone", dataset))
        assert own.equals(among), name  # not their bytes: files name their configuration


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
        assert run_own(folder, "torn", "compute.writer_threads=1") == 1  # one shard after the other
    assert "resume" in capsys.readouterr().err
    done = len(list((folder / "torn" / "_shards").glob("mine.*.json")))
    assert 0 < done < len(list((dataset / "_shards").glob("mine.*.json")))
    assert run_own(folder, "torn") == 0
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
    assert run_own(folder, "again", config="d/config.yaml") == 0
    assert_same_rows(dataset, folder / "again")
    params = duckdb.sql(f"SELECT DISTINCT sensor, params FROM '{dataset}/sensors/**/*.parquet'").fetchall()
    assert {name for name, _ in params} == {sensor.name for sensor in config.sensors} | {"antenna"}
