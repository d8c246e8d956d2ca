"""The curves of cost: all of them are measured over their quantity, and drawn."""

import json
from collections import defaultdict
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import warp as wp

from bench import scaling
from bench.scaling_frames import (
    Discarding,
    Frames,
    connected,
    scenario_arrays,
    scenario_config,
    stage_of,
    with_bodies,
)
from bench.scaling_towns import finer_towns, larger_towns
from mmw.config import load_config
from mmw.core.timing import StageTimer
from mmw.generation.capture import capture_frames
from mmw.generation.pipeline import make_batch
from mmw.scene.device_scene import instance_actors
from tests.fixtures.meshes import area

pytestmark = pytest.mark.slow  # benchmarks are not part of the package

NAMES = [curve for curves in scaling.CURVES.values() for curve in curves]
AGENTS = 4
"""Three connected vehicles and the roadside unit."""


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("scaling") / "quick.json"
    scaling.main(["--quick", "--device", "cpu", "--out", str(out)])
    return out


@pytest.fixture(scope="module")
def measured(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text())


def test_every_curve_is_measured(measured: dict[str, Any]) -> None:
    assert list(measured["curves"]) == list(measured["seconds"]) == NAMES
    assert measured["machine"]["device"] and measured["scene"] == "grid"
    for name, points in measured["curves"].items():
        values = [point["value"] for point in points]
        assert values == sorted(set(values)) and values, name
        assert len(values) == 2 or name == "v2v"


def test_towns_grow_and_rays_meet_the_same_in_finer_triangles(measured: dict[str, Any]) -> None:
    for name in ("larger", "finer"):
        for point in measured["curves"][name]:
            assert set(point["rays_per_s"]) == set(point["hit_share"]) == {"sphere", "lidar"}
            assert min(point["rays_per_s"].values()) > 0.0 < point["build_s"]
            assert point["device_gb"] is None and point["surfaces_s"] > 0.0
    coarse, fine = measured["curves"]["finer"]
    assert fine["value"] == 4 * coarse["value"]
    for kind, share in coarse["hit_share"].items():
        assert abs(fine["hit_share"][kind] - share) < 1e-3


def test_points_count_what_was_traced(measured: dict[str, Any]) -> None:
    found = {
        name: [(point["value"], point["rays"]) for point in points]
        for name, points in measured["curves"].items()
        if name not in ("larger", "finer")
    }
    assert all(rays == {"cameras": 16 * 12 * value} for value, rays in found["images"])
    assert all(rays == {"cameras": AGENTS * value + 3 * value} for value, rays in found["resolution"])
    assert all(rays == {"lidar": 4 * 16 * value} for value, rays in found["lidars"])
    assert all(rays == {"lidar": AGENTS * value} for value, rays in found["points"])
    assert all(rays == {"channel": value} for value, rays in found["rays"])
    assert all(rays == {"channel": 1000} for _, rays in found["v2i"]) and found["v2v"] == [(2, {"channel": 1000})]
    for name in ("vehicles", "batch", "weathers"):  # geometry is traced once for all weathers
        (_, few), (_, more) = found[name]
        assert few == more and set(few) == {"cameras", "lidar", "radar", "channel"}


def test_stages_add_up_to_the_frame(measured: dict[str, Any]) -> None:
    for point in measured["curves"]["batch"]:
        assert point["frames"] == point["value"]
        assert point["least_ms"] <= point["frame_ms"] <= point["most_ms"]
        assert 0.7 * point["frame_ms"] < sum(point["stages_ms"].values()) <= point["most_ms"] * 1.001
        assert {"cameras", "lidar", "radar", "channel", "imu", "ground truth"} <= set(point["stages_ms"])
        assert point["device_ms"] is point["device_gb"] is None


def test_some_curves_are_measured_again_and_the_others_stay(path: Path, tmp_path: Path) -> None:
    out = tmp_path / "again.json"
    out.write_text(path.read_text())
    scaling.main(["--quick", "--device", "cpu", "--only", "lidars,rays", "--out", str(out)])
    old, new = (json.loads(each.read_text())["curves"] for each in (path, out))
    assert list(new) == NAMES
    assert [name for name in NAMES if new[name] != old[name]] == ["lidars", "rays"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(["--only", "fog", "--out", "x.json"], "--only fog: there is no such curve"), ([], "--out FILE.json is missing")],
)
def test_wrong_options_are_refused(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        scaling.parse(arguments)
    assert message in capsys.readouterr().err


def test_pictures_are_drawn(path: Path, measured: dict[str, Any], tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="matplotlib is not installed: pip install 'multimodal-wireless[plot]'")
    from PIL import Image

    from bench.scaling_plots import DPI, PANEL_INCH, PICTURES, draw

    scaling.main(["--plot", str(path), "--pictures", str(tmp_path / "new")])
    assert {file.name for file in (tmp_path / "new").iterdir()} == {f"{name}.png" for name in PICTURES}
    for name in ("vehicles", "batch"):  # as on a GPU
        for point in measured["curves"][name]:
            point.update(device_ms=0.5 * point["frame_ms"], device_gb=1.0 + point["frames"])
    some = {name: measured["curves"][name] for name in ("vehicles", "images", "batch")}
    written = draw({**measured, "curves": some}, tmp_path)
    assert [file.stem for file in written] == ["scaling_sensors", "scaling_batch"]
    width, height = (size * DPI for size in PANEL_INCH)
    with Image.open(written[0]) as one, Image.open(written[1]) as two:
        assert one.width == pytest.approx(2 * width, abs=2) and two.width == pytest.approx(width, abs=2)
        assert one.height >= height and np.asarray(one.convert("L")).mean() > 200  # light
    with pytest.raises(ValueError, match="the file has the curves none; there is no picture of them"):
        draw({**measured, "curves": {}}, tmp_path)


def test_vehicles_are_left_out_or_lose_their_bodies() -> None:
    arrays = scenario_arrays("grid", 2, 40, ["sunny"])
    for count in (0, 3, 7, 40):
        some = with_bodies(arrays, count)
        roles = [actor.role for actor in some.actors]
        assert len(instance_actors(some)) == count
        assert roles.count("cav") == 3 and roles.count("rsu") == 1 and len(roles) == max(count, 3) + 1
        assert some.poses.shape == (2, len(roles), 7)
    middle = arrays.poses[0, [a.role == "cav" for a in arrays.actors], :3].mean(axis=0)
    left = {actor.name for actor in with_bodies(arrays, 7).actors}
    away = {a.name: np.linalg.norm(arrays.poses[0, i, :3] - middle) for i, a in enumerate(arrays.actors)}
    others = [a.name for a in arrays.actors if a.role == "vehicle"]
    assert left >= set(sorted(others, key=away.__getitem__)[:4])


def test_as_many_low_vehicles_are_connected_as_wanted() -> None:
    arrays = scenario_arrays("grid", 1, 40, ["sunny"])
    for count in (0, 1, 16):
        found = [actor for actor in connected(arrays, count).actors if actor.role == "cav"]
        assert len(found) == count and all(actor.size[2] < 2.2 for actor in found)
    with pytest.raises(ValueError, match="40 connected vehicles: the scene has 20 low ones"):
        connected(arrays, 40)


def test_larger_towns_have_more_of_the_same_and_finer_ones_the_same_area() -> None:
    small, large = larger_towns((1, 2), 1)
    assert len(large.objects) - 41 == 4 * (len(small.objects) - 41)
    coarse, fine = finer_towns(2, blocks=1, frames=1)
    assert len(fine.faces) == 4 * len(coarse.faces) and area(fine) == pytest.approx(area(coarse), rel=1e-9)
    np.testing.assert_array_equal(fine.object_id, np.repeat(coarse.object_id, 4))


def test_stages_go_to_their_sensor() -> None:
    config = load_config("configs/quickstart.yaml")
    kinds = {"front, back, left, right": "cameras", "depth, front": "cameras", "lidar": "lidar", "imu": "imu"}
    assert {stage: stage_of(stage, config) for stage in kinds} == kinds
    assert stage_of("channel", config) == "channel" and stage_of("2-D boxes", config) == "2-D boxes"


def test_the_device_is_looked_at_before_every_launch(monkeypatch: pytest.MonkeyPatch) -> None:
    frames, launch, used = Frames("cpu", 1), wp.launch, iter(range(10**9, 10**12, 10**9))
    frames.has_gpu = True
    monkeypatch.setattr("bench.scaling_frames.device_bytes", lambda _: next(used))
    monkeypatch.setattr(wp, "timing_end", lambda: [SimpleNamespace(elapsed=3.0), SimpleNamespace(elapsed=4.0)])
    config = scenario_config(["frames.count=2", *scaling.QUICK.overrides])
    point = frames.measure(frames.job(config, scenario_arrays("grid", 2, 40, ["sunny"]), 2), 1.0, 2)
    assert point.device_ms == 3.5 and point.device_gb is not None
    assert point.device_gb + 1.0 == next(used) / 1e9 > 20.0 and wp.launch is launch


def test_a_full_memory_halves_the_batch(monkeypatch: pytest.MonkeyPatch) -> None:
    frames, tried = Frames("cpu", 1), []

    def record(_: Any, some: range, __: Any) -> None:
        tried.append(len(some))
        if len(some) > 2:
            raise RuntimeError("Failed to allocate 8 bytes")

    monkeypatch.setattr("bench.scaling_frames._record", record)
    config = scenario_config(["frames.count=8", *scaling.QUICK.overrides])
    job = frames.job(config, scenario_arrays("grid", 8, 40, ["sunny"]), 8)
    assert frames.measure(job, 5.0, 8).frames == 2 and tried == [8, 4, 2, 2]


def test_nothing_is_encoded(monkeypatch: pytest.MonkeyPatch) -> None:
    """The pool drops its work, so the tracing thread alone is timed; rows are collected all the same."""
    monkeypatch.setattr("mmw.sensors.rgb.capture.encode_rgb", lambda *_: pytest.fail("an image was encoded"))
    config = scenario_config(["frames.count=1", *scaling.QUICK.overrides])
    arrays = scenario_arrays("grid", 1, 40, ["sunny"])
    job = make_batch(config, config.scenarios[0], arrays, "cpu", 1, Discarding(1), StageTimer())
    rows: dict[str, Any] = {"sunny": defaultdict(list)}
    capture_frames(job, [0], rows)
    assert {"rgb", "lidar", "radar", "path_gains", "path_geometry"} <= set(rows["sunny"])
