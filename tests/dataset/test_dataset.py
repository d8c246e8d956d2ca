"""Reading a dataset back: DuckDB, Arrow, pandas."""

import io
import subprocess
import sys
from pathlib import Path

import duckdb
import numpy as np
import pyarrow as pa
import pytest
from PIL import Image

from mmw.dataset import connect, open_dataset
from mmw.dataset.sql import VIEWS, point_views
from mmw.storage.manifest import prepare_root
from mmw.storage.schemas import TABLES
from mmw.storage.shard_writer import ShardKey
from tests.fixtures.shards import IDENTITY, META, keys_of, make_shard, write_made_up

KEYS = keys_of("town_a", "town_b")


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a dataset in a folder whose name is hard to quote."""
    return write_made_up(tmp_path_factory.mktemp("it's") / "data [1] *", KEYS)


def test_one_frame_comes_from_its_file(root):
    connection = connect(root)
    for key in KEYS:
        for frame in range(key.frame_begin, key.frame_end):
            at = f"('{key.scenario}', '{key.weather}', {frame})"
            same = f"WHERE scenario = '{key.scenario}' AND weather = '{key.weather}' AND frame = {frame}"
            for table in ("lidar", "links"):
                rows = connection.sql(f"SELECT * FROM {table}_at{at} ORDER BY ALL").fetchall()
                assert rows == connection.sql(f"SELECT * FROM {table} {same} ORDER BY ALL").fetchall() != []
                plan = str(connection.sql(f"EXPLAIN ANALYZE SELECT * FROM {table}_at{at}").fetchall())
                assert "Total Files Read: 1" in plan and f"part-{key.frame_begin:06d}" in plan
    with pytest.raises(duckdb.IOException, match="scenario=nowhere"):
        connection.sql("SELECT * FROM lidar_at('nowhere', 'sunny', 0)")


def test_views_hold_every_row_once(root):
    connection = connect(root)
    views = {
        name for (name,) in connection.execute("SELECT view_name FROM duckdb_views() WHERE NOT internal").fetchall()
    }
    assert open_dataset(root).tables == tuple(TABLES)
    assert views == {*TABLES, *VIEWS, *point_views()}
    for table in open_dataset(root).tables:
        (count,) = connection.execute(f"SELECT count(*) FROM {table}").fetchone()
        assert count == open_dataset(root).arrow(table).count_rows()
    keys = "SELECT count(*), count(DISTINCT (scenario, weather, frame, agent)) FROM poses"
    assert connection.execute(keys).fetchone() == (2 * 2 * 8 * 4, 2 * 2 * 8 * 4)


def test_tables_join_on_the_key(root):
    """One (frame, agent) over five tables gives what was written."""
    query = """
        SELECT p.x, l.point_count, i.ax, k.gain_db, o.prim_path
        FROM poses p JOIN lidar l USING (scenario, weather, frame, agent)
        JOIN imu i USING (scenario, weather, frame, agent) JOIN links k USING (scenario, weather, frame, agent)
        JOIN objects o ON o.scenario = p.scenario AND o.object_id = p.object_id
        WHERE p.scenario = 'town_b' AND weather = 'sunny' AND frame = 5 AND agent = 'cav_1' AND carrier_hz = 28e9
    """
    rows = connect(root).execute(query).fetchall()
    shard = make_shard(ShardKey("town_b", "sunny", 4, 8))
    expected = (
        shard["poses"]["x"][4],
        shard["lidar"]["point_count"][4],
        np.float32(shard["imu"]["ax"][3]),
        shard["links"]["gain_db"][7],
        "/World/Actors/cav_1",
    )
    assert rows == [expected]


def test_lidar_points_view_has_one_row_a_return(root):
    shard = make_shard(KEYS[1])["lidar"]
    names = ("x", "y", "z", "intensity", "ring", "object_id", "label", "time_offset", "return_number")
    query = f"SELECT {', '.join(names)} FROM lidar_points WHERE scenario = 'town_a' AND weather = 'rainy' "
    rows = connect(root).execute(query + "AND frame = 6 AND agent = 'cav_2'").fetchnumpy()
    for name in names:
        np.testing.assert_array_equal(rows[name], shard[name][9])
    (points,) = connect(root).execute("SELECT count(*) FROM lidar_points").fetchone()
    assert points == sum(sum(make_shard(key)["lidar"]["point_count"]) for key in KEYS)


@pytest.mark.parametrize("sensor", ["radar", "radar_2"])
def test_radar_points_view_has_one_row_a_point_and_null_without_a_value(root, sensor):
    shard, row = make_shard(KEYS[1])["radar"], 2 * 9 + (sensor == "radar_2")
    query = "SELECT * FROM radar_points WHERE scenario = 'town_a' AND weather = 'rainy' AND frame = 6 AND "
    rows = connect(root).sql(f"{query} agent = 'cav_2' AND sensor = '{sensor}'").to_arrow_table()
    assert rows.num_rows == shard["point_count"][row] > 0
    for name in ("range", "azimuth", "elevation", "velocity", "object_id", "label"):
        np.testing.assert_array_equal(rows.column(name), shard[name][row])
    for name in ("power_db", "snr_db", "rcs_dbsm"):
        given = shard[name].to_pylist()[row]
        assert rows.column(name).to_pylist() == ([None] * rows.num_rows if sensor == "radar_2" else given)
    (points,) = connect(root).execute("SELECT count(*) FROM radar_points").fetchone()
    assert points == sum(sum(make_shard(key)["radar"]["point_count"]) for key in KEYS)


def test_visibility_has_the_column_of_each_type_of_sensor(root):
    query = """
        SELECT sensor, count(*) = count(lidar_points), count(*) = count(radar_points), count(*) = count(pixels),
               count(*) = count(is_los), count(blocker_id) = count(*) FILTER (WHERE NOT is_los)
        FROM box_visibility GROUP BY sensor ORDER BY sensor
    """
    assert connect(root).execute(query).fetchall() == [
        ("antenna", False, False, False, True, True),
        ("depth", False, False, True, False, True),
        ("lidar", True, False, False, False, True),
        ("radar", False, True, False, False, True),
    ]


def test_arrow_reads_only_the_selection(root):
    table = open_dataset(root).read(
        "poses",
        columns=["frame", "agent", "x"],
        scenario="town_a",
        weather="sunny",
        frames=range(2, 7, 2),
        agent="rsu_1",
    )
    assert table.column("frame").to_pylist() == [2, 4, 6] and table.column_names == ["frame", "agent", "x"]
    shards = {begin: make_shard(ShardKey("town_a", "sunny", begin, begin + 4))["poses"]["x"] for begin in (0, 4)}
    expected = [shards[0][2 * 4 + 3], shards[4][0 * 4 + 3], shards[4][2 * 4 + 3]]
    assert table.column("x").to_pylist() == expected
    assert open_dataset(root).read("poses", frames=range(0)).num_rows == 0
    assert open_dataset(root).read("objects", scenario="town_b").num_rows == 2


def test_arrow_skips_files_of_other_scenarios(root):
    dataset = open_dataset(root).arrow("frames")
    condition = (pa.compute.field("scenario") == "town_a") & (pa.compute.field("weather") == "sunny")
    files = [fragment.path for fragment in dataset.get_fragments(filter=condition)]
    assert len(files) == 2 and all("scenario=town_a/weather=sunny" in path for path in files)


def test_null_means_no_path(root):
    query = "SELECT DISTINCT path_count, is_los, gain_db IS NULL FROM links ORDER BY path_count"
    assert connect(root).execute(query).fetchall() == [(0, False, True), (2, True, False)]


def test_depth_image_opens_in_any_reader(root):
    (cell,) = connect(root).execute("SELECT image FROM depth WHERE frame = 0 LIMIT 1").fetchone()
    image = Image.open(io.BytesIO(cell["bytes"]))
    assert image.size == (8, 6) and image.mode.startswith("I;16") and cell["path"] == "rsu_1_000000.png"


def test_metadata_reaches_duckdb(root):
    file = (
        str(next((root / "path_gains").rglob("*.parquet"))).replace("[", "[[]").replace("*", "[*]").replace("'", "''")
    )
    query = f"SELECT decode(value) FROM parquet_kv_metadata('{file}') WHERE decode(key) = 'mmw.table'"
    assert connect(root).execute(query).fetchall() == [("path_gains",)]


def test_info_and_errors(root, tmp_path):
    assert open_dataset(root).info["config"] == IDENTITY
    with pytest.raises(ValueError, match=r"no dataset\.json"):
        open_dataset(tmp_path)
    with pytest.raises(ValueError, match="is not known"):
        open_dataset(root).arrow("framez")
    prepare_root(tmp_path / "empty", IDENTITY, META["config_sha256"], {}, False)
    with pytest.raises(ValueError, match="holds no table"):
        connect(tmp_path / "empty")
    with pytest.raises(ValueError, match="'poses' has no file"):
        open_dataset(tmp_path / "empty").read("poses")


def test_duckdb_is_optional():
    """Importing the module and reading with Arrow needs no DuckDB; the error of `connect` says what to install."""
    code = (
        "import sys; sys.modules['duckdb'] = None\n"
        "import mmw.dataset\n"
        "try:\n    mmw.dataset.Dataset(None).connect()\n"
        "except ImportError as error:\n    assert 'multimodal-wireless[query]' in str(error), error\n"
        "else:\n    raise SystemExit('no error')\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=Path(__file__).parents[2])
