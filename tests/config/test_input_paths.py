"""Every path of a configuration is found by one function."""

from pathlib import Path
from typing import Any

import pytest
from pydantic import Field

from mmw.config import Config, load_config
from mmw.config.include import include_scenarios
from mmw.config.input_paths import input_places
from mmw.config.section import InputPath, Section
from mmw.config.sensor_spec import SENSORS
from mmw.config.validation_errors import models_in

SCENARIO = {
    "name": "a", "town": "towns/mine.usda",
    "traffic": {"engine": "replay", "trajectories": "t.csv", "options": {"model": "x.json", "deep": ["y"], "n": 1}},
}  # fmt: skip


def places(data: dict[str, Any], section: type = Config) -> dict[str, str]:
    return {f"{place}{'' if place.is_declared else ' ?'}": place.value for place in input_places(data, section)}


def test_paths_of_scenarios_are_found() -> None:
    assert places({"scenarios": [SCENARIO, {"name": "b", "stage": "s.usda"}, {"name": "c", "town": "town03"}]}) == {
        "scenarios.0.town": "towns/mine.usda",
        "scenarios.0.traffic.trajectories": "t.csv",
        "scenarios.0.traffic.options.model ?": "x.json",
        "scenarios.0.traffic.options.deep.0 ?": "y",
        "scenarios.1.stage": "s.usda",
    }


class Pattern(Section):
    """A section of a sensor of another package."""

    file: InputPath = Field(description="a table (path)")


class Antenna(Section):
    """A sensor of another package."""

    plain: Path
    one: InputPath | None = None
    many: tuple[InputPath, ...] = ()
    by_role: dict[str, Pattern] = Field(default_factory=dict)
    text: str = ""


def test_paths_of_any_shape_are_found() -> None:
    data = {"plain": "p", "one": "o", "many": ["m", "n"], "by_role": {"cav": {"file": "f"}}, "text": "no path"}
    assert places(data, Antenna) == {
        "plain": "p", "one": "o", "many.0": "m", "many.1": "n", "by_role.cav.file": "f",
    }  # fmt: skip


@pytest.mark.parametrize(
    "data",
    [{}, {"scenarios": None}, {"scenarios": "x"}, {"scenarios": [1, None, []]}, {"scenarios": [{"traffic": "x"}]},
     {"sensors": [{}, 1, {"type": []}, {"type": "none"}]}, {"scenarios": [{"stage": 5, "traffic": {"options": 1}}]}],
)  # fmt: skip
def test_content_of_the_wrong_shape_has_no_paths(data: dict[str, Any]) -> None:
    assert places(data) == {}


def test_no_field_is_forgotten() -> None:
    """Fields whose unit is a path are declared as one, but those of the output, which a run writes."""
    seen: set[type] = set()
    written: set[str] = set()

    def visit(section: type[Section]) -> None:
        if section in seen:
            return
        seen.add(section)
        for name, field in section.model_fields.items():
            if (field.description or "").rstrip().endswith("path)"):
                written.add(name)
                found = places({name: "x.usda"}, section)
                assert found == {name: "x.usda"} or section.__name__ == "OutputConfig", f"{section.__name__}.{name}"
            for inner in models_in(section, name):
                visit(inner)

    visit(Config)
    for kind in SENSORS:
        visit(SENSORS[kind].config)
    assert written == {"town", "stage", "trajectories", "dir", "staging"}


def test_paths_of_an_included_file_start_from_its_folder(tmp_path: Path) -> None:
    inner = {"scenarios": [SCENARIO, {"name": "b", "stage": "/abs/s.usda"}, {"name": "c", "town": "town03"}]}
    data = include_scenarios({"scenarios": ["below/inner.yaml"]}, tmp_path, lambda path: inner)
    first, second, third = data["scenarios"]
    assert (first["town"], first["traffic"]["trajectories"]) == ("below/towns/mine.usda", "below/t.csv")
    assert (second["stage"], third["town"]) == ("/abs/s.usda", "town03")
    assert first["traffic"]["options"] == SCENARIO["traffic"]["options"]
    assert inner["scenarios"][0]["town"] == "towns/mine.usda"


def test_shipped_configurations_have_no_input_files() -> None:
    assert places(load_config("full").model_dump(mode="json")) == {}
