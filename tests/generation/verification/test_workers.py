"""Several processes find what one finds, and the death of one is told."""

import os
from collections.abc import Iterator, Mapping
from pathlib import Path

import pyarrow as pa
import pytest

from mmw.cli.verify import check
from mmw.core.errors import InputError
from mmw.generation.verification import workers
from mmw.generation.verification.completeness import read_plan
from mmw.generation.verification.planned_rows import PlannedRows
from mmw.storage.finding import Finding
from mmw.storage.manifest import finalize, read_markers
from mmw.storage.row_checks import Chunk
from mmw.storage.store import Store
from tests.fixtures.edit_files import edit_bytes
from tests.fixtures.small_dataset import copy_of, one_scene, part, replace_column, rewrite, small_dataset

__all__ = ["one_scene"]


@pytest.fixture
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(workers, "MIN_SHARDS", 1)
    return copy_of(small_dataset(), tmp_path / "d")


def test_a_sound_dataset_has_no_finding(root: Path) -> None:
    assert check(root, 1, workers=2) == []


def test_the_findings_are_those_of_one_process(root: Path) -> None:
    edit_bytes(root / part("lidar", "rainy"), lambda data: data[:-9] + bytes(9))
    rewrite(root, part("boxes", "sunny"), lambda rows: rows.slice(1))
    rewrite(root, part("poses", "rainy", 2), lambda rows: replace_column(rows, "x", lambda values: values[::-1]))
    static = next(root.glob("sensors/*/*.parquet")).relative_to(root).as_posix()
    rewrite(root, static, lambda rows: rows.slice(1))  # a row that shards in other processes need
    finalize(root)
    found = check(root, 1)
    assert {finding.path.partition("/")[0] for finding in found} >= {"lidar", "boxes", "sensors"}
    assert sorted(map(str, check(root, 1, workers=3))) == sorted(map(str, found))


class Killed(PlannedRows):
    """Ends the process that counts rows."""

    def __call__(self, chunk: Chunk, tables: Mapping[str, pa.Table]) -> Iterator[Finding]:
        os._exit(9)


def test_a_process_that_is_killed_is_told(root: Path) -> None:
    store = Store(root)
    config, _ = read_plan(store)
    assert config is not None
    with pytest.raises(InputError, match=r"was killed.*--workers 1"):
        list(workers.check_files(store, read_markers(store), Killed(store, config), 2))
