"""Scenarios taken from other files, and frames of each scenario."""

from pathlib import Path

import pytest
import yaml

from mmw.config import ConfigError, FramesConfig, load_config

TRAFFIC = {"vehicle_count": 4, "spawn_center_m": [0, 0, 0], "cav_ranks": [0]}


def write(path: Path, content: object) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(yaml.safe_dump(content))
    return path


@pytest.fixture
def full(tmp_path: Path) -> Path:
    """Write a configuration of one own and three included scenarios with frames from different places."""
    write(
        tmp_path / "places/a.yaml",
        {"scenarios": [{"name": "a", "town": "town03", "traffic": TRAFFIC}], "frames": {"count": 30}, "seed": 5},
    )
    file_traffic = TRAFFIC | {"engine": "replay", "trajectories": "../tracks.csv"}
    write(
        tmp_path / "places/b.yaml",
        {
            "scenarios": [
                {"name": "b1", "town": "towns/b.usda", "traffic": file_traffic, "frames": {"start": 5, "count": 7}},
                {"name": "b2", "stage": "b.usda"},
            ]
        },
    )
    own = {"name": "own", "town": "town03", "traffic": TRAFFIC}
    return write(tmp_path / "full.yaml", {"scenarios": [own, "places/a.yaml", "places/b.yaml"], "weathers": ["sunny"]})


def test_included_scenarios_bring_their_frames(full: Path) -> None:
    config = load_config(full)
    assert [scenario.name for scenario in config.scenarios] == ["own", "a", "b1", "b2"]
    frames = [config.frames_of(scenario) for scenario in config.scenarios]
    assert frames == [FramesConfig(), FramesConfig(count=30), FramesConfig(start=5, count=7), FramesConfig()]
    assert config.frame_total == 1000 + 30 + 7 + 1000
    assert config.seed == 42  # what is no scenario comes from the including file


def test_frames_of_the_configuration_win(full: Path) -> None:
    config = load_config(full, ["frames.count=10"])
    assert all(config.frames_of(scenario) == FramesConfig(count=10) for scenario in config.scenarios)


def test_relative_paths_start_from_the_included_file(full: Path) -> None:
    config = load_config(full)
    b1, b2 = config.scenarios[2:]
    assert b1.town == "places/towns/b.usda" and b1.traffic and b1.traffic.trajectories == "tracks.csv"
    assert b2.stage == "places/b.usda"
    assert config.scenarios[1].town == "town03"  # a shipped town's name is no path


def test_overrides_reach_included_scenarios(full: Path) -> None:
    config = load_config(full, ["scenarios.1.traffic.vehicle_count=9"])
    assert config.scenarios[1].traffic and config.scenarios[1].traffic.vehicle_count == 9


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (None, "no such file"),
        ({"weathers": ["sunny"]}, "holds no list of described scenarios"),
        ({"scenarios": ["full.yaml"]}, "holds no list of described scenarios"),
        ("scenarios: [", "not valid YAML"),
    ],
)
def test_bad_includes(tmp_path: Path, content: object, found: str) -> None:
    path = write(tmp_path / "top.yaml", {"scenarios": ["part.yaml"]})
    if isinstance(content, str):
        (tmp_path / "part.yaml").write_text(content)
    elif content is not None:
        write(tmp_path / "part.yaml", content)
    with pytest.raises(ConfigError, match=found) as error:
        load_config(path)
    assert "part.yaml" in str(error.value) and len(error.value.problems) == 1
