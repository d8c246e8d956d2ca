"""Generated damage of a dataset: `mmw verify` finds each, whether markers and manifest agree with it or not."""

import shutil
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from mmw.cli.verify import check
from mmw.core.errors import InputError
from mmw.storage.identity import inputs_sha256
from mmw.storage.manifest import finalize
from mmw.storage.schemas import TABLES
from mmw.storage.shard_writer import table_path
from tests.fixtures.edit_files import agree, edit_json
from tests.fixtures.small_dataset import SCENARIO, copy_of, part, replace_column, rewrite, small_dataset

Damage = tuple[str, Callable[[Path], None]]
"""Its name, and the function that does it to a dataset folder."""


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of the small dataset that tests damage and restore."""
    return shutil.copytree(small_dataset(), tmp_path_factory.mktemp("corrupt") / "d")


def missed(root: Path, damages: Iterator[Damage]) -> tuple[int, list[str]]:
    """Do each damage, check the dataset and restore it; return how many there were, and those not found."""
    whole = {path: path.read_bytes() for path in root.rglob("*") if path.is_file()}
    count, found = 0, []
    for name, damage in damages:
        count += 1
        damage(root)
        with suppress(InputError):  # a head that cannot be read: one line, exit code 2
            if not any(finding.is_error for finding in check(root, 1)):
                found.append(name)
        for path in [path for path in root.rglob("*") if not path.is_dir() and path not in whole]:
            path.unlink()
        for path, data in whole.items():
            if not path.is_file() or path.read_bytes() != data:
                path.write_bytes(data)
    return count, found


def files(root: Path) -> list[str]:
    """Return one file of each table."""
    paths = [part(name) if TABLES[name].framed else table_path(name, SCENARIO).as_posix() for name in TABLES]
    return [path for path in paths if (root / path).is_file()]


def flipped(path: Path, share: float) -> None:
    data = bytearray(path.read_bytes())
    data[min(int(share * len(data)), len(data) - 1)] ^= 16
    path.write_bytes(data)


def on_bytes(root: Path) -> Iterator[Damage]:
    """Damage that a disk or a copy does: bytes flipped, files cut short or gone, files that are there twice."""
    others = ["_manifest.parquet", "dataset.json", "config.yaml", f"stages/{SCENARIO}.json", f"stages/{SCENARIO}.usdc"]
    assets = sorted(path.relative_to(root).as_posix() for path in (root / "assets").rglob("*") if path.is_file())
    for name in [*files(root), f"stages/{SCENARIO}.usdc", *assets[::4]]:
        for share in (0.0, 0.4, 1.0):
            yield f"flip {name} at {share}", lambda root, name=name, share=share: flipped(root / name, share)
    for name in [*files(root), *others, *assets[::8]]:
        yield f"cut {name}", lambda root, name=name: (root / name).write_bytes((root / name).read_bytes()[:-9])
        yield f"remove {name}", lambda root, name=name: (root / name).unlink()
    yield "remove README.md", lambda root: (root / "README.md").unlink()
    for name in files(root):
        again = name.replace("part-000000", "part-000007")
        yield f"copy {name}", lambda root, name=name, again=again: shutil.copy(root / name, root / again)
    yield (
        "another scenario",
        lambda root: shutil.copytree(root / "imu" / f"scenario={SCENARIO}", root / "imu" / "scenario=other"),
    )
    yield "another stage", lambda root: shutil.copy(root / f"stages/{SCENARIO}.usdc", root / "stages/other.usdc")


def without(root: Path, name: str) -> None:
    """Remove a file and its entry in the marker, and write the manifest."""
    (root / name).unlink()
    for marker in (root / "_shards").glob("*.json"):
        edit_json(marker, lambda content: content.update(files=[f for f in content["files"] if f["path"] != name]))
    finalize(root)


def shorter(root: Path, name: str) -> None:
    """Write a file without its last row, as a user's filter does, so that marker and manifest agree."""
    rows = pq.ParquetFile(root / name).read()
    pq.write_table(rows.slice(0, rows.num_rows - 1), root / name)
    agree(root, {name: rows.num_rows - 1})


def with_nan(root: Path, name: str, column: str) -> None:
    rewrite(root, name, lambda rows: replace_column(rows, column, lambda values: [float("nan"), *values[1:]]))


def on_rows(root: Path) -> Iterator[Damage]:
    """Damage with which marker and manifest agree: a table gone, a row gone, NaN in any column."""
    for name in files(root):
        table = pq.ParquetFile(root / name).read()
        yield f"without {name}", lambda root, name=name: without(root, name)
        if not table.num_rows:
            continue
        yield f"shorter {name}", lambda root, name=name: shorter(root, name)
        for field in table.schema:
            if pa.types.is_floating(field.type):
                yield (
                    f"NaN {name} {field.name}",
                    lambda root, name=name, column=field.name: with_nan(root, name, column),
                )


def swapped(root: Path, one: str, other: str) -> None:
    first, second = (root / "_shards" / f"{SCENARIO}.{name}.json" for name in (one, other))
    data = first.read_bytes()
    first.write_bytes(second.read_bytes())
    second.write_bytes(data)


def marked(root: Path, **values: object) -> None:
    edit_json(root / f"_shards/{SCENARIO}.sunny.000000.json", lambda content: content.update(values))
    finalize(root)


def manifest(root: Path, change: Callable[[pa.Table], pa.Table]) -> None:
    path = root / "_manifest.parquet"
    pq.write_table(change(pq.ParquetFile(path).read()), path)


def on_markers(root: Path) -> Iterator[Damage]:
    """Markers and a manifest that are not those of the files."""
    yield "weathers swapped", lambda root: swapped(root, "sunny.000000", "rainy.000000")
    yield "frames swapped", lambda root: swapped(root, "sunny.000000", "sunny.000002")
    for values in (
        {"scenario": "other"}, {"weather": "rainy"}, {"frame_begin": 1}, {"frame_end": 3}, {"config_sha256": "0" * 64},
        {"schema_version": "9.9"}, {"schema_version": "x"}, {"files": []}, {"files": None}, {"weather": None},
        {"mmw_version": 3}, {"seconds": True}, {"frame_end": 2**31}, {"frame_begin": 2**31}, {"frame_begin": -1},
        {"files": [{"table": "../../x", "path": "../../x", "rows": 1, "bytes": 1, "sha256": ""}]},
    ):  # fmt: skip
        yield f"marker {values}", lambda root, values=values: marked(root, **values)
    marker = f"_shards/{SCENARIO}.sunny.000000.json"
    for text in ("", "{", "[]", "null", "[" * 100_000, '{"a":' * 50_000):
        yield f"marker {text[:9]}", lambda root, text=text: (root / marker).write_text(text)
    yield "marker removed", lambda root: (root / marker).unlink()
    yield "marker copied", lambda root: shutil.copy(root / marker, root / "_shards/more.json")
    yield "manifest row removed", lambda root: manifest(root, lambda rows: rows.slice(1))
    yield "manifest doubled", lambda root: manifest(root, lambda rows: pa.concat_tables([rows, rows]))
    for column, change in (
        ("rows", lambda values: [values[0] + 1, *values[1:]]),
        ("scenario", lambda values: ["other", *values[1:]]),
        ("sha256", lambda values: ["0", *values[1:]]),
    ):
        yield (
            f"manifest {column}",
            lambda root, column=column, change=change: manifest(
                root, lambda rows: replace_column(rows, column, change)
            ),
        )
    yield "manifest empty", lambda root: (root / "_manifest.parquet").write_bytes(b"")


def head(root: Path, change: Callable[[dict], object]) -> None:
    edit_json(root / "dataset.json", change)


def note(root: Path, inputs: dict[str, str]) -> None:
    edit_json(root / f"stages/{SCENARIO}.json", lambda content: content.update(inputs=inputs))


def actors(root: Path, change: Callable[[dict], object]) -> None:
    edit_json(root / f"_shards/{SCENARIO}.json", lambda content: change(content["actors"]))


def on_identity(root: Path) -> Iterator[Damage]:
    """Damage of recorded inputs, versions and actors: they are not those of the shards."""
    other = {SCENARIO: {"drive.csv": "0" * 64}}
    for values in (
        {"inputs_sha256": "0" * 64}, {"inputs_sha256": None}, {"software": "mmw 9.9, code 0"}, {"software": None},
        {"software": "mmw 9.9", "accepted": "versions"}, {"mmw_version": "9.9"}, {"git_sha": "0"},
        {"device": "Some CPU"}, {"device": "Some CPU", "accepted": "versions"},
    ):  # fmt: skip
        yield f"marker {values}", lambda root, values=values: marked(root, **values)
    yield "inputs added", lambda root: head(root, lambda content: content.update(inputs=other))
    yield (
        "inputs replaced",
        lambda root: head(root, lambda content: content.update(inputs=other, inputs_sha256=inputs_sha256(other))),
    )
    for inputs in (None, [], {"a": 1}, {"a": {"b": 1}}):
        yield f"inputs {inputs}", lambda root, inputs=inputs: head(root, lambda content: content.update(inputs=inputs))
    yield "inputs without hash", lambda root: head(root, lambda content: content.pop("inputs_sha256"))
    yield "software replaced", lambda root: head(root, lambda content: content["versions"].update(software="mmw 9.9"))
    yield "device replaced", lambda root: head(root, lambda content: content["versions"].update(device="Some CPU"))
    yield "stage of other inputs", lambda root: note(root, other[SCENARIO])
    yield "no actors", lambda root: edit_json(root / f"_shards/{SCENARIO}.json", lambda content: content.pop("actors"))
    yield "no CAV", lambda root: actors(root, lambda found: found.pop("cav_1"))
    yield "no RSU", lambda root: actors(root, lambda found: found.pop("rsu_1"))
    for values in (None, {}, {"role": "cav"}, {"role": "x", "frames": [[0, 4]]}, {"role": "cav", "frames": [[0, 9]]}):
        yield f"actor {values}", lambda root, values=values: actors(root, lambda found: found.update(cav_1=values))


@pytest.mark.parametrize(("column", "role", "count"), [("cav_count", "cav", 3), ("rsu_count", "rsu", 1)])
def test_agents_are_missed_where_their_count_went_with_their_rows(
    tmp_path: Path, column: str, role: str, count: int
) -> None:
    """The expectation comes from the stage and the configuration: no table of a shard has a row of them any more."""
    root = copy_of(small_dataset(), tmp_path / "d")
    poses = pq.ParquetFile(root / part("poses")).read().to_pylist()
    agents = {row["agent"] for row in poses if row["role"] == role}
    for table in [name.split("/")[0] for name in files(root)]:
        path = part(table)
        if TABLES[table].framed:
            rewrite(root, path, lambda rows: without_agents(rows, agents))
    rewrite(root, part("frames"), lambda rows: replace_column(rows, column, lambda values: [0] * len(values)))
    (found,) = [one.text for one in check(root, 1) if one.path == part("frames")]
    assert found == f"{column} of frame 0 is 0; the scenario has {count}"


def without_agents(rows: pa.Table, agents: set[str]) -> pa.Table:
    for key in {"agent", "peer"} & set(rows.column_names):
        rows = rows.filter(pa.array([value not in agents for value in rows.column(key).to_pylist()], pa.bool_()))
    return rows


@pytest.mark.parametrize(
    ("damages", "least"),
    [
        pytest.param(on_bytes, 150, marks=pytest.mark.slow),
        pytest.param(on_rows, 130, marks=pytest.mark.slow),
        pytest.param(on_identity, 25, marks=pytest.mark.slow),
        (on_markers, 25),
    ],
)
def test_every_generated_damage_is_found(root: Path, damages: Callable[[Path], Iterator[Damage]], least: int) -> None:
    assert check(root, 1) == []
    count, found = missed(root, damages(root))
    assert found == [] and count >= least
    assert check(root, 1) == []
