"""Tables that are the same in every weather: the first weather's shard has them, whatever is traced again."""

import json
from pathlib import Path

import pytest

from mmw.cli.run import main
from mmw.cli.verify import check
from mmw.core.resources import configs_dir
from tests.fixtures.small_dataset import SCENARIO, SMALL, copy_of, part, small_dataset

GEOMETRY = [part("path_geometry", frame=frame) for frame in (0, 2)]


def tables_of(root: Path) -> dict[str, bytes]:
    return {path.relative_to(root).as_posix(): path.read_bytes() for path in root.rglob("part-*.parquet")}


def listed(root: Path, weather: str) -> set[str]:
    """Return the files without a weather that the markers of a weather list."""
    markers = [json.loads(path.read_text()) for path in (root / "_shards").glob(f"{SCENARIO}.{weather}.*.json")]
    assert len(markers) == 2
    return {file["path"] for marker in markers for file in marker["files"] if "weather=" not in file["path"]}


def test_the_first_weather_has_the_geometry() -> None:
    assert listed(small_dataset(), "sunny") == set(GEOMETRY) and listed(small_dataset(), "rainy") == set()


@pytest.mark.slow
@pytest.mark.parametrize("weather", ["sunny", "rainy"])
def test_a_resume_traces_one_weather(tmp_path: Path, weather: str) -> None:
    """The other weather's shards stay; those that are made again, and the geometry, are the same bytes."""
    root = copy_of(small_dataset(), tmp_path / "d")
    before = tables_of(root)
    for path in (root / "_shards").glob(f"{SCENARIO}.{weather}.*.json"):
        path.unlink()
    for name in GEOMETRY if weather == "sunny" else ():
        (root / name).unlink()
    code = main(["--config", str(configs_dir() / "quickstart.yaml"), *SMALL, "--out", str(root), "--device", "cpu"])
    assert code == 0
    assert tables_of(root) == before
    assert listed(root, "sunny") == set(GEOMETRY) and listed(root, "rainy") == set()
    assert check(root, 1) == []
