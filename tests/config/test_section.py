"""Configurations made of objects: what a file gives, and each problem of one in a line, without pydantic's trace."""

import pickle
import traceback
from pathlib import Path
from typing import Literal

import pytest
from pydantic import Field

import mmw.config
from mmw.config import Config, ConfigError, FramesConfig, RsuConfig, ScenarioConfig, TrafficConfig, load_config
from mmw.config.section import Section
from mmw.core.resources import shipped_configs
from mmw.sensors import Lidar, RgbCamera, SensorConfig
from tests.fixtures.own_world import DATA
from tests.fixtures.plugin_sensor import Thermometer, thermometer

TRAFFIC = TrafficConfig(vehicle_count=4, spawn_center_m=[0, 0, 0], cav_ranks=[0])
TOWN = ScenarioConfig(name="s", town="town03", traffic=TRAFFIC, rsus=[RsuConfig(position_m=[1, 2, 3])])


def test_a_configuration_of_sections_is_that_of_a_file(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(
        "scenarios: [{name: s, town: town03, traffic: {vehicle_count: 4, spawn_center_m: [0, 0, 0], cav_ranks: [0]}, "
        "rsus: [{position_m: [1, 2, 3]}]}]\n"
        "sensors: [{type: lidar, range_m: 80}, {type: rgb, name: front}]\nframes: {count: 5}\n"
    )
    lidar = Lidar(range_m=80)
    made = Config(scenarios=[TOWN], sensors=[lidar, RgbCamera(name="front")], frames=FramesConfig(count=5))
    assert made == load_config(path) and made.sha256() == load_config(path).sha256()
    assert made.sensors[0] == lidar.with_rate(100)  # every frame
    assert pickle.loads(pickle.dumps(made)) == made


def test_a_mapping_may_hold_sections_and_name_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "inner.yaml").write_text("scenarios: [{name: a, stage: b/c.usda}]\nframes: {count: 7}")
    content = {"scenarios": ["inner.yaml", TOWN], "sensors": (Lidar(channels=8),), "output": {"dir": tmp_path}}
    found = load_config(content, ["sensors.lidar.range_m=60"], {"seed": 7}, base=tmp_path)
    assert [scenario.name for scenario in found.scenarios] == ["a", "s"]
    assert found.frames_of(found.scenarios[0]).count == 7 and found.scenarios[0].stage == "b/c.usda"
    assert (found.sensors[0].channels, found.sensors[0].range_m, found.seed) == (8, 60, 7)
    assert found.output.dir == str(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert load_config(content).scenarios == found.scenarios
    with pytest.raises(ConfigError, match=r"no.yaml: no such file"):
        load_config({"scenarios": ["no.yaml"]}, base=tmp_path)


@pytest.mark.parametrize("path", [*shipped_configs().values(), DATA / "every_sensor.yaml"], ids=lambda path: path.stem)
def test_an_object_is_a_source_like_its_file(path: Path) -> None:
    config = load_config(path)
    again = load_config(config)
    assert again == config and again.sha256() == config.sha256()
    changes = ["frames.count=3", "sensors.0.name=first", "scenarios.0.name=other"]
    assert load_config(config, changes) == load_config(path, changes)
    frames = FramesConfig(count=2, rate_hz=config.frames.rate_hz if config.frames else None)
    assert load_config(config, patch={"frames": frames}).frames == frames
    assert config == load_config(path)  # untouched


def test_paths_may_be_objects() -> None:
    assert ScenarioConfig(name="a", stage=Path("b") / "c.usda").stage == str(Path("b") / "c.usda")


PROBLEMS = [
    (lambda: Lidar(range_m=-1), "Lidar: range_m = -1: must be greater than 0; longest range [m]"),
    (lambda: Lidar(chanels=3), "Lidar: chanels = 3: unknown key; did you mean `channels`?"),
    (lambda: ScenarioConfig(name="s"), "ScenarioConfig: give exactly one of `town` and `stage`"),
    (lambda: ScenarioConfig(town="town03"), "ScenarioConfig: name: missing; add it"),
    (lambda: RsuConfig(), "RsuConfig: 'rsu_1' has no place; give position_m: [x, y, z] or lat_lon"),
    (lambda: Config(scenarios=[]), "Config: scenarios: an empty list makes nothing; describe at least one scenario"),
    (lambda: Config(scenarios=[TOWN], sensors=[7]), "Config: sensors[0] = 7: a section of keys is needed"),
    (
        lambda: Config(scenarios=[TOWN], sensors=[{"type": "lidar", "range_m": -1}]),
        "Config: sensors[0].range_m = -1: must be greater than 0",
    ),
    (
        lambda: Config(scenarios=[{"name": "s", "town": "t", "traffic": {"vehicle_count": 0}}]),
        "Config: scenarios[0].traffic.vehicle_count = 0: must be greater than or equal to 1",
    ),
    (
        lambda: Config(scenarios=[TOWN], sensors=[SensorConfig(type="lidar", name="x", on=["cav"])]),
        "Config: sensors[0]: a SensorConfig is no sensor of type 'lidar'; give a Lidar",
    ),
    (
        lambda: Config(scenarios=[TOWN], sensors=[Thermometer()]),
        "Config: sensors[0]: type = \"thermometer\" is unknown; one of 'lidar'",
    ),
    (
        lambda: load_config({"scenarios": [TOWN], "sensors": [Thermometer()]}),
        "configuration: sensors[0]: type = \"thermometer\" is unknown; one of 'lidar'",
    ),
    (lambda: load_config({"scenarios": [TOWN], "seed": "7"}), 'configuration: seed = "7": a whole number is needed'),
    (lambda: load_config({"scenarios": [TOWN], "seed": {7}}), "configuration: seed = {7}: is of type set; give text"),
    (lambda: load_config(None), "configuration = None: is of type NoneType; give a YAML file"),
]


@pytest.mark.parametrize(("make", "message"), PROBLEMS, ids=[message for _, message in PROBLEMS])
def test_a_problem_is_one_line(make, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        make()
    assert any(problem.startswith(message) for problem in caught.value.problems), caught.value.problems
    assert not any("\n" in problem or "pydantic" in problem for problem in caught.value.problems)
    assert "pydantic_core" not in "".join(traceback.format_exception(caught.value))


def test_every_problem_of_an_object_has_its_line() -> None:
    with pytest.raises(ConfigError) as caught:
        Config(scenarios=[TOWN], seed=-1, frames={"count": 0}, sensors=[{"type": "lidar", "range_m": -1}])
    starts = ("Config: frames.count = 0", "Config: seed = -1", "Config: sensors[0].range_m = -1")
    assert sorted(problem[: len(start)] for problem, start in zip(caught.value.problems, starts, strict=True)) == [
        *starts
    ]


def test_a_registered_sensor_may_be_an_object() -> None:
    with thermometer():
        made = Config(scenarios=[TOWN], sensors=[Thermometer()])
        assert made.sensors == (Thermometer(rate_hz=100.0),) and load_config(made) == made
        assert load_config({"scenarios": [TOWN], "sensors": [Thermometer()]}) == made


def test_a_section_inside_another_keeps_its_place() -> None:
    """Sections of other packages too, whose constructors are pydantic's."""

    class Inner(Section):
        size_m: float = Field(gt=0, description="size [m]")

    class Outer(Section):
        kind: Literal["a"] = "a"
        parts: tuple[Inner, ...]

    with pytest.raises(ConfigError) as caught:
        Outer(kind="b", parts=[{"size_m": 1}, {"size_m": -1}])
    first, second = caught.value.problems
    assert first.startswith('Outer: kind = "b": must be') and second.startswith("Outer: parts[1].size_m = -1: must be")


def test_all_sections_of_the_configuration_are_public() -> None:
    for name in mmw.config.__all__:
        assert hasattr(mmw.config, name)
    own = {cls for cls in Section.__subclasses__() if cls.__module__.startswith("mmw.config.")}
    assert {cls.__name__ for cls in own} <= set(mmw.config.__all__)
