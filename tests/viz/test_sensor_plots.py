"""Sensors of a dataset with several weathers: `mmw render` draws each, and the guide's snippet reads them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mmw.__main__ import main
from mmw.cli.run import main as run
from mmw.config.sensor_spec import SENSORS
from mmw.core.resources import configs_dir
from mmw.dataset import open_dataset
from mmw.dataset.camera_geometry import from_world
from mmw.storage.codecs.images import decode_depth
from mmw.viz.plots import plot_depth, plot_lidar, plot_radar, plot_sensor
from mmw.viz.report.figures import thumbnail
from mmw.viz.stills import dataset_gallery as gallery
from tests.fixtures.doc_pages import ROOT, run_python


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("view") / "d"
    small = [
        "frames.count=2",
        "channel.samples_per_tx=10_000",
        "weathers=[sunny, foggy]",
        "sensors=[{type: lidar, channels: 16, points_per_channel: 64, on: [cav]}, "
        "{type: depth, width_px: 64, height_px: 48, segmentation: true}, "
        "{type: radar, mode: carla, mount: {rsu: {position_m: [1, 0, 4], yaw_deg: 90}}}]",
    ]
    assert run(["--config", str(configs_dir() / "quickstart.yaml"), *small, "--out", str(root), "--device", "cpu"]) == 0
    return root


@pytest.mark.slow
def test_pictures_of_every_sensor_and_weather(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The radar is on the roadside unit, where there is no LiDAR, and has no power: both are drawn without."""
    monkeypatch.setattr(gallery, "MAP_PX", 96)
    monkeypatch.setattr(gallery, "STREET_PX", (96, 54))
    assert (
        main(["render", str(dataset), "--out", str(tmp_path), "--agent", "cav_2", "--frame", "1", "--samples", "1"])
        == 0
    )
    files = [Path(line) for line in capsys.readouterr().out.splitlines()]
    assert {file.stem.removeprefix("town03_roundabout_") for file in files} == {
        "above", "close", "street", "lidar", "lidar_weathers", "radar", "radar_weathers", "depth", "link",
        "paths",
    }  # fmt: skip
    for file in files:
        assert np.asarray(Image.open(file).convert("L")).std() > 5, file


def test_unknown_agent_frame_and_folder_are_named(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    for arguments, part in (
        ([str(dataset), "--agent", "cav_9"], "cav_9"),
        ([str(dataset), "--frame", "77"], "77"),
        ([str(tmp_path)], "dataset.json"),
    ):
        assert main(["render", *arguments, "--out", str(tmp_path / "p")]) == 2
        assert part in capsys.readouterr().err


def test_weathers_are_side_by_side_over_histograms_of_returns(dataset: Path) -> None:
    data = open_dataset(dataset)
    figure = plot_lidar(data, "town03_roundabout", ["sunny", "foggy"], 0, "cav_1", extent_m=1e3)
    above, below = figure.axes[:2], figure.axes[2:4]
    assert [axes.get_title() for axes in above] == ["sunny", "foggy"]
    for weather, axes, histogram in zip(("sunny", "foggy"), above, below, strict=True):
        label = data.frame("town03_roundabout", weather, 0).agents["cav_1"].sweeps["lidar"]["label"]
        surfaces, echoes = (len(part.get_offsets()) for part in axes.collections[:2])
        assert (surfaces, echoes) == ((label == 0).sum(), (label != 0).sum())
        names = [text.get_text() for text in histogram.get_legend().get_texts()]
        counts = [f"{name} ({(label == k).sum():,})" for k, name in enumerate(("surface", "rain", "fog"))]
        assert names == [count for count in counts if "(0)" not in count]
    assert "fog" in names[-1]


def test_a_radar_without_power_is_drawn_by_velocity(dataset: Path) -> None:
    figure = plot_radar(open_dataset(dataset), "town03_roundabout", ["foggy"], 0, "rsu_1")
    sample = open_dataset(dataset).frame("town03_roundabout", "foggy", 0).agents["rsu_1"].radars["radar"]
    points = np.concatenate([part.get_offsets() for part in figure.axes[1].collections])
    assert figure.axes[1].get_ylabel() == "radial velocity [m/s]"
    order = np.argsort(sample["label"], kind="stable")
    np.testing.assert_allclose(points, np.stack([sample["range"], sample["velocity"]], axis=1)[order], rtol=1e-6)


def test_rectangles_lie_over_depth_and_instances(dataset: Path) -> None:
    frame = open_dataset(dataset).frame("town03_roundabout", "sunny", 0)
    rows = [r for r in frame.rows("boxes_2d") if (r["agent"], r["sensor"]) == ("rsu_1", "depth") and r["pixels"]]
    for axes in plot_depth(open_dataset(dataset), "town03_roundabout", ["sunny"], 0, "rsu_1").axes[:2]:
        drawn = [patch.get_bbox().extents.tolist() for patch in axes.patches]
        for row in rows:
            for prefix in ("", "amodal_"):
                wanted = [row[f"{prefix}{side}"] for side in ("u_min", "v_min", "u_max", "v_max")]
                assert any(np.allclose(found, wanted) for found in drawn)
        assert len(drawn) == 2 * len(rows)


def test_the_snippet_of_the_guide_gives_carlas_arrays(dataset: Path) -> None:
    found = run_python(ROOT / "docs" / "sensors" / "index.md", "DATASET", dataset)
    agents = open_dataset(dataset).frame("town03_roundabout", "sunny", 0).agents
    y = agents["cav_1"].sweeps["lidar"].points[:, 1]
    azimuth = next(agent for agent in agents.values() if agent.radars).radars["radar"]["azimuth"]
    np.testing.assert_array_equal(found["lidar"][:, 1], -y)
    np.testing.assert_array_equal(found["radar"][:, 1], -azimuth)
    assert found["lidar"].shape == (len(y), 4) and found["radar"].shape == (len(azimuth), 4)
    assert found["radar"][:, 3].min() > 0.0 and found["radar"][:, 3].max() < 175.0  # CARLA's rays reach past 100 m
    assert found["grey"].shape == found["tags"].shape == (48, 64)
    assert found["grey"][found["tags"] == 11].min() == 255 and 1 in found["tags"]  # sky is white; there is a road


def test_a_sensor_that_is_not_there_is_named(dataset: Path) -> None:
    with pytest.raises(ValueError, match="view 'plots' is not known; name one of plot, figure, viewer"):
        replace(SENSORS["lidar"], views={"plots": "mmw.viz.plots.samples:draw_lidar_sample"})
    with pytest.raises(ValueError, match="cav_1 has no radar sample"):
        plot_radar(open_dataset(dataset), "town03_roundabout", ["foggy"], 0, "cav_1")


def test_a_sensor_without_views_is_drawn_by_its_kind(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Points become a scatter plot, images pictures, scalars time series, in figures, report and viewer."""
    for name in ("lidar", "depth", "radar"):
        monkeypatch.setitem(SENSORS._loaded, name, replace(SENSORS[name], views={}, decode=""))
    data, scenario = open_dataset(dataset), "town03_roundabout"
    cav, rsu = (data.frame(scenario, "sunny", 0).agents[name] for name in ("cav_1", "rsu_1"))
    points = plot_sensor(data, scenario, ["sunny"], 0, "cav_1", "lidar").axes[0].collections[0]
    place = from_world(cav.pose, cav.sensor("lidar").world)
    np.testing.assert_allclose(points.get_offsets(), np.stack([-place[:, 1], place[:, 0]], axis=1))
    np.testing.assert_allclose(points.get_array(), place[:, 2])
    axes = plot_sensor(data, scenario, ["sunny", "foggy"], 0, "rsu_1", "depth").axes
    stored = decode_depth(rsu.sensor("depth").image["bytes"])
    shown = np.asarray(axes[0].images[0].get_array(), dtype=float) / 100.0
    np.testing.assert_allclose(shown[np.isfinite(stored)], stored[np.isfinite(stored)], atol=1e-5)
    assert [picture[0][0] for picture in (thumbnail(cav, "lidar"), thumbnail(rsu, "depth"))] == [
        "image/png", "image/jpeg",
    ]  # fmt: skip
    pytest.importorskip("rerun")
    from mmw.viz.rerun.entities import sensor_entity
    from mmw.viz.rerun.recording import Looks
    from mmw.viz.rerun.selection import choose_scope
    from mmw.viz.rerun.viewer import save
    from tests.fixtures.rrd_files import read_recording

    save(choose_scope(data, weather="sunny"), Looks(with_town=False), tmp_path / "plain.rrd")
    recording = read_recording(tmp_path / "plain.rrd")
    found = recording.array(sensor_entity("cav_1", "lidar"), 0, "Points3D:positions")
    np.testing.assert_array_equal(found, cav.sensor("lidar").points)
    entity = f"{sensor_entity('rsu_1', 'depth')}/depth"
    assert bytes(recording.at(entity, 0, "EncodedImage:blob")[0]) == rsu.sensor("depth").image["bytes"]
