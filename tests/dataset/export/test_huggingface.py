"""The Hugging Face folder, opened by `datasets` as a user opens it."""

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow.fs as fs
import pyarrow.parquet as pq
import pytest
import yaml
from PIL import Image

from mmw.dataset import open_dataset
from mmw.dataset.export.exporter import Selection, export
from mmw.dataset.export.huggingface import FORMAT
from mmw.storage.codecs.images import decode_depth
from mmw.storage.schemas import TABLES
from mmw.storage.table_spec import IMAGE
from tests.fixtures.shards import META, keys_of, write_made_up


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_made_up(tmp_path_factory.mktemp("made") / "data", keys_of("town_a", frames=3))


@pytest.fixture(scope="module")
def out(root: Path, exported) -> Path:
    return exported("huggingface", {"license": "cc-by-4.0", "title": "Made up: a test"}, root)


@pytest.fixture
def stream(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """Return `load_dataset` for streaming, offline, with a cache of its own."""
    for name, value in (("HF_HOME", str(tmp_path)), ("HF_HUB_OFFLINE", "1"), ("HF_DATASETS_OFFLINE", "1")):
        monkeypatch.setenv(name, value)
    datasets = pytest.importorskip("datasets", reason="datasets is not installed; pip install datasets")

    def load(folder: Path, table: str, **options) -> Iterator[dict]:
        return datasets.load_dataset(str(folder), table, split="train", streaming=True, **options)

    return load


def head_of(out: Path) -> dict:
    return yaml.safe_load((out / "README.md").read_text().split("---\n")[1])


@pytest.mark.parametrize("table", TABLES)
def test_every_table_streams(root, out, stream, table):
    """As many rows as the dataset has, with the same key columns in some order."""
    found = [tuple(row[name] for name in TABLES[table].key) for row in stream(out, table)]
    rows = open_dataset(root).read(table, columns=list(TABLES[table].key)).to_pylist()
    assert sorted(found) == sorted(tuple(row.values()) for row in rows)
    assert len(found) == len(rows) > 0


def test_images_are_image_features(root, out, stream):
    rows = stream(out, "rgb", filters=[("weather", "==", "sunny"), ("frame", "==", 4), ("agent", "==", "cav_2")])
    assert type(rows.features["image"]).__name__ == "Image"
    (row,) = rows
    (stored,) = open_dataset(root).read("rgb", weather="sunny", frames=range(4, 5), agent="cav_2").to_pylist()
    assert isinstance(row["image"], Image.Image) and row["image"].size == (8, 6)
    np.testing.assert_array_equal(row["image"], np.asarray(Image.open(io.BytesIO(stored["image"]["bytes"]))))
    (depth,) = stream(out, "depth", filters=[("weather", "==", "rainy"), ("frame", "==", 2)])
    (stored,) = open_dataset(root).read("depth", weather="rainy", frames=range(2, 3)).to_pylist()
    metres = np.asarray(depth["image"], dtype=np.float32) * np.float32(0.01)
    np.testing.assert_array_equal(np.where(metres > 0, metres, np.inf), decode_depth(stored["image"]["bytes"]))


def test_lists_keep_their_numbers(root, out, stream):
    row = next(iter(stream(out, "lidar", filters=[("weather", "==", "sunny"), ("frame", "==", 0)])))
    (stored,) = open_dataset(root).read("lidar", weather="sunny", frames=range(1), agent=row["agent"]).to_pylist()
    assert row["agent"] == stored["agent"]
    np.testing.assert_array_equal(np.float32(row["x"]), np.float32(stored["x"]))
    assert row["ring"] == stored["ring"] and row["flow_x"] == stored["flow_x"]


def test_files_are_copies(root, out):
    source = root / "lidar" / "scenario=town_a" / "weather=sunny" / "part-000003.parquet"
    assert (out / "lidar" / "town_a.sunny.000003.parquet").read_bytes() == source.read_bytes()
    assert (out / "dataset.json").read_bytes() == (root / "dataset.json").read_bytes()


def test_geometry_of_paths_is_there_once(root, out):
    """It has no weather, so neither has the name of its file; the other tables of the first weather have theirs."""
    names = ["town_a.000000.parquet", "town_a.000003.parquet"]
    assert sorted(path.name for path in (out / "path_geometry").iterdir()) == names
    source = root / "path_geometry" / "scenario=town_a" / "part-000003.parquet"
    assert (out / "path_geometry" / names[1]).read_bytes() == source.read_bytes()
    assert len(list((out / "path_gains").iterdir())) == 4


def test_card(root, out):
    head = head_of(out)
    assert (head["license"], head["pretty_name"]) == ("cc-by-4.0", "Made up: a test")
    assert [config["config_name"] for config in head["configs"]] == list(TABLES)
    assert [config["config_name"] for config in head["configs"] if config.get("default")] == ["rgb"]
    for config in head["configs"]:
        (files,) = config["data_files"]
        assert files["split"] == "train" and list(out.glob(files["path"]))
    total = sum(open_dataset(root).arrow(table).count_rows() for table in TABLES)
    assert head["size_categories"] == ["n<1K" if total < 1000 else "1K<n<10K"]
    text = (out / "README.md").read_text()
    assert META["config_sha256"] in text and "town_a" in text and "frames 0 to 5" in text
    assert "| gain_db | dB |" in text


def test_selection_is_written_again(root, tmp_path, stream):
    """Frames, agents and weathers; boxes belong to nobody and stay; encodings and features are those of the dataset."""
    out = tmp_path / "out"
    picked = Selection(weathers=("rainy",), agents=("cav_1", "rsu_1"), frames=range(2, 4))
    export(root, "huggingface", out, picked)
    poses = [(row["weather"], row["frame"], row["agent"]) for row in stream(out, "poses")]
    assert sorted(poses) == [("rainy", frame, agent) for frame in (2, 3) for agent in ("cav_1", "rsu_1")]
    assert len(list(stream(out, "boxes"))) == 2 * 5
    assert [row["agent"] for row in stream(out, "sensors")] == ["cav_1", "rsu_1"]
    assert {row["weather"] for row in stream(out, "links")} == {"rainy"}
    assert {(row["frame"], row["agent"]) for row in stream(out, "path_geometry")} == {(2, "cav_1"), (3, "cav_1")}
    assert "materials" not in {config["config_name"] for config in head_of(out)["configs"]}  # all of them are of sunny
    assert next(iter(stream(out, "rgb")))["image"].size == (8, 6)
    path = "lidar/scenario=town_a/weather=rainy/part-000000.parquet"
    old, new = pq.ParquetFile(root / path), pq.ParquetFile(out / "lidar" / "town_a.rainy.000000.parquet")
    assert new.schema_arrow.equals(old.schema_arrow, check_metadata=True)
    packed = [[file.metadata.row_group(0).column(k) for k in range(file.metadata.num_columns)] for file in (old, new)]
    assert [(c.compression, c.encodings) for c in packed[0]] == [(c.compression, c.encodings) for c in packed[1]]
    assert "license" not in head_of(out)


def test_every_picture_is_an_image(out, stream):
    """Every image column of every table, not only those that may be null."""
    columns = [(table, field.name) for table, spec in TABLES.items() for field in spec.columns if field.type == IMAGE]
    assert len(columns) >= 6
    for table, column in columns:
        assert isinstance(next(iter(stream(out, table)))[column], Image.Image), (table, column)


def test_a_dataset_that_is_elsewhere_is_refused(root):
    elsewhere = open_dataset(root, fs.LocalFileSystem())
    with pytest.raises(ValueError, match="is no local folder; its files are copied; download it first"):
        FORMAT.tasks(elsewhere, Selection(), {})
