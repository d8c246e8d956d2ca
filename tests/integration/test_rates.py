"""A dataset whose sensors and channel sample at rates, phases and times of their own, and the same at other rates."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest

import mmw
from mmw.__main__ import main
from mmw.channel import tracks_from_table
from mmw.config import load_config
from mmw.core.resources import configs_dir
from mmw.dataset.export.exporter import Selection, export
from mmw.dataset.windows import Feature, WindowSpec, open_windows
from mmw.generation.estimate import frame_cost
from mmw.scene.prepare import make_tracks
from mmw.scene.sources import scenario_source
from mmw.storage.schemas import TABLES
from mmw.usd.vehicle_catalog import load_catalog
from mmw.viz.report.inventory import take_inventory
from mmw.viz.report.page import make_report
from tests.fixtures.edit_files import edit_json
from tests.fixtures.own_world import run_own, write_own_world
from tests.fixtures.small_dataset import copy_of, rewrite

SENSORS = (
    "sensors=[{type: lidar, channels: 8, points_per_channel: 64, rate_hz: 10}, {type: imu, rate_hz: 500}, "
    "{type: gnss, mode: physical, rate_hz: 100, phase_s: 0.004}, "
    "{type: rgb, name: front, on: [cav], width_px: 32, height_px: 24, sample_times_s: [0.0, 0.033]}]"
)
FAST = ("frames.count=90", "frames.rate_hz=1000", SENSORS, "channel.rate_hz=250", "output.shard_frames=40")
COUNTS = {"frames": 90, "poses": 180, "boxes": 90, "lidar": 2, "imu": 45, "gnss": 9, "rgb": 2, "links": 46}
"""Rows: one CAV and one roadside unit, two carriers; the channel has 23 of the 90 frames, the LiDAR one."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_own_world(tmp_path_factory.mktemp("rates"))


@pytest.fixture(scope="module")
def fast(folder: Path) -> Path:
    """Return a dataset of 90 ms at 1000 frames a second with mixed rates."""
    assert run_own(folder, "fast", *FAST) == 0
    return folder / "fast"


def test_every_table_has_the_rows_of_its_own_rate(fast: Path) -> None:
    data = mmw.open_dataset(fast)
    assert {name: data.read(name).num_rows for name in COUNTS} == COUNTS
    frames = {name: sorted(set(data.read(name, columns=["frame"])["frame"].to_pylist())) for name in COUNTS}
    assert frames["lidar"] == [0] and frames["rgb"] == [0, 33]
    assert frames["imu"] == list(range(0, 90, 2)) and frames["gnss"] == list(range(4, 90, 10))
    assert frames["links"] == list(range(0, 90, 4)) and set(frames["poses"]) == set(range(90))
    sight = data.read("box_visibility", columns=["frame", "sensor"])
    antennas = sight.filter(pc.equal(sight["sensor"].cast(pa.string()), "antenna"))
    assert sorted(set(antennas["frame"].to_pylist())) == frames["links"]


def test_times_velocities_and_metadata_follow_the_rate(fast: Path) -> None:
    data = mmw.open_dataset(fast)
    assert data.frame_rate_hz("mine") == 1000 and data.info["frame_rates_hz"] == {"mine": 1000}
    rows = data.numpy("frames", columns=["frame", "time_s"])
    assert np.array_equal(rows["time_s"], rows["frame"] / 1000)
    assert data.frame("mine", "sunny", 33).time_s == 0.033
    assert data.numpy("poses", columns=["vx"], agent="Ego")["vx"] == pytest.approx(10.0)  # 0.9 m in 90 ms
    file = next(fast.glob("lidar/**/*.parquet"))
    assert pq.read_schema(file).field("frame").metadata[b"unit"] == b"1/1000 s"
    (marker,) = fast.glob("_shards/*mine.json")
    assert json.loads(marker.read_text())["frame_rate_hz"] == 1000
    assert set(pq.read_table(fast / "_manifest.parquet")["frame_rate_hz"].to_pylist()) == {1000}
    params = {row["sensor"]: json.loads(row["params"]) for row in data.read("sensors").to_pylist()}
    assert params["gnss"]["phase_s"] == 0.004 and params["front"]["sample_times_s"] == [0.0, 0.033]
    assert params["antenna"]["rate_hz"] == 250.0


def test_verify_accepts_the_dataset_and_misses_every_row(
    fast: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    assert main(["verify", str(fast)]) == 0
    for number, table in enumerate(("lidar", "imu", "gnss", "rgb", "links", "frames", "box_visibility")):
        broken = copy_of(fast, tmp_path / str(number))
        path = sorted(file for file in broken.glob(f"{table}/**/*.parquet") if pq.read_metadata(file).num_rows)[0]
        rewrite(broken, str(path.relative_to(broken)), lambda rows: rows.slice(1))
        capsys.readouterr()
        assert main(["verify", str(broken)]) != 0, table
        assert table in capsys.readouterr().out


def test_a_row_between_the_samples_is_too_many(fast: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    broken = copy_of(fast, tmp_path / "d")
    path = next(file for file in broken.glob("imu/**/*.parquet"))

    def move(rows: pa.Table) -> pa.Table:
        place = rows.column_names.index("frame")
        frames = pa.array([rows["frame"][0].as_py() + 1, *rows["frame"].to_pylist()[1:]], pa.int32())
        return rows.set_column(place, rows.schema.field("frame"), frames)

    rewrite(broken, str(path.relative_to(broken)), move)
    assert main(["verify", str(broken)]) != 0
    assert "imu" in capsys.readouterr().out


def test_samples_do_not_depend_on_the_rate_of_frames(folder: Path, fast: Path) -> None:
    """One time is one row in two datasets: poses and boxes, points and their noise, radio paths."""
    slow = ("frames.count=9", "frames.rate_hz=100", SENSORS.replace("rate_hz: 500", "rate_hz: 100"))
    slow = tuple(text.replace(", phase_s: 0.004", "").replace("0.033", "0.03") for text in slow)
    assert run_own(folder, "slow", *slow) == 0
    one, other = mmw.open_dataset(folder / "slow"), mmw.open_dataset(fast)
    for table, step in (("lidar", 10), ("poses", 1), ("boxes", 1), ("links", 2), ("paths", 2), ("frames", 1)):
        first, second = (data.read(table) for data in (one, other))
        if table in ("links", "paths"):  # of 250 Hz, every 20 ms is one of 100 Hz
            first = first.filter(pc.equal(pc.bit_wise_and(first["frame"], 1), 0))
        moved = pa.array((first["frame"].to_numpy() * 10).astype(np.int32))
        second = second.filter(pc.is_in(second["frame"], value_set=moved))
        assert second.num_rows == first.num_rows > 0, (table, step)
        for name in first.column_names:
            if name == "frame":
                assert second["frame"].to_pylist() == moved.to_pylist()
            elif table == "lidar" or name in ("x", "y", "z", "object_id", "time_s", "agent", "path_id", "vertices"):
                assert first[name].combine_chunks().equals(second[name].combine_chunks()), (table, name)
            elif pa.types.is_floating(first[name].type):
                values = [np.nan_to_num(rows[name].to_numpy().astype(float)) for rows in (first, second)]
                np.testing.assert_allclose(*values, rtol=1e-5, atol=1e-6, err_msg=f"{table} {name}")


def test_a_rate_below_100_hz_has_the_very_same_motion(folder: Path) -> None:
    """At 50 Hz derivatives are taken over 10 ms, as at 100 Hz: poses with velocities and the IMU agree to the bit."""
    sensors = "sensors=[{type: imu, mode: carla}, {type: gnss}]"
    for out, rate in (("r100", 100), ("r50", 50)):
        assert run_own(folder, out, f"frames.count={rate * 8 // 100}", f"frames.rate_hz={rate}", sensors) == 0
    one, other = mmw.open_dataset(folder / "r100"), mmw.open_dataset(folder / "r50")
    for table in ("poses", "boxes", "imu", "gnss", "links", "paths"):
        first, second = (data.read(table) for data in (one, other))
        first = first.filter(pc.equal(pc.bit_wise_and(first["frame"], 1), 0))
        first, second = (rows.drop_columns(["frame"]).combine_chunks() for rows in (first, second))
        assert first.num_rows > 0 and first.equals(second), table


def test_datasets_of_before_have_100_hz_and_damaged_rates_are_told(fast: Path, tmp_path: Path) -> None:
    old = copy_of(fast, tmp_path / "old")
    edit_json(old / "dataset.json", lambda head: head.pop("frame_rates_hz"))
    assert mmw.open_dataset(old).frame_rate_hz("mine") == 100
    for number, rates in enumerate(({"mine": 30}, {"mine": "1000"}, [1000])):
        broken = copy_of(fast, tmp_path / str(number))
        edit_json(broken / "dataset.json", lambda head, rates=rates: head.update(frame_rates_hz=rates))
        with pytest.raises(mmw.InputError, match="frame_rates_hz cannot be understood"):
            mmw.open_dataset(broken)


def test_learning_reads_the_latest_sample_of_each_rate(fast: Path) -> None:
    data = mmw.open_dataset(fast)
    spec = WindowSpec(past=8, future=0, features=(Feature("imu"), Feature("gnss")))
    windows = open_windows(data, spec)
    assert len(windows) > 0
    one = windows[20]
    imu, gnss = (one[name] for name in ("imu_frame", "gnss_frame"))
    assert (np.asarray(imu) % 2 == 0).all() and set(np.asarray(gnss).tolist()) <= {-1, *range(4, 90, 10)}


def test_tracks_are_those_of_the_channels_frames(fast: Path) -> None:
    data = mmw.open_dataset(fast)
    paths, links = data.read("paths"), data.read("links")
    tracks = tracks_from_table(paths, 28e9, links, rate_hz=1000, step=4)
    assert tracks.step_s == 0.004 and tracks.length.max() == 23
    stored = tracks.at(0.008)
    between = tracks.at([0.008, 0.010, 0.012])
    assert between.tau[between.link == 0] == pytest.approx(stored.tau)  # hardly moved in 2 ms
    assert np.array_equal(between.tau[: len(stored.tau)], stored.tau)
    doppler = (tracks.at(0.012).tau - stored.tau) / 0.004 * -28e9
    assert doppler == pytest.approx(0.5 * (stored.doppler_hz + tracks.at(0.012).doppler_hz), abs=1.0)
    with pytest.raises(ValueError, match="needs frames 88 and 92"):
        tracks.at(0.0895)


def test_exports_work_or_say_why_not(fast: Path, tmp_path: Path) -> None:
    export(fast, "opv2v", tmp_path / "opv2v", Selection(), {"rate": "10", "images": "none"})
    assert len(list((tmp_path / "opv2v").rglob("*.pcd"))) == 2  # CAV and roadside unit, at 0 s
    export(fast, "nuscenes", tmp_path / "nuscenes", Selection(), {"rate": "10", "sweeps": "10"})
    export(fast, "deepmimo", tmp_path / "deepmimo", Selection(), {"scene": "off", "mode": "dynamic"})
    steps = {path.name for path in (tmp_path / "deepmimo").rglob("frame_*")}
    assert steps == {f"frame_{frame:06d}" for frame in range(0, 90, 4)}
    export(fast, "huggingface", tmp_path / "hf", Selection())
    assert "frames 0 to 89, 1/1000 s each" in (tmp_path / "hf" / "README.md").read_text()
    with pytest.raises(ValueError, match="rate=30: a rate that divides 1000 Hz is needed"):
        export(fast, "opv2v", tmp_path / "o", Selection(), {"rate": "30"})
    with pytest.raises(ValueError, match="no sweep of lidar; every frame needs one; pick other frames"):
        export(fast, "kitti", tmp_path / "k", Selection(agents=("Ego",)), {"rate": "50", "images": "none"})


def test_report_status_and_regenerated_rows(fast: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    make_report(fast, tmp_path / "r.html")
    assert "0.09 s" in (tmp_path / "r.html").read_text()
    assert take_inventory(fast).link_frames("mine") == range(0, 90, 4)
    assert main(["status", str(fast)]) == 0
    capsys.readouterr()
    for table, frame in (("imu", 2), ("gnss", 34), ("path_gains", 44), ("path_geometry", 44), ("poses", 89)):
        weather = ["weather=sunny"] if TABLES[table].by_weather else []
        where = ["scenario=mine", *weather, f"frame={frame}"]
        assert main(["regenerate", "--compare", table, str(fast), *where, "--device", "cpu"]) == 0
        assert "rows are equal" in capsys.readouterr().out


def test_simulation_and_loaded_scenes_have_the_rate(folder: Path) -> None:
    config = load_config(folder / "mine.yaml", ["frames.count=4", "frames.rate_hz=1000", "channel.enabled=false"])
    with mmw.Simulation(config, base=folder, device="cpu") as simulation:
        assert simulation.rate_hz == 1000
        assert [frame.time_s for frame in simulation] == [0.0, 0.001, 0.002, 0.003]
    with mmw.load_scene(config, base=folder, device="cpu") as scene:
        assert scene.rate_hz == 1000 and scene.actors["Ego"].velocity == pytest.approx([10.0, 0.0, 0.0])
    scene = mmw.load_scene(
        folder / "mine.usda", rate_hz=500, materials={"/World/*": "itu_concrete"},
        actor_roles={"/World/Ego": "cav"}, device="cpu",
    )  # fmt: skip
    assert scene.frames == range(46) and scene.actors["Ego"].velocity == pytest.approx([10.0, 0.0, 0.0])
    scene.close()
    with pytest.raises(mmw.InputError, match="give 250 or 500"):
        mmw.load_scene(folder / "mine.usda", rate_hz=300)


def test_the_estimate_counts_the_samples(folder: Path) -> None:
    counts = {"cav": 1, "rsu": 1, "vehicles": 1, "boxes": 1}
    for changes, share in ((FAST, 23 / 90), ((*FAST, "channel.rate_hz=10"), 1 / 90)):
        config = load_config(folder / "mine.yaml", changes)
        rays, _ = frame_cost(config, counts, config.scenarios[0])
        assert rays["channel"] == int(10_000 * share)
        assert rays["lidar"] == round(2 * 8 * 64 / 90)


@pytest.mark.slow
@pytest.mark.parametrize("more", ["warmup_s=1", "signals=true", "pedestrian_count=3"])
def test_traffic_of_a_town_does_not_depend_on_the_rate(more: str) -> None:
    """The poses at t = 0, 0.1, ..., 0.5 s are the same to the bit at 10, 100, 250 and 1000 Hz."""
    found = {}
    for rate in (10, 100, 250, 1000):
        changes = [f"frames.rate_hz={rate}", f"frames.count={rate // 2}", "sensors=[]", f"scenarios.0.traffic.{more}"]
        config = load_config("town10_crossroad", changes)
        (scenario,) = config.scenarios
        source = scenario_source(scenario, configs_dir())
        found[rate] = make_tracks(config, scenario, source, load_catalog(), configs_dir())
    for rate, tracks in found.items():
        step = max(rate, 100) // 10
        for track, base in zip(tracks, found[100], strict=True):
            assert track.name == base.name and len(track.poses) == max(rate, 100) // 2 + 1
            assert np.array_equal(track.poses[::step], base.poses[::10])


@pytest.mark.slow
def test_the_example_runs(tmp_path: Path) -> None:
    """A LiDAR at 10 Hz beside channel state at 1 kHz, in small."""
    changes = ["frames.count=101", "scenarios.0.traffic.vehicle_count=9", "sensors.front.width_px=32"]
    changes += ["sensors.front.height_px=24", "sensors.lidar.channels=8"]
    out = tmp_path / "d"
    assert main(["run", "lidar_10hz_csi_1khz", *changes, "--out", str(out), "--device", "cpu"]) == 0
    data = mmw.open_dataset(out)
    agents = {row["agent"] for row in data.read("poses", columns=["agent"]).to_pylist()}
    assert len(agents) == 4 and data.read("lidar").num_rows == 2 * 4
    assert data.read("links").num_rows == 101 * 3 * 2 and data.read("imu").num_rows == 21 * 3
    assert data.read("gnss").num_rows == 1 * 3
    assert main(["verify", str(out)]) == 0
