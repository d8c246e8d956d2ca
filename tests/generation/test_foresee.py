"""Traced frames of a few scenarios foresee the tables of all."""

from collections.abc import Mapping
from pathlib import Path

import pytest
import yaml

from mmw.cli.run import main
from mmw.config import load_config
from mmw.config.scenario import ScenarioConfig
from mmw.core.resources import configs_dir
from mmw.generation import foresee as module
from mmw.generation.estimate import count_agents, estimate_plan
from mmw.generation.foresee import ScenarioLoad, choose_scenarios, foresee, infer_scenario
from mmw.generation.run_config import RunOptions, run_config
from mmw.generation.sample_run import CHANNEL, FRAMES, STATIC, SampledScenario, SampledTable
from mmw.storage.manifest import manifest_rows, read_markers
from tests.fixtures.own_world import command, write_own_world

LENGTHS = (2, 4, 3, 6, 2, 5)
TWO_CAVS = "actor_roles: {/World/Ego: cav, /World/Second: cav, /World/Mast: rsu}"


def write_scenarios(folder: Path) -> Path:
    """Write six scenarios of unequal length: four of one stage, two of another, with a second vehicle."""
    write_own_world(folder)
    text = (folder / "mine.usda").read_text()
    begin, end = text.index('    def Xform "Ego"'), text.index('    def Xform "Mast"')
    second = text[begin:end].replace('"Ego"', '"Second"').replace("0: (0, 0, 0), 9: (0.9, 0, 0)", "0: (9, 9, 0)")
    (folder / "two.usda").write_text(text[:end] + second + text[end:])
    content = yaml.safe_load((folder / "mine.yaml").read_text())
    (one,) = content["scenarios"]
    two = {**one, "stage": "two.usda", **yaml.safe_load(TWO_CAVS)}
    content["scenarios"] = [
        {**(two if k in (1, 4) else one), "name": f"s{k}", "frames": {"count": count}}
        for k, count in enumerate(LENGTHS)
    ]
    content["sensors"] += [{"type": "depth", "on": ["cav"], "width_px": 48, "height_px": 32}]
    (folder / "mine.yaml").write_text(yaml.safe_dump(content))
    return folder


def test_all_scenarios_are_foreseen_from_a_few(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    world = write_scenarios(tmp_path)
    monkeypatch.setattr(module, "MAX_SAMPLED", 4)
    config = load_config(world / "mine.yaml", ["output.shard_frames=2", "weathers=[sunny, rainy]"])
    samples = foresee(config, world, "cpu", count_agents(config, world))
    assert [sample.name for sample in samples] == [f"s{k}" for k in range(len(LENGTHS))]
    assert sum(sample.is_traced for sample in samples) == 4
    assert any(sample.is_traced for sample in (samples[1], samples[4]))
    assert main(command(world, "data")) == 0
    files = manifest_rows(read_markers(world / "data")).to_pylist()
    for sample in samples:
        rows: dict[str, int] = {}
        for file in files:
            if file["scenario"] == sample.name:
                rows[file["table"]] = rows.get(file["table"], 0) + file["rows"]
        assert sample.rows.keys() == rows.keys()
        for table in ("frames", "poses", "boxes", "imu", "lidar", "depth", "links", "objects", "sensors", "materials"):
            assert sample.rows[table] == pytest.approx(rows[table]), (sample.name, table)
    size = sum(sum(sample.bytes.values()) for sample in samples)
    assert size == pytest.approx(sum(file["bytes"] for file in files), rel=0.2)
    capsys.readouterr()
    assert main(command(world, "nothing", "--dry-run")) == 0
    text = capsys.readouterr().out
    names = ", ".join(sample.name for sample in samples if sample.is_traced)
    assert f"tables, from traced frames of 4 of 6 scenarios ({names}); the others are inferred" in text


def test_fewer_scenarios_are_traced_at_more_places(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    world, places = write_scenarios(tmp_path), []
    monkeypatch.setattr(module, "sample_scenario", lambda *given: places.append(len(given[-1])))
    for count, expected in ((2, [3, 3]), (3, [2, 2, 2]), (5, [1] * 5)):
        config = load_config(world / "mine.yaml")
        config = config.model_copy(update={"scenarios": config.scenarios[:count]})
        foresee(config, world, "cpu", count_agents(config, world))
        assert places == expected
        places.clear()


def load(name: str, town: str, boxes: int, frames: int = 100, shards: int = 1, **samples: float) -> ScenarioLoad:
    """Return what is known of a scenario in a town."""
    traffic = {"vehicle_count": 4, "spawn_center_m": (0, 0, 0), "cav_ranks": (0, 1)}
    scenario = ScenarioConfig.model_validate({"name": name, "town": town, "traffic": traffic})
    every = {FRAMES: float(frames), STATIC: 1.0, **samples}
    return ScenarioLoad(scenario, every, {"agents": 3, "boxes": boxes}, shards)


def test_the_chosen_have_all_sensors_and_towns_and_differ() -> None:
    loads = [
        load("a", "town03", 20, lidar=10.0, rgb=0.0),
        load("b", "town03", 40, lidar=10.0, rgb=0.0),
        load("c", "town03", 30, lidar=10.0, rgb=0.0),
        load("d", "town05", 50, lidar=10.0, rgb=0.0),
        load("e", "town05", 80, lidar=10.0, rgb=5.0),
        load("f", "town05", 60, lidar=10.0, rgb=0.0),
        load("g", "town07", 10, lidar=10.0, rgb=0.0),
    ]
    chosen = [loads[index].scenario.name for index in choose_scenarios(loads, 4)]
    assert chosen[0] == "e"  # the only one with pictures
    assert set(chosen[1:3]) == {"c", "g"}  # the median of the first town, and the only one of the last
    assert chosen[3] == "d"  # differs most from what its town has
    assert choose_scenarios(loads[:3], 4) == [2, 0, 1]
    assert len(set(choose_scenarios(loads, 7))) == 7


def sampled(rows: Mapping[str, Mapping[str, float]], shard_bytes: float, row_bytes: float) -> SampledScenario:
    """Return a traced scenario with these rows."""
    return SampledScenario("", {name: SampledTable(own, shard_bytes, row_bytes) for name, own in rows.items()}, 1)


def test_rows_follow_counts_and_the_town() -> None:
    near = load("a", "town03", 20, lidar=10.0, **{CHANNEL: 300.0})
    far = load("b", "town05", 20, lidar=10.0, **{CHANNEL: 100.0})
    tables = {"lidar": {"lidar": 10.0}, "box_visibility": {"lidar": 100.0}, "objects": {STATIC: 7.0}}
    known = [
        (near, sampled({**tables, "paths": {CHANNEL: 600.0}}, 1000.0, 10.0)),
        (far, sampled({**tables, "paths": {CHANNEL: 900.0}}, 3000.0, 30.0)),
    ]
    other = load("c", "town03", 60, frames=200, shards=5, lidar=20.0, **{CHANNEL: 30.0})
    found = infer_scenario(other, known)
    assert not found.is_traced and found.name == "c"
    # Twice the sweeps, each with three times the boxes; two paths a link, as in its town; objects are there once.
    assert found.rows == {"lidar": 20.0, "box_visibility": 600.0, "objects": 7.0, "paths": 60.0}
    assert found.bytes["paths"] == 5 * 1000.0 + 60 * 10.0
    elsewhere = infer_scenario(load("d", "town07", 20, lidar=10.0, **{CHANNEL: 40.0}), known)
    assert elsewhere.rows["paths"] == pytest.approx(40.0 * (600 + 900) / (300 + 100))
    assert elsewhere.bytes["paths"] == pytest.approx(2000.0 + 150.0 * (600 * 10 + 900 * 30) / 1500)


def test_what_the_own_town_lacks_comes_from_the_others() -> None:
    silent = load("a", "town03", 20, **{CHANNEL: 0.0})
    loud = load("b", "town05", 20, **{CHANNEL: 100.0})
    known = [
        (silent, sampled({"paths": {CHANNEL: 0.0}}, 1.0, 0.0)),
        (loud, sampled({"paths": {CHANNEL: 200.0}}, 1.0, 5.0)),
    ]
    found = infer_scenario(load("c", "town03", 20, **{CHANNEL: 10.0}), known)
    assert found.rows == {"paths": 20.0}
    assert found.bytes["paths"] == 1.0 + 20.0 * 5.0


@pytest.mark.slow
def test_paths_of_a_drive_are_foreseen(tmp_path: Path) -> None:
    """Along twelve seconds of a drive the paths of a link grow fourfold; half of the frames foresee all of them.

    Without a trace, a scenario may differ from the mean of all by a factor of two or three.
    """
    out = tmp_path / "data"
    changes = ["sensors=[]", "channel.physics=standard", "frames.rate_hz=1", "frames.count=12"]
    config = load_config("town07_crossroad", changes, {"output.dir": str(out), "compute.device": "cpu"})
    counts = count_agents(config, configs_dir())
    (sample,) = foresee(config, configs_dir(), "cpu", counts)
    run_config(config, configs_dir(), "test", RunOptions(is_quiet=True))
    made = manifest_rows(read_markers(out)).to_pylist()
    rows = {file["table"]: file["rows"] for file in made}
    assert rows["path_geometry"] > 10 * rows["links"]
    assert sample.rows == pytest.approx(rows, rel=0.2)
    size = sum(file["bytes"] for file in made)
    assert sum(sample.bytes.values()) == pytest.approx(size, rel=0.2)
    assert size / 3 < estimate_plan(config, configs_dir(), counts).bytes < size * 3
