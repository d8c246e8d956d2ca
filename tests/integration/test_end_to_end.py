"""The product: one configuration in, one dataset out; killed, resumed, batched or repeated, the rows are the same."""

import json
import re
import subprocess
from collections import Counter
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from pxr import Usd, UsdGeom

from mmw.cli.run import main
from mmw.config import load_config
from mmw.core.resources import configs_dir
from mmw.dataset import connect, open_dataset
from mmw.generation.estimate import frame_cost
from mmw.generation.progress import example_query
from mmw.storage.file_checks import verify
from mmw.storage.schemas import TABLES
from tests.fixtures.own_world import STAGE, assert_same_rows, run_own

SMALL = [
    "frames.count=4",
    "output.shard_frames=2",
    "channel.samples_per_tx=20_000",
    "channel.links=[v2i, v2v]",
    "weathers=[sunny, rainy]",
    "sensors=[{type: lidar, channels: 8, points_per_channel: 64}, "
    "{type: depth, width_px: 64, height_px: 48, segmentation: true}, {type: imu}]",
]
NO_ROWS = {"radar", "radar_maps", "radar_iq", "gnss", "gnss_satellites", "rgb", "normals", "flow"}
"""Tables of sensors that are not there; see tests/integration/test_every_sensor.py."""
CONFIG = str(configs_dir() / "quickstart.yaml")


def command(out: Path, *extra: str) -> list[str]:
    return ["--config", CONFIG, *SMALL, *extra, "--out", str(out), "--device", "cpu"]


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("run") / "dataset"
    assert main(command(root)) == 0
    return root


def test_every_table_is_there_and_complete(dataset: Path) -> None:
    data = open_dataset(dataset)
    counts = {name: data.arrow(name).count_rows() for name in data.tables}
    assert set(counts) == set(TABLES) - NO_ROWS
    frames, weathers, carriers, cavs, rsus = 4, 2, 2, 3, 1
    assert counts["frames"] == frames * weathers
    assert counts["poses"] == counts["lidar"] == frames * weathers * (cavs + rsus)
    assert counts["depth"] == counts["segmentation"] == frames * weathers * rsus
    assert counts["imu"] == frames * weathers * cavs
    assert counts["boxes"] == frames * weathers * 20
    assert counts["links"] == frames * weathers * carriers * (cavs * rsus + cavs * (cavs - 1))
    assert counts["path_gains"] == counts["path_geometry"] * weathers * carriers > counts["links"]
    assert connect(dataset).sql("SELECT count(*) FROM paths").fetchall() == [(counts["path_gains"],)]
    assert counts["sensors"] == cavs * 3 + rsus * 3
    assert verify(dataset) == []


def test_object_ids_mean_the_same_in_every_table(dataset: Path) -> None:
    connection = connect(dataset)
    known = "SELECT object_id FROM objects"
    cars = f"{known} WHERE actor IS NOT NULL AND label <> 'unlabeled'"
    for query, among in (
        ("SELECT object_id AS o FROM lidar_points WHERE label = 0", known),
        ("SELECT unnest(objects) AS o FROM paths", known),
        ("SELECT object_id AS o FROM boxes_2d", known),
        ("SELECT object_id AS o FROM box_visibility", known),
        ("SELECT blocker_id AS o FROM box_visibility WHERE blocker_id IS NOT NULL", known),
        ("SELECT object_id AS o FROM boxes", cars),
    ):
        assert connection.sql(f"SELECT count(*) FROM ({query}) WHERE o NOT IN ({among})").fetchall() == [(0,)]
    rain = "SELECT DISTINCT object_id FROM lidar_points WHERE label <> 0"
    assert connection.sql(rain).fetchall() == [(-1,)]


def test_rain_changes_the_ground_and_not_the_paths(dataset: Path) -> None:
    same, changed = (
        connect(dataset)
        .sql(
            """SELECT bool_and(s.tau_s = r.tau_s), count(*) FILTER (WHERE s.a_re <> r.a_re)
        FROM paths s JOIN paths r USING (scenario, frame, agent, peer, carrier_hz, path)
        WHERE s.weather = 'sunny' AND r.weather = 'rainy'"""
        )
        .fetchall()[0]
    )
    assert same and changed > 0


def test_the_stage_is_kept_and_opens_elsewhere(dataset: Path) -> None:
    stage = Usd.Stage.Open(str(dataset / "stages" / "town03_roundabout.usdc"))
    assert stage.GetTimeCodesPerSecond() == 100
    assert not stage.GetCompositionErrors()
    assert UsdGeom.Xformable(stage.GetPrimAtPath("/World/Actors/cav_1")).GetTimeSamples()


def test_provenance(dataset: Path) -> None:
    head = json.loads((dataset / "dataset.json").read_text())
    assert head["config"]["seed"] == 42
    assert head["versions"]["packages"]["warp-lang"]
    assert set(head["versions"]["sources"]["town03_roundabout"]) == {"town03.usda", "geometry.usdc"}
    table = pq.read_schema(next((dataset / "path_geometry").rglob("*.parquet")))
    assert table.metadata[b"mmw.config_sha256"].decode() == head["config_sha256"]


def test_a_finished_dataset_is_left_alone(dataset: Path) -> None:
    before = {p: p.stat().st_mtime_ns for p in dataset.rglob("part-*.parquet")}
    assert main(command(dataset)) == 0
    assert before == {p: p.stat().st_mtime_ns for p in dataset.rglob("part-*.parquet")}


def test_dry_run_foresees_the_bytes(dataset: Path, capsys: pytest.CaptureFixture) -> None:
    """Traced frames give the size within 20 %; without, single files dominate in this small dataset."""
    config = load_config(CONFIG, [*SMALL, "channel.candidates=launch"])
    rays, _ = frame_cost(config, {"cav": 3, "rsu": 1, "vehicles": 20, "boxes": 20}, config.scenarios[0])
    assert rays == {"lidar": 4 * 8 * 64, "depth": 64 * 48, "channel": 20_000 + 3 * 10_000}
    real = sum(path.stat().st_size for path in dataset.rglob("part-*.parquet"))
    for options, factor in (((), 1.2), (("--quick",), 1.5)):
        assert main(command(dataset, "--dry-run", *options)) == 0
        text = capsys.readouterr().out
        number, unit = re.search(r"tables of about ([\d.]+) (\w)B", text).groups()
        assert real / factor < float(number) * {"k": 1e3, "M": 1e6}[unit] < real * factor
        assert ("no frame was traced" in text) == bool(options)
        if not options:
            counts = {
                name: int(rows.replace(",", "")) for name, rows in re.findall(r"^  (\w+) +([\d,]+) rows", text, re.M)
            }
            true = {name: open_dataset(dataset).arrow(name).count_rows() for name in counts}
            assert sum(counts.values()) == pytest.approx(sum(true.values()), rel=0.2)
            exact = ("poses", "boxes", "links", "lidar", "depth", "imu", "objects", "materials")
            assert {name: counts[name] for name in exact} == {name: true[name] for name in exact}


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ("scenarios.0.traffic.spawn_center_m=[1e6, 0, 0]", "from the nearest lane"),
        ("scenarios.0.traffic.vehicle_count=500", "traffic.vehicle_count = 500"),
        ("--out=FILE/below", "is a file"),
    ],
)
def test_impossible_wishes_are_exit_code_2(
    tmp_path: Path, change: str, part: str, capsys: pytest.CaptureFixture
) -> None:
    (tmp_path / "f").write_text("")
    change = change.replace("FILE", str(tmp_path / "f"))
    assert main([*command(tmp_path / "d"), change]) == 2
    assert part in capsys.readouterr().err


def test_a_stage_of_ones_own_runs_through_the_same_path(own_world: Path) -> None:
    assert run_own(own_world, "d") == 0
    data = open_dataset(own_world / "d")
    assert Counter(data.read("paths")["kind"].to_pylist()) == {"los": 20, "specular": 20}
    assert data.numpy("poses", agent="Ego")["vx"] == pytest.approx(10)


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ("frames.count=500", "outside the stage"),
        ("scenarios.0.materials={}", "no radio material"),
        ("scenarios.0.stage=nowhere.usda", "no such file"),
        ("scenarios.0.actor_roles={/World/Nobody: cav}", "/World/Nobody"),
        ("channel.carriers_hz=[900e9]", "no permittivity at 900 GHz"),
    ],
)
def test_bad_stages_are_exit_code_2(own_world: Path, change: str, part: str, capsys: pytest.CaptureFixture) -> None:
    assert run_own(own_world, "d", change) == 2
    assert part in capsys.readouterr().err


def test_the_stored_configuration_makes_the_same_data(own_world: Path) -> None:
    assert run_own(own_world, "d", "channel.carriers_hz=[28e9]", "seed=7") == 0
    assert run_own(own_world, "again", config="d/config.yaml") == 0
    assert_same_rows(own_world / "d", own_world / "again")
    stored = load_config(own_world / "d" / "config.yaml")
    assert (stored.seed, stored.channel.samples_per_tx) == (7, 10_000)
    assert Path(stored.scenarios[0].stage) == (own_world / "mine.usda").resolve()


def test_the_query_of_the_summary_can_be_pasted(own_world: Path) -> None:
    """Also where the folder has spaces and both quotes in its name."""
    name = """it's a "test" $HOME"""
    assert run_own(own_world, name, "frames.count=2", "sensors=[]") == 0
    config = load_config(own_world / "mine.yaml", ["frames.count=2", "sensors=[]"])
    line = example_query(own_world / name, config)
    shown = subprocess.run(["sh", "-c", line], capture_output=True, text=True, check=True, cwd=Path(CONFIG).parents[1])
    assert "Mast" in shown.stdout


def test_nothing_but_ground_truth(own_world: Path) -> None:
    assert run_own(own_world, "d", "sensors=[]", "channel.enabled=false", "frames.count=1") == 0
    assert open_dataset(own_world / "d").read("poses").num_rows == 2
    assert open_dataset(own_world / "d").read("sensors").num_rows == 0


def test_roadside_units_of_the_file_stand_on_an_own_stage(own_world: Path) -> None:
    """The same world, y up and in centimeters: the configured unit is where the file says, in meters and z up."""
    rsus = "scenarios.0.rsus=[{name: gate, position_m: [5, -8, 1], yaw_deg: 90}]"
    turned = STAGE.replace('upAxis = "Z"', 'upAxis = "Y"').replace("metersPerUnit = 1", "metersPerUnit = 0.01")
    flat = "(-5000, 0, 5000), (5000, 0, 5000), (5000, 0, -5000), (-5000, 0, -5000)"
    turned = turned.replace("(-50, -50, 0), (50, -50, 0), (50, 50, 0), (-50, 50, 0)", flat)
    (own_world / "turned.usda").write_text(turned.replace("(0.9, 0, 0)", "(90, 0, 0)"))
    for name in ("mine.usda", "turned.usda"):
        assert run_own(own_world, f"{name}.d", rsus, f"scenarios.0.stage={name}") == 0
        poses = open_dataset(own_world / f"{name}.d").read("poses", agent="gate")
        assert poses.num_rows == 10
        pose = [poses.column(c)[3].as_py() for c in ("x", "y", "z", "qx", "qy", "qz", "qw", "vx")]
        assert pose == pytest.approx([5, -8, 1, 0, 0, 0.5**0.5, 0.5**0.5, 0], abs=1e-9)
        links = open_dataset(own_world / f"{name}.d").read("links", agent="Ego")
        assert set(links.column("peer").to_pylist()) == {"gate", "Mast"}
    assert (own_world / "mine.usda").read_text() == STAGE


def test_a_unit_under_the_ground_is_refused(own_world: Path, capsys: pytest.CaptureFixture) -> None:
    assert run_own(own_world, "d", "scenarios.0.rsus=[{name: gate, position_m: [5, -8, -9]}]") == 2
    text = capsys.readouterr().err
    assert "gate: antenna at (0.0, 0.0, 4.0) m is inside /World/" in text and "raise or move the unit" in text
    assert "Mast" not in text


def test_another_stage_is_refused(own_world: Path, capsys: pytest.CaptureFixture) -> None:
    assert run_own(own_world, "d") == 0
    (own_world / "mine.usda").write_text(STAGE.replace("(0.9, 0, 0)", "(0.8, 0, 0)"))
    assert run_own(own_world, "d") == 2
    assert "mine: mine.usda has changed" in capsys.readouterr().err
    assert run_own(own_world, "d", "--overwrite") == 0


def test_a_wrong_first_try_does_not_block_the_folder(own_world: Path) -> None:
    assert run_own(own_world, "d", "frames.count=500") == 2
    assert run_own(own_world, "d") == 0
    assert load_config(own_world / "d" / "config.yaml").frames.count == 10
    assert verify(own_world / "d") == []
