"""Hostile YAML: every text ends in a value or in one clear error, soon."""

from pathlib import Path

import pytest

from mmw.config import ConfigError, load_config
from mmw.config.yaml_file import read_yaml
from mmw.config.yaml_loader import MAX_DEPTH, MAX_VALUES, parse_yaml

BOMB = "a0: &a0 [0,1,2,3,4,5,6,7,8,9]\n" + "".join(
    f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 10)
)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: " + "[" * 100_000, ":1:"),
        ("{a: " * 50_000, ":1:"),
        ("a: " + "[" * 500 + "]" * 500, f"nested more than {MAX_DEPTH} deep"),
        ("\n".join(" " * k + "a:" for k in range(500)), f"nested more than {MAX_DEPTH} deep"),
        (BOMB, f"more than {MAX_VALUES:,} values"),
        ("a: [" + "1, " * 300_000 + "]", f"more than {MAX_VALUES:,} values"),
        ("a: &a [*a]", "`*a` stands inside what it repeats"),
        ("a: *nothing", "undefined alias"),
        ("a: !!int abc", ":1:4: not valid YAML: 'abc' is no whole number"),
        ("a: !!int ''", "'' is no whole number"),
        ("a: !!float abc", "'abc' is no number"),
        ("a: !!bool maybe", "'maybe' is no truth value"),
        ("a: " + "9" * 100_000, "has 100,000 characters; at most 400"),
        ("a: 0x" + "f" * 100_000, "has 100,002 characters; at most 400"),
        ("a: 1" + ":1" * 5_000, "at most 400"),
        ("a: !!timestamp x", "'!!timestamp' is not read"),
        ("a: !!python/object/apply:os.system [ls]", "is not read"),
        ("a: !!map [1, 2]", "something else follows"),
        ("? [1, 2]\n: 3", "a key is a list or a map"),
        ("a: 1\na: 2", "the key 'a' is given twice"),
        ("a: \x07", "control characters are not allowed"),
    ],
    ids=lambda text: text[:24].encode("unicode_escape").decode(),
)
def test_one_line_names_file_place_and_value(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "a.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        read_yaml(path, "a map")
    (line,) = caught.value.problems
    assert line.startswith(f"{path}:")
    assert words in line
    assert "\n" not in line
    assert len(line) < len(str(path)) + 300


def test_many_keys_take_little_time(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("".join(f"key_{k}: {k}\n" for k in range(90_000)))  # over a minute if each is held against all
    assert len(read_yaml(path, "a map")) == 90_000


def test_a_file_that_is_too_long(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("a: '" + "x" * 16_000_000 + "'")
    with pytest.raises(ConfigError, match="at most 16,000,000 are read"):
        read_yaml(path, "a map")


def test_within_the_limits_aliases_are_values() -> None:
    deep = "[" * (MAX_DEPTH - 1) + "]" * (MAX_DEPTH - 1)
    assert parse_yaml(f"a: {deep}")
    assert parse_yaml("a: &x {b: 1}\nc: [*x, *x]\nd: *x") == {"a": {"b": 1}, "c": [{"b": 1}] * 2, "d": {"b": 1}}
    assert parse_yaml("a: !!int 12\nb: !!float 3\nc: !!str 4\nd: !!bool true\ne: 28e9") == {
        "a": 12, "b": 3.0, "c": "4", "d": True, "e": 28e9
    }  # fmt: skip


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("frames.count=" + "[" * 3_000 + "]" * 3_000, "not valid YAML"),
        ("frames.count=&a [*a]", "`*a` stands inside"),
        ("frames.count=!!int abc", "is no whole number"),
        ("frames.count=" + "9" * 100_000, "at most 400"),
        ("a" + ".a" * 3_000 + "=1", "has 3001 parts; at most 100"),
        ("frames.count=\udcff", "is no UTF-8"),
        ("scenarios.²=1", "is a list of 1"),
        ("scenarios." + "9" * 5_000 + ".name=a", "is a list of 1"),
    ],
    ids=lambda text: text[:30],
)
def test_hostile_overrides(override: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_config("quickstart", [override])
    (line,) = caught.value.problems
    assert line.startswith("override ")
    assert words in line
    assert len(line) < 400
