"""Schemas, encodings and the checks at the gate."""

import json
import os
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from mmw.scene.table_rows import choices
from mmw.storage.arrow_tables import table_from_columns
from mmw.storage.codecs.images import decode_depth, encode_depth
from mmw.storage.parquet_schema import arrow_schema
from mmw.storage.schema_docs import schema_markdown
from mmw.storage.schemas import TABLES, column_text
from mmw.storage.shard_writer import ShardKey, write_shard
from tests.fixtures.shards import META, make_shard, make_statics

KEY = ShardKey("town_a", "sunny", 100, 103)


def columns(name: str) -> dict:
    rows = make_shard(KEY)[name] if TABLES[name].framed else make_statics()[name]
    return {"scenario": "town_a", **({"weather": "sunny"} if TABLES[name].of_weather else {}), **rows}


def assert_same_encoding(one: pa.Table, other: pa.Table) -> None:
    """Check that two tables are equal, with equal dictionaries."""
    assert one.equals(other)
    for mine, own in zip(one.columns, other.columns, strict=True):
        if pa.types.is_dictionary(mine.type):
            assert mine.chunk(0).dictionary.equals(own.chunk(0).dictionary)
            assert mine.chunk(0).indices.equals(own.chunk(0).indices)


def is_number(type_: pa.DataType) -> bool:
    leaf = type_.value_type if pa.types.is_list(type_) else type_
    return pa.types.is_integer(leaf) or pa.types.is_floating(leaf)


@pytest.mark.parametrize("name", TABLES)
def test_every_column_says_what_it_is(name):
    for field in TABLES[name].columns:
        text = column_text(field)
        assert len(text["doc"]) > 5, field.name
        assert is_number(field.type) == (text.get("unit", "") not in ("", "cm")), field.name
    assert set(TABLES[name].key) <= {field.name for field in TABLES[name].columns}


@pytest.mark.parametrize("name", TABLES)
def test_file_level_keys_describe_the_table(name):
    meta = {
        key.decode(): value.decode() for key, value in arrow_schema(name, {"mmw.config_sha256": "ff"}).metadata.items()
    }
    names = [field.name for field in TABLES[name].columns]
    assert meta["mmw.table"] == name and meta["mmw.config_sha256"] == "ff"
    assert list(json.loads(meta["mmw.columns"])) == names
    assert list(json.loads(meta["huggingface"])["info"]["features"]) == names


def test_hugging_face_sees_images_lists_and_names():
    depth = json.loads(arrow_schema("depth").metadata[b"huggingface"])["info"]["features"]
    lidar = json.loads(arrow_schema("lidar").metadata[b"huggingface"])["info"]["features"]
    assert depth["image"] == {"_type": "Image"} and arrow_schema("depth").field("image").nullable
    assert lidar["x"] == {"feature": {"dtype": "float32", "_type": "Value"}, "_type": "List"}
    assert lidar["agent"] == {"dtype": "string", "_type": "Value"}


def test_committed_page_is_current():
    page = Path(__file__).parents[2] / "docs" / "reference" / "tables.md"
    if os.environ.get("MMW_UPDATE_GOLDEN") == "1":
        page.parent.mkdir(exist_ok=True)
        page.write_text(schema_markdown(), encoding="utf-8")
    assert page.read_text(encoding="utf-8") == schema_markdown(), (
        "MMW_UPDATE_GOLDEN=1 pytest tests/storage/test_tables.py"
    )


@pytest.mark.parametrize("name", TABLES)
def test_values_survive_the_file(name, tmp_path):
    """Every column that goes in as NumPy comes out of Parquet with the schema's type and the same values."""
    given = columns(name)
    table = table_from_columns(name, given)
    if not TABLES[name].framed:
        pq.write_table(table, tmp_path / "t.parquet")
        back = pq.read_table(tmp_path / "t.parquet", partitioning=None)
    else:
        marker = write_shard(tmp_path, KEY, {name: table}, META)
        back = pq.ParquetFile(tmp_path / marker["files"][0]["path"]).read()
    assert back.schema.equals(arrow_schema(name))
    assert back.equals(table)
    for field in TABLES[name].columns:
        values = given[field.name]
        if isinstance(values, np.ndarray) and values.dtype.kind in "iuf":
            kind = np.float32 if field.type == pa.float32() else values.dtype
            stored = back.column(field.name).to_numpy()
            np.testing.assert_array_equal(np.sort(stored), np.sort(values.astype(kind)))
        elif pa.types.is_list(field.type) and not pa.types.is_string(field.type.value_type):
            kind = np.float32 if field.type.value_type == pa.float32() else np.float64
            stored = back.column(field.name).to_pylist()
            for old, new in zip(values.to_pylist() if isinstance(values, pa.Array) else values, stored, strict=True):
                assert (old is None) == (new is None), field.name
                if old is not None:
                    np.testing.assert_array_equal(np.asarray(new), np.asarray(old, dtype=kind))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"time_s": None}, "missing columns"),
        ({"extra": 1}, "unknown columns"),
        ({"time_s": np.zeros(2)}, "lengths"),
        ({"time_s": np.array([0.0, np.nan, 1.0])}, "not finite"),
        ({"time_s": np.array([0.0, np.inf, 1.0])}, "not finite"),
        ({"time_s": [0.0, None, 1.0]}, "row 1 is null"),
        ({"cav_count": np.array([1, 2, 70_000])}, "cav_count"),
        ({"frame": np.array([100, 100, 101])}, "repeat a key"),
        ({"frame": np.array([100.5, 101, 102])}, "frame"),
        ({"weather": ["sunny", None, "sunny"]}, "row 1 is null"),
        ({"weather": [1, 2, 3]}, "weather"),
    ],
)
def test_bad_columns_are_refused(change, words):
    given = columns("frames") | change
    if change.get("time_s", 0) is None:
        del given["time_s"]
    with pytest.raises(ValueError, match=words) as error:
        table_from_columns("frames", given)
    assert "frames" in str(error.value)


def test_unknown_table_is_refused():
    with pytest.raises(ValueError, match=r"framez.*frames, poses"):
        table_from_columns("framez", {})


def test_nan_in_a_list_is_refused():
    given = columns("lidar")
    given["x"][3] = np.append(given["x"][3][:-1], np.float32(np.nan))
    with pytest.raises(ValueError, match=r"'x'.*not finite"):
        table_from_columns("lidar", given)


def test_row_order_does_not_matter():
    """Rows given in any order come out sorted by the key, dictionaries included: the very same table."""
    given = columns("path_geometry")
    table = table_from_columns("path_geometry", given)
    order = np.random.default_rng(0).permutation(table.num_rows)
    shuffled = {
        name: values if isinstance(values, str) else [values[i] for i in order] for name, values in given.items()
    }
    again = table_from_columns("path_geometry", shuffled)
    assert_same_encoding(again, table)
    keys = list(zip(*(again.column(name).to_pylist() for name in TABLES["path_geometry"].key), strict=True))
    assert keys == sorted(keys)


@pytest.mark.parametrize("with_null", [False, True])
def test_names_by_number_are_names_by_text(with_null):
    """Whatever dictionary names come with: unused ones, another order, one twice, other types."""
    texts = ["rsu", "cav_2", "cav_1", "none of them", "cav_2", None if with_null else "cav_3"]
    index = np.random.default_rng(1).choice([0, 1, 2, 4, 5], 50).astype(np.int32)
    given = {**columns("boxes"), "frame": np.arange(50), "object_id": 7}
    given = {name: values if np.ndim(values) == 0 else np.resize(values, 50) for name, values in given.items()}
    forms = [
        [texts[i] for i in index],
        choices(texts, index),
        pa.DictionaryArray.from_arrays(index, pa.array(texts)),
        pa.DictionaryArray.from_arrays(index.astype(np.int8), pa.array(texts, pa.large_string())),
    ]
    expected, *others = (
        table_from_columns("boxes", {**given, "frame": np.arange(50), "agent": form}) for form in forms
    )
    assert expected.column("agent").to_pylist() == forms[0]
    for found in others:
        assert_same_encoding(found, expected)


def test_rows_with_one_key_are_named_wherever_they_stand():
    given = columns("boxes")
    twice = {name: values if np.ndim(values) == 0 else [*values, values[0]] for name, values in given.items()}
    with pytest.raises(ValueError, match=r"1 rows repeat a key, the first \{'frame': \d+, 'object_id': \d+\}"):
        table_from_columns("boxes", twice)


def test_empty_table_is_a_table():
    empty = {name: [] for name in (field.name for field in TABLES["path_gains"].columns)}
    assert table_from_columns("path_gains", empty).num_rows == 0


def test_depth_image_round_trip():
    counts = np.random.default_rng(3).integers(0, 65536, (48, 64)).astype(np.uint16)
    counts[0, :3] = 0, 1, 65535
    back = decode_depth(encode_depth(counts))
    assert back.dtype == np.float32 and back.shape == (48, 64)
    np.testing.assert_array_equal(np.isinf(back), counts == 0)
    np.testing.assert_allclose(back[counts > 0], counts[counts > 0] * 0.01, rtol=1e-6)


@pytest.mark.parametrize("bad", [np.zeros(4, np.uint16), np.zeros((2, 2)), np.zeros((2, 2), np.int32)])
def test_bad_depth_is_refused(bad):
    with pytest.raises(ValueError, match="depth image"):
        encode_depth(bad)
