"""A stage is held against the limits once, and again when one of its files has changed."""

from pathlib import Path

import pytest

from mmw.core.errors import InputError
from mmw.usd import stage_size
from mmw.usd.stage_size import check_size

ONE = '#usda 1.0\n(defaultPrim = "A")\ndef "A" (references = @b.usda@) {}\n'
FLAT = '#usda 1.0\n(defaultPrim = "B")\ndef "B" {}\n'
DEEP = FLAT + 'def "a" {\n' * 201 + "}\n" * 201


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Return a list that gets the path of each stage whose prims are counted."""
    found: list[Path] = []
    count = stage_size._Count
    monkeypatch.setattr(stage_size, "_Count", lambda path: found.append(path) or count(path))
    return found


def test_an_unchanged_stage_is_counted_once(tmp_path: Path, counted: list[Path]) -> None:
    stage = tmp_path / "a.usda"
    stage.write_text(ONE)
    (tmp_path / "b.usda").write_text(FLAT)
    check_size(stage)
    check_size(stage)
    assert counted == [stage]


def test_a_changed_layer_below_it_is_counted_again(tmp_path: Path, counted: list[Path]) -> None:
    stage = tmp_path / "a.usda"
    stage.write_text(ONE)
    (tmp_path / "b.usda").write_text(FLAT)
    check_size(stage)
    (tmp_path / "b.usda").write_text(DEEP)
    for _ in range(2):
        with pytest.raises(InputError, match="nested more than 200 deep"):
            check_size(stage)
    (tmp_path / "b.usda").write_text(FLAT)
    check_size(stage)
    assert len(counted) == 4


def test_a_stage_with_a_missing_layer_is_counted_until_it_is_there(tmp_path: Path, counted: list[Path]) -> None:
    stage = tmp_path / "a.usda"
    stage.write_text(ONE)
    check_size(stage)
    (tmp_path / "b.usda").write_text(DEEP)
    with pytest.raises(InputError, match="nested more than 200 deep"):
        check_size(stage)
    assert len(counted) == 2
