"""`model:` and `label:` keys of sensors name models and classes that exist."""

from pathlib import Path
from typing import Any

import pytest

from mmw.config import ConfigError, load_config
from mmw.generation.agent_key_checks import unknown_agent_keys
from mmw.generation.estimate import check_inputs


@pytest.mark.parametrize(
    ("sensor", "message"),
    [
        ("{type: imu, on: ['model:city_buss']}", "no such model; did you mean `model:city_bus`?"),
        ("{type: imu, mount: {'label:buss': {}}}", "sensors[0].mount names 'label:buss', and there is no such class"),
        ("{type: imu, on: ['model:zzz']}", "there are box_truck, city_bus, "),
        ("{type: imu, on: ['model:woman', 'label:dynamic']}", None),
    ],
)  # fmt: skip
def test_unknown_names_have_a_cure(sensor: str, message: Any) -> None:
    config = load_config("quickstart", [f"sensors=[{sensor}]"])
    found = list(unknown_agent_keys(config, Path()))
    assert not found if message is None else len(found) == 1 and message in found[0]


def test_models_of_a_stage_count(tmp_path: Path) -> None:
    (tmp_path / "own.usda").write_text(
        '#usda 1.0\ndef Cube "Robot"\n{\n    token mmw:actor:role = "cav"\n    string mmw:actor:model = "mule"\n}\n'
    )
    changes = ["scenarios=[{name: own, stage: own.usda}]", "sensors=[{type: imu, on: ['model:mule', 'model:sedan']}]"]
    (line,) = unknown_agent_keys(load_config("quickstart", changes), tmp_path)
    assert "'model:sedan'" in line and "there are mule" in line


def test_a_stage_that_cannot_be_read_is_the_one_problem(tmp_path: Path) -> None:
    changes = ["scenarios=[{name: own, stage: own.usda}]", "sensors=[{type: imu, on: ['model:mule']}]"]
    for content in ("", "#usda 1.0\ndef Cube {"):
        (tmp_path / "own.usda").write_text(content)
        with pytest.raises(ConfigError) as error:
            check_inputs(load_config("quickstart", changes), tmp_path)
        assert "own.usda" in str(error.value) and "model:mule" not in str(error.value)
