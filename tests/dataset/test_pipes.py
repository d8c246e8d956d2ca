"""Pipes in the place of files: every reader says so; one that opens a pipe waits for a writer that never comes."""

import os
import re
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

import mmw
from mmw.__main__ import main
from mmw.core.errors import InputError
from mmw.dataset.export.registry import EXPORTERS
from tests.fixtures.edit_files import edit_json
from tests.fixtures.small_dataset import SCENARIO, copy_of, part, small_dataset

LIMIT_S = 60


@pytest.fixture
def root(tmp_path: Path) -> Iterator[Path]:
    """Dataset; what waits in the test is interrupted."""

    def stop(*_: object) -> None:
        raise TimeoutError("it waits for a pipe")

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(LIMIT_S)
    yield copy_of(small_dataset(), tmp_path / "d")
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def make_pipe(path: Path) -> None:
    path.unlink()
    os.mkfifo(path)


@pytest.mark.parametrize("link", [False, True])
def test_a_table_is_not_read(root: Path, link: bool) -> None:
    make_pipe(root / part("poses"))
    if link:
        (root / part("poses")).rename(root / "pipe")
        (root / part("poses")).symlink_to(root / "pipe")
    with pytest.raises(InputError, match=r"part-000000\.parquet: is no file but"):
        mmw.open(root).read("poses")
    with pytest.raises(InputError, match="is no file but"):
        mmw.connect(root).sql("SELECT * FROM poses").fetchall()


@pytest.mark.parametrize("name", sorted(EXPORTERS))
def test_no_export_waits(root: Path, tmp_path: Path, capsys: pytest.CaptureFixture, name: str) -> None:
    for table in ("links", "poses", "lidar"):
        make_pipe(root / part(table))
    assert main(["export", name, str(root), str(tmp_path / "out")]) == 2
    assert re.search(r"part-000000\.parquet: is (no file but|missing)", capsys.readouterr().err)


def test_no_command_waits_for_the_configuration(root: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    make_pipe(root / "config.yaml")
    assert main(["report", str(root), "--out", str(tmp_path / "report.html")]) == 0
    assert "has no config.yaml" in (tmp_path / "report.html").read_text()
    assert main(["verify", str(root)]) == 1
    assert main(["render", str(root), "--out", str(tmp_path / "pictures"), "--scenario", SCENARIO]) != 0
    told = capsys.readouterr()
    assert "Traceback" not in told.out + told.err


def test_a_report_tells_hashes_of_another_shape(root: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    for values in ({"packages": ["numpy"]}, {"sources": {"town": 3}}):
        edit_json(root / "dataset.json", lambda head, values=values: head["versions"].update(values))
        assert main(["report", str(root), "--out", str(tmp_path / "report.html")]) == 2
        assert "versions cannot be understood" in capsys.readouterr().err
