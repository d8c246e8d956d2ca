"""Sweeps: the datasets that a file describes, their names, and one clear line for a mistake."""

import json
from typing import Any

import pytest

from mmw.config import ConfigError, load_config
from mmw.config.load import load_sweep

COUNT = "scenarios.*.traffic.vehicle_count"


def members(sweep: Any, *changes: str) -> tuple:
    return load_sweep("quickstart", [*changes, f"sweep={json.dumps(sweep)}"])


def test_a_grid_makes_every_combination_and_the_last_key_is_fastest() -> None:
    found = members({"grid": {"seed": [1, 2], COUNT: [10, 30]}}, "output.dir=out/s")
    names = [f"seed-{seed},vehicle_count-{count}" for seed in (1, 2) for count in (10, 30)]
    assert [member.name for member in found] == names
    assert [member.config.output.dir for member in found] == [f"out/s/{name}" for name in names]
    assert [(one.config.seed, one.config.scenarios[0].traffic.vehicle_count) for one in found] == [
        (1, 10), (1, 30), (2, 10), (2, 30)
    ]  # fmt: skip
    assert found[1].values == {"seed": 1, COUNT: 30}
    assert found[1].record == {"name": names[1], "folder": names[1], "seed": 1, "vehicle_count": 30}


def test_a_dataset_is_that_of_a_configuration_with_its_values() -> None:
    found = members({"grid": {"seed": [7], COUNT: [12]}})[0].config
    alone = load_config("quickstart", ["seed=7", f"{COUNT}=12"])
    assert (found.sha256(), found.sweep) == (alone.sha256(), None)
    assert load_config("quickstart").sha256() == load_config("quickstart", ["sweep={grid: {seed: [1]}}"]).sha256()


def test_a_list_names_its_datasets_and_multiplies_with_a_grid() -> None:
    entries = [{"name": "dense", COUNT: 30}, {"seed": 3, COUNT: 10}]
    assert [one.name for one in members({"list": entries})] == ["dense", "seed-3,vehicle_count-10"]
    both = members({"list": entries, "grid": {"weathers": [["sunny"], ["rainy", "foggy"]]}})
    assert [one.name for one in both][:2] == ["dense,weathers-sunny", "dense,weathers-rainy+foggy"]
    assert both[3].config.weathers == ("rainy", "foggy") and len(both) == 4
    assert both[3].columns == {"seed": 3, "vehicle_count": 10, "weathers": "rainy+foggy"}


@pytest.mark.parametrize(
    ("key", "values", "names"),
    [
        ("channel.carriers_hz", [[28e9], [4.9e9, 28e9]], ["carriers_hz-28e9", "carriers_hz-4.9e9+28e9"]),
        ("seed", [20261126], ["seed-20261126"]),
        ("channel.enabled", [True, False], ["enabled-true", "enabled-false"]),
        ("sensors.lidar.range_m", [50, 80.5], ["range_m-50", "range_m-80.5"]),
        ("scenarios.0.rsus.0.yaw_deg", [-90], ["yaw_deg--90"]),
        ("scenarios.0.rsus.0.position_m", {"gate": [1, 2, 0], "up": [4, 5, 0]}, ["position_m-gate", "position_m-up"]),
        ("scenarios.0.rsus.0.position_m.0", [3], ["position_m.0-3"]),
        ("scenarios.0.town", ["town05"], ["town-town05"]),
    ],
)  # fmt: skip
def test_names_are_short(key: str, values: Any, names: list[str]) -> None:
    assert [one.name for one in members({"grid": {key: values}})] == names


def test_keys_that_end_alike_have_longer_names() -> None:
    found = members({"grid": {"sensors.lidar.range_m": [50], "sensors.radar.range_m": [60], "scenarios.0.name": ["a"]}})
    assert found[0].name == "lidar.range_m-50,radar.range_m-60,scenarios.0.name-a"
    assert list(found[0].record) == ["name", "folder", "lidar.range_m", "radar.range_m", "scenarios.0.name"]


def test_an_address_keeps_its_options() -> None:
    found = members({"grid": {"seed": [1]}}, "output.dir=s3://bucket/all?region=x")
    assert found[0].config.output.dir == "s3://bucket/all/seed-1?region=x"


@pytest.mark.parametrize(
    ("sweep", "told"),
    [
        ({}, "has neither `grid` nor `list`"),
        ({"gird": {}}, "unknown key; did you mean `grid`?"),
        ({"grid": {"seed": []}}, "grid: seed is an empty list, which makes no dataset"),
        ({"grid": {"seed": 3}}, "grid: seed = 3 is one value; give a list"),
        ({"grid": {"seed": [1, 1]}}, "two datasets are called 'seed-1'"),
        ({"list": [{"name": "a", "seed": 1}, {"name": "A", "seed": 2}]}, "two datasets are called 'A'"),
        ({"grid": {"seed": list(range(10_000))}}, "makes 10,000 datasets; at most 1,000 are made"),
        ({"grid": {"seed": list(range(100)), COUNT: list(range(100))}}, "makes 10,000 datasets"),
        ({"grid": {"sed": [1, 2]}}, "dataset 'sed-1': sed = 1: unknown key; did you mean `seed`?"),
        ({"grid": {"sensors.lidar.rnge_m": [1, 2]}}, "unknown key; did you mean `range_m`?"),
        ({"grid": {"sensors.lidr.range_m": [1]}}, "sensors is a list of"),
        ({"grid": {"traffic.vehicle_count": [1]}}, "is a key of scenarios; write scenarios.*.traffic.vehicle_count"),
        ({"grid": {"seed": ["x", "y"]}}, "dataset 'seed-x': seed = \"x\": a whole number is needed"),
        ({"grid": {"air": [{"sunny": {}}]}}, "makes no name; write `grid` as {air: {NAME: VALUE}}"),
        ({"grid": {"output.dir": ["a"]}}, "'output.dir' cannot differ"),
        ({"grid": {"seed": [1]}, "list": [{"seed": 2}]}, "'seed' is in `grid` and in `list`"),
        ({"list": [{"name": "a"}]}, "list: entry 0 changes no key"),
        ({"list": [{"name": "../a", "seed": 1}]}, "is no name of a folder"),
    ],
)
def test_a_mistake_is_one_line(sweep: Any, told: str) -> None:
    with pytest.raises(ConfigError) as caught:
        members(sweep)
    assert told in str(caught.value) and len(caught.value.problems) == 1
