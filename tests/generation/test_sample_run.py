"""A few traced frames foresee the tables of a scenario, and say what finds nothing in it."""

from pathlib import Path
from unittest.mock import patch

import pytest

from mmw.cli.run import main
from mmw.config import Config, load_config
from mmw.generation.capture import capture_channel, capture_frames
from mmw.generation.sample_run import MAX_LINKS, SampledScenario, sample_scenario
from mmw.storage.manifest import manifest_rows, read_markers
from tests.fixtures.own_world import SMALL, command, write_own_world

CHANGES = (
    "frames={start: 1, count: 8}", "weathers=[sunny, rainy]", "output.shard_frames=3",
    "sensors=[{type: imu}, {type: gnss, rate_hz: 50}, {type: lidar, channels: 4, points_per_channel: 90, rate_hz: 20}]",
    "channel.diffuse_reflection=true", "channel.diffraction=true", "materials={'*tower*': itu_brick}",
)  # fmt: skip

ROUGH = ("sensors=[]", "scenarios.0.materials={'/World/*': {radio: itu_concrete, scattering: 0.3}}")


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_own_world(tmp_path_factory.mktemp("sampled"))


@pytest.fixture(scope="module")
def config(world: Path) -> Config:
    return load_config(world / "mine.yaml", CHANGES)


@pytest.fixture(scope="module")
def sample(world: Path, config: Config) -> SampledScenario:
    return sample_scenario(config, config.scenarios[0], world, "cpu")


def true_tables(data: Path) -> tuple[dict[str, int], dict[str, int]]:
    """Return the rows and bytes of each table of a dataset."""
    rows: dict[str, int] = {}
    size: dict[str, int] = {}
    for file in manifest_rows(read_markers(data)).to_pylist():
        rows[file["table"]] = rows.get(file["table"], 0) + file["rows"]
        size[file["table"]] = size.get(file["table"], 0) + file["bytes"]
    return rows, size


def test_rows_and_bytes_are_those_of_a_run(world: Path, sample: SampledScenario) -> None:
    assert main(command(world, "data", *CHANGES)) == 0
    rows, size = true_tables(world / "data")
    assert sample.rows == pytest.approx(rows, rel=0.2)
    for table in ("frames", "poses", "imu", "gnss", "lidar", "links", "objects", "materials"):
        assert sample.rows[table] == pytest.approx(rows[table]), table
    assert sum(sample.bytes.values()) == pytest.approx(sum(size.values()), rel=0.2)
    assert sample.bytes.keys() == size.keys()


def test_what_finds_nothing_is_told(sample: SampledScenario) -> None:
    said = [line.split(":")[0] for line in sample.notes]
    assert "channel.diffuse_reflection finds nothing" in said
    assert "materials['*tower*'] decides nothing" in said
    assert "channel.diffraction finds nothing" not in said


def test_the_command_prints_it(world: Path, capsys: pytest.CaptureFixture) -> None:
    assert main(command(world, "nothing", *CHANGES, "--dry-run")) == 0
    text = capsys.readouterr().out
    assert "note: channel.diffuse_reflection finds nothing" in text and "  lidar " in text
    assert main(command(world, "nothing", *CHANGES, "--dry-run", "--quick")) == 0
    assert "no frame was traced" in capsys.readouterr().out
    assert not (world / "nothing").exists()
    assert main(command(world, "nothing", "--quick")) == 2
    assert "--quick goes with --dry-run" in capsys.readouterr().err


def test_one_agent_stands_for_all_with_a_camera(world: Path) -> None:
    """Each frame has a picture of another agent, and rows of objects count for all of them."""
    mount = "mount: {rsu: {position_m: [0, 0, 2], yaw_deg: 180}}"
    camera = f"{{type: depth, on: [cav, rsu], width_px: 48, height_px: 32, boxes_2d: true, {mount}}}"
    config = load_config(world / "mine.yaml", ["frames.count=3", f"sensors=[{camera}]", "channel.enabled=false"])
    with patch("mmw.generation.sample_run.capture_frames", wraps=capture_frames) as capture:
        sample = sample_scenario(config, config.scenarios[0], world, "cpu")
    assert [call.args[3][0].on for call in capture.call_args_list] == [("Ego",), ("Mast",), ("Mast",)]
    assert sample.rows["depth"] == 3 * 2
    assert sample.rows["boxes_2d"] == 2 * 2  # the mast sees the vehicle in two frames, and stands for it there too


@pytest.mark.parametrize("physics", ["paper", "standard", "full"])
def test_paths_of_every_preset_are_those_of_a_run(world: Path, physics: str) -> None:
    """The vehicle moves by 0.9 m: the paths of six of ten frames are about those of all."""
    changes = (*ROUGH, f"channel.physics={physics}")
    assert main(command(world, physics, *changes)) == 0
    rows, _ = true_tables(world / physics)
    config = load_config(world / "mine.yaml", [*SMALL, *changes])
    sample = sample_scenario(config, config.scenarios[0], world, "cpu")
    assert sample.rows == pytest.approx(rows, rel=0.2)
    assert sample.rows["links"] == rows["links"]
    assert (rows["path_geometry"] > 100 * rows["links"]) == (physics == "full")  # diffuse paths are many


def test_some_of_many_links_stand_for_all(world: Path) -> None:
    """Of 25 links, five antennas to five, six are traced, others in each frame."""
    mounts = [f"{{cav: {{position_m: [{x}, 0, 2.5]}}, rsu: {{position_m: [0, {x}, 6]}}}}" for x in range(-2, 3)]
    antennas = ", ".join(f"{{name: a{k}, on: [cav, rsu], mount: {mount}}}" for k, mount in enumerate(mounts))
    changes = (*ROUGH, "channel.physics=full", f"channel.antennas=[{antennas}]", "frames.count=3")
    assert main(command(world, "many", *changes)) == 0
    rows, _ = true_tables(world / "many")
    config = load_config(world / "mine.yaml", [*SMALL, *changes])
    with patch("mmw.generation.sample_run.capture_channel", wraps=capture_channel) as capture:
        sample = sample_scenario(config, config.scenarios[0], world, "cpu")
    links = [call.args[2] for call in capture.call_args_list]
    pairs = [set(zip(some.tx_number.tolist(), some.rx_number.tolist(), strict=True)) for some in links]
    assert [len(some) for some in pairs] == [MAX_LINKS] * 3
    assert len(set.union(*pairs)) > 12
    assert rows["links"] == 25 * 3 * 2 * 2
    assert sample.rows == pytest.approx(rows, rel=0.2)
    assert sample.rows["links"] == pytest.approx(rows["links"])
