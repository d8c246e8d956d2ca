"""Names that a hostile dataset brings: exports, reports and views write nothing outside their folder."""

import json
import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from urllib.parse import quote

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from mmw.__main__ import main
from mmw.core.errors import InputError
from mmw.core.file_names import check_file_name, is_file_name, path_inside
from mmw.dataset.export.registry import EXPORTERS
from tests.fixtures.edit_files import edit_json
from tests.fixtures.small_dataset import SCENARIO, copy_of, small_dataset

NAMES = {
    "parents": "../../../x",
    "absolute": "/tmp/mmw-hostile/x",
    "slash": "a/b",
    "up": "..",
    "empty": "",
    "nul": "a\0b",
    "long": "n" * 5000,
    "markup": "<script>alert(1)</script>",
    "lines": "a\nmmw: all is well\x1b[2J",
    "math": "a$\\nofont$\\{",
    "backslash": "..\\..\\x",
}
SLOW = ("up", "empty", "nul", "long", "backslash", "math")
"""Names that `test_one_function_says_it` checks alone where slow tests are left out."""
FOLDERS = ("scenario", "weather")
"""Names that are read from folders."""
NO_FOLDER = ("empty", "nul", "long")
"""Names that no folder can have."""
OPTIONS = {
    "deepmimo": ["scene=off", "frames=0:1"],
    "huggingface": ["frames=0:1"],
    "kitti": ["rate=50"],
    "mcap": ["frames=0:1"],
    "nuscenes": ["rate=50", "sweeps=50"],
    "opv2v": ["rate=50"],
    "v1": ["frames=0:1"],
}
OLD = {
    "agent": "cav_1",
    "peer": "cav_1",
    "sensor": "front",
    "scenario": SCENARIO,
    "weather": "sunny",
    "category": "car",
}
"""Column -> the name that is replaced."""


def rename(root: Path, kind: str, new: str) -> None:
    """Give a name of the dataset another text, in the rows, folders and markers."""
    columns = (
        ("agent", "peer", "actor") if kind == "agent" else ("category", "label") if kind == "category" else (kind,)
    )
    for file in sorted(root.glob("*/**/part-*.parquet")):
        rows = pq.ParquetFile(file).read()
        named = [field.name for field in rows.schema if pa.types.is_dictionary(field.type)]
        for name in set(columns) & set(named):
            texts = [new if text == OLD[kind] else text for text in rows.column(name).to_pylist()]
            field = rows.schema.field(name)
            rows = rows.set_column(rows.column_names.index(name), field, pa.array(texts, pa.string()).cast(field.type))
        pq.write_table(rows, file)
    if kind in ("scenario", "weather") and len(new) < 100 and new:
        folder = quote(new, safe="")
        for path in sorted(root.glob(f"*/**/{kind}={OLD[kind]}")):
            path.rename(path.with_name(f"{kind}={folder}"))
        for marker in sorted((root / "_shards").glob("*.json")):
            text = marker.read_text().replace(f"{kind}={OLD[kind]}/", f"{kind}={folder}/")
            marker.write_text(text.replace(f'"{kind}": "{OLD[kind]}"', f'"{kind}": {json.dumps(new)}'))
            marker.rename(marker.with_name(re.sub(rf"\b{OLD[kind]}\b", lambda _: folder, marker.name)))


def everything(folder: Path) -> set[str]:
    return {os.fspath(path) for path in folder.rglob("*")}


def guarded(place: Path, work: Callable[[], int]) -> int:
    """Do some work that may only write below `place/deep/er/out*`, and return its exit code."""
    before = everything(place), everything(Path("/tmp/mmw-hostile")), set(Path("/").iterdir())
    code = work()
    new = {path for path in everything(place) - before[0] if not path.startswith(f"{place}/deep/er/out")}
    assert not new and everything(Path("/tmp/mmw-hostile")) == before[1] and set(Path("/").iterdir()) == before[2]
    return code


@pytest.fixture
def place(tmp_path: Path) -> Path:
    (tmp_path / "deep" / "er").mkdir(parents=True)
    copy_of(small_dataset(), tmp_path / "d")
    return tmp_path


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        pytest.param(kind, name, marks=pytest.mark.slow if name in SLOW else ())
        for kind in ("agent", "sensor", "scenario", "weather")
        for name in NAMES
        if kind not in FOLDERS or name not in NO_FOLDER
    ],
)
def test_no_export_writes_outside(place: Path, kind: str, name: str, capsys: pytest.CaptureFixture) -> None:
    rename(place / "d", kind, NAMES[name])
    for form in EXPORTERS:
        out = place / "deep" / "er" / f"out_{form}"
        code = guarded(place, lambda: main(["export", form, str(place / "d"), str(out), *OPTIONS.get(form, [])]))  # noqa: B023
        captured = capsys.readouterr()
        lines = [line for line in captured.err.splitlines() if line.startswith("mmw")]
        assert "internal error" not in captured.err and "Traceback" not in captured.err, form
        if code == 0:  # a format that carries no such sensor has files of plain names
            assert kind == "sensor"
            assert all(is_file_name(path.name.lstrip("."), 255) or path == out for path in out.rglob("*")), form
        else:
            assert code == 2 and len(lines) == 1 and f"{kind} " in lines[0] and lines[0].isprintable(), (form, lines)


@pytest.mark.parametrize("name", ["parents", "markup", "lines", "nul"])
def test_names_of_classes_are_content(place: Path, name: str, capsys: pytest.CaptureFixture) -> None:
    rename(place / "d", "category", NAMES[name])
    for form in EXPORTERS:
        out = place / "deep" / "er" / f"out_{form}"
        words = ["export", form, str(place / "d"), str(out), *OPTIONS.get(form, [])]
        assert guarded(place, lambda: main(words)) == 0, capsys.readouterr().err  # noqa: B023


@pytest.mark.parametrize("town", ["../../../../../x", "/tmp/mmw-hostile/..", "a\nb"])
def test_the_town_of_the_configuration_names_a_folder(place: Path, town: str, capsys: pytest.CaptureFixture) -> None:
    edit_json(place / "d" / "dataset.json", lambda head: head["config"]["scenarios"][0].update(town=town))
    out = place / "deep" / "er" / "out"
    code = guarded(place, lambda: main(["export", "v1", str(place / "d"), str(out)]))
    assert code in (0, 2) and "internal error" not in capsys.readouterr().err


@pytest.mark.filterwarnings("ignore:Glyph:UserWarning")  # the font has no picture of a control character
@pytest.mark.parametrize("kinds", [("agent", "sensor", "category"), ("scenario", "weather")], ids=["rows", "folders"])
@pytest.mark.parametrize(
    "name", ["markup", *(pytest.param(name, marks=pytest.mark.slow) for name in ("parents", "lines", "math"))]
)
def test_reports_and_views(place: Path, kinds: tuple[str, ...], name: str, capsys: pytest.CaptureFixture) -> None:
    for kind in kinds:
        rename(place / "d", kind, NAMES[name])
    report, view = place / "deep" / "er" / "out.html", place / "deep" / "er" / "out.rrd"
    for words in (["report", str(place / "d"), "--out", str(report)],
                  ["view", str(place / "d"), "--save", str(view), "--no-town"]):  # fmt: skip
        code = guarded(place, lambda: main(words))  # noqa: B023
        captured = capsys.readouterr()
        assert code in (0, 2), captured.err
        assert "internal error" not in captured.err and "Traceback" not in captured.err
        assert all(line.isprintable() for line in captured.err.splitlines())
        if code == 2:
            assert sum(line.startswith("mmw: ") for line in captured.err.splitlines()) >= 1
    if report.is_file():
        assert "<script" not in report.read_text().lower()


@pytest.mark.parametrize("name", NAMES)
def test_one_function_says_it(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^d: agent .* cannot be the name of a file") as error:
        check_file_name(NAMES[name], "agent", "d")
    assert str(error.value).isprintable() and len(str(error.value)) < 300
    assert check_file_name("cav_1", "agent", "d") == "cav_1"
    if name in ("parents", "absolute", "up", "empty", "nul"):
        with pytest.raises(InputError, match="leads out of the folder"):
            path_inside(tmp_path, NAMES[name])
    assert path_inside(tmp_path, "a/b.json") == tmp_path / "a" / "b.json"


def test_an_own_town_is_named_by_its_file(place: Path) -> None:
    edit_json(place / "d" / "dataset.json", lambda head: head["config"]["scenarios"][0].update(town="../mine/my.usda"))
    out = place / "deep" / "er" / "out"
    assert main(["export", "v1", str(place / "d"), str(out)]) == 0
    assert sorted(path.name for path in (out / "sunny").iterdir()) == ["My"]
    shutil.rmtree(out)
