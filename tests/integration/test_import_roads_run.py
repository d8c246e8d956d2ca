"""An OpenDRIVE file and an OSM extract become towns that a one-frame configuration runs on, with every sensor."""

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom

from mmw.cli.import_scene import main as import_main
from mmw.cli.run import main as run_main
from mmw.dataset import open_dataset
from tests.fixtures.osm_files import quarter
from tests.fixtures.stages import animate, new_stage
from tests.fixtures.xodr_files import ARM, LANE, RADIUS, WALK, t_town

SENSORS = (
    "sensors: [{type: lidar, channels: 8, points_per_channel: 64}, {type: depth, width_px: 48, height_px: 32}, "
    "{type: imu}]\nchannel: {samples_per_tx: 20_000}\nframes: {start: 0, count: 1}\nweathers: [rainy]\n"
)


def bounds(path: Path, prim: str = "/Town") -> tuple[np.ndarray, np.ndarray]:
    stage = Usd.Stage.Open(str(path))
    cache = UsdGeom.BBoxCache(Usd.TimeCode.Default(), [UsdGeom.Tokens.default_])
    box: Gf.Range3d = cache.ComputeWorldBound(stage.GetPrimAtPath(prim)).ComputeAlignedRange()
    return np.array(box.GetMin()), np.array(box.GetMax())


def check(root: Path, classes: set[str], materials: set[str]) -> None:
    """Every sensor has rows, a link is seen, and classes and materials are those of the source."""
    data = open_dataset(root)
    for table in ("lidar", "depth", "imu", "paths"):
        assert data.read(table).num_rows, table
    assert any(data.read("links")["is_los"].to_pylist())
    objects = data.read("objects").to_pylist()
    assert classes <= {row["label"] for row in objects}
    assert materials <= {name for row in objects for name in row["materials"]}


@pytest.mark.slow
def test_opendrive_file_runs_with_traffic(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    source = tmp_path / "t_town.xodr"
    source.write_text(t_town())
    assert import_main([str(source), "--out", str(tmp_path / "t_town")]) == 0
    town = tmp_path / "t_town" / "t_town.usda"
    assert "lanes: 12" in capsys.readouterr().out
    low, high = bounds(town, "/Town/Sidewalks")
    # The loop's arc is the easternmost: its middle lies 40 m from the outer edge less half the street.
    np.testing.assert_allclose(low[:2], [-ARM - 50.0, -LANE - WALK], atol=0.01)
    assert 14 + 60 + RADIUS < high[0] < 14 + 60 + 30 + RADIUS + LANE + WALK
    config = tmp_path / "config.yaml"
    config.write_text(
        f"scenarios:\n  - name: loop\n    town: {town}\n"
        "    traffic: {vehicle_count: 4, spawn_center_m: [40, 0, 0], cav_ranks: [0, 1]}\n"
        f"    rsus: [{{name: rsu_1, position_m: [18, -7, 0.14], yaw_deg: 90}}]\n{SENSORS}"
    )
    out = tmp_path / "data"
    assert run_main(["--config", str(config), "--out", str(out), "--device", "cpu"]) == 0
    check(out, {"road", "sidewalk", "terrain", "car"}, {"asphalt", "road_marking", "road_marking_yellow"})


@pytest.mark.slow
def test_osm_extract_runs_below_an_own_stage(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    source = tmp_path / "quarter.osm"
    source.write_text(quarter().text())
    assert import_main([str(source), "--out", str(tmp_path / "quarter")]) == 0
    out = capsys.readouterr().out
    assert "lanes: none" in out and "material brick_facade" in out
    low, high = bounds(tmp_path / "quarter" / "quarter.usda", "/Town/Buildings")
    np.testing.assert_allclose(high - low, [130.0, 90.0, 19.0], atol=1e-3)
    stage = new_stage(tmp_path / "drive.usda", frames=11)
    stage.DefinePrim("/World/Town").GetReferences().AddReference("quarter/quarter.usda")
    animate(stage, "/World/Ego", np.array([(-40.0 + k, -1.75, 0.0) for k in range(11)]))
    stage.Save()
    config = tmp_path / "config.yaml"
    config.write_text(
        "scenarios:\n  - name: quarter\n    stage: drive.usda\n    actor_roles: {/World/Ego: cav}\n"
        f"    rsus: [{{name: rsu_1, position_m: [6, 6, 0], yaw_deg: 225}}]\n{SENSORS}"
    )
    root = tmp_path / "data"
    assert run_main(["--config", str(config), "--out", str(root), "--device", "cpu"]) == 0
    classes = {"road", "sidewalk", "terrain", "building", "vegetation"}
    check(root, classes, {"brick_facade", "glass_facade", "marble_facade"})
