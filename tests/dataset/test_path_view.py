"""The view `paths` of a dataset: SQL, Arrow, frames, memory and other filesystems give the same rows."""

import shutil
from pathlib import Path

import pyarrow.fs as pafs
import pytest

import mmw
from mmw.channel.tables import PATHS
from mmw.core.errors import InputError
from mmw.dataset import Dataset
from mmw.dataset.table_reader import MemoryTables
from mmw.storage.shard_writer import marker_path, table_path
from tests.fixtures.shards import keys_of, write_made_up

KEYS = keys_of("town_a", "town_b", frames=3)
NAMES = [field.name for field in PATHS.columns]


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_made_up(tmp_path_factory.mktemp("made") / "data", KEYS)


@pytest.fixture(scope="module")
def data(root: Path) -> Dataset:
    return mmw.open(root)


def expected_rows(data: Dataset) -> list[dict]:
    """Return the rows of the view, looked up one by one."""
    key = ("scenario", "frame", "agent", "peer", "antenna", "peer_antenna", "path")
    geometry = {tuple(row[name] for name in key): row for row in data.read("path_geometry").to_pylist()}
    rows = []
    for gains in data.read("path_gains").to_pylist():
        row = {**geometry[tuple(gains[name] for name in key)], **gains}
        row["doppler_hz"] = -row["range_rate"] * row["carrier_hz"] / 299792458.0
        rows.append({name: row[name] for name in NAMES})
    return rows


def test_every_reader_gives_the_same_rows(data: Dataset, root: Path) -> None:
    rows = expected_rows(data)
    assert len(rows) == len(KEYS) * 3 * 2 * 2 * 2  # frames, agents with paths, carriers, paths
    assert data.read("paths").to_pylist() == rows
    assert rows == sorted(rows, key=lambda row: tuple(row[name] for name in PATHS.full_key))
    order = ", ".join(PATHS.full_key)
    select = ", ".join(f'"{name}"' for name in NAMES)
    connection = data.connect()
    query = f"SELECT {select} FROM paths ORDER BY {order}"
    assert connection.sql(query).to_arrow_table().to_pylist() == rows
    assert [name for name, *_ in connection.sql("DESCRIBE paths").fetchall()] == NAMES
    elsewhere = mmw.open(root.name, filesystem=pafs.SubTreeFileSystem(str(root.parent), pafs.LocalFileSystem()))
    assert elsewhere.read("paths").to_pylist() == rows
    assert elsewhere.connect().sql(query).to_arrow_table().to_pylist() == rows
    memory = MemoryTables("memory", {name: data.read(name) for name in ("path_gains", "path_geometry")})
    assert memory.read("paths").to_pylist() == rows
    frame = data.frame("town_b", "sunny", 4)
    own = [row for row in rows if (row["scenario"], row["weather"], row["frame"]) == ("town_b", "sunny", 4)]
    assert frame.table("paths").to_pylist() == own
    assert connection.sql(f"SELECT {select} FROM paths_at('town_b', 'sunny', 4) ORDER BY {order}").to_arrow_table(
    ).to_pylist() == own  # fmt: skip
    assert frame.table("path_geometry").num_rows == len(own) // 2
    assert sum(len(link.paths["tau_s"]) for link in frame.links) == len(own)
    assert {(link.antenna, link.peer_antenna) for link in frame.links} == {("antenna", "antenna")}
    assert [(link.agent, link.carrier) for link in frame.links] == [(f"cav_{k}", c) for k in (1, 2, 3) for c in (0, 1)]


@pytest.mark.parametrize(
    "where",
    [{"scenario": "town_b"}, {"weather": "sunny", "frames": range(1, 5, 2)}, {"agent": "cav_2", "frames": range(2, 3)}],
)
def test_filters(data: Dataset, where: dict) -> None:
    frames = where.get("frames", range(9))
    rows = [
        row for row in expected_rows(data)
        if row["frame"] in frames and all(row[name] == value for name, value in where.items() if name != "frames")
    ]  # fmt: skip
    assert data.read("paths", **where).to_pylist() == rows and len(rows) > 0
    columns = ["doppler_hz", "weather", "vertices"]
    assert data.read("paths", columns=columns, **where).to_pylist() == [{n: row[n] for n in columns} for row in rows]


def test_gains_alone_open_no_file_of_the_geometry(root: Path, tmp_path: Path) -> None:
    shutil.copytree(root, tmp_path / "data")
    for path in (tmp_path / "data" / "path_geometry").rglob("*.parquet"):
        path.write_bytes(b"no Parquet")
    data = mmw.open(tmp_path / "data")
    assert data.read("paths", columns=["carrier", "a_re", "path"]).num_rows == len(KEYS) * 24
    with pytest.raises(InputError, match=r"path_geometry.*cannot be read"):
        data.read("paths", columns=["tau_s"])


def test_a_lost_file_of_the_geometry_is_named(root: Path, tmp_path: Path) -> None:
    shutil.copytree(root, tmp_path / "data")
    (tmp_path / "data" / table_path("path_geometry", KEYS[0])).unlink()
    data = mmw.open(tmp_path / "data")
    with pytest.raises(InputError, match=r"48 rows of path_gains have no row in path_geometry.*mmw verify"):
        data.read("paths")
    assert data.read("paths", frames=range(3, 6)).num_rows == len(KEYS) * 12


def test_geometry_is_published_with_any_weather(root: Path, tmp_path: Path) -> None:
    """A run that has only begun, or a copy without the first weather, has what there is."""
    shutil.copytree(root, tmp_path / "data")
    (tmp_path / "data" / marker_path(KEYS[0])).unlink()
    rows = mmw.open(tmp_path / "data").read("paths")
    assert rows.num_rows == (len(KEYS) - 1) * 24
    (tmp_path / "data" / marker_path(KEYS[2])).unlink()  # the same frames in the other weather
    data = mmw.open(tmp_path / "data")
    assert data.read("paths").num_rows == (len(KEYS) - 2) * 24
    assert len(data.check_files("path_geometry")) == 3


def test_names_of_tables_and_views(data: Dataset) -> None:
    assert data.views == ("paths",) and "paths" not in data.tables and "path_gains" in data.tables
    with pytest.raises(InputError, match="'paths' is a view of path_gains and path_geometry; name one of these"):
        data.arrow("paths")
    with pytest.raises(InputError, match=r"'paths': has no column range, sensor; it has scenario, weather"):
        data.read("paths", columns=["range"], sensor="lidar")
    with pytest.raises(InputError, match=r"'path_geometry': has no column weather"):
        data.read("path_geometry", weather="sunny")
