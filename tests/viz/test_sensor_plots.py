"""Sensors of a dataset with several weathers: `mmw render` draws each, and the guide's snippet reads them."""

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mmw.__main__ import main
from mmw.cli.run import main as run
from mmw.core.resources import configs_dir
from mmw.core.transforms import pose_from_mount, transform_points
from mmw.viz.stills import dataset_gallery as gallery
from mmw.viz.stills.plots import POSE, plot_radar, read_rows, sensor_pose


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("view") / "d"
    small = [
        "frames.count=1",
        "channel.enabled=false",
        "weathers=[sunny, foggy]",
        "sensors=[{type: lidar, channels: 16, points_per_channel: 64, on: [cav]}, "
        "{type: depth, width_px: 64, height_px: 48, segmentation: true}, "
        "{type: radar, mode: compat, mount: {rsu: {position_m: [1, 0, 4], yaw_deg: 90}}}]",
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
    assert main(["render", str(dataset), "--out", str(tmp_path), "--agent", "cav_2", "--samples", "1"]) == 0
    files = [Path(line) for line in capsys.readouterr().out.splitlines()]
    assert {file.stem.removeprefix("town03_roundabout_") for file in files} == {
        "above", "close", "street", "lidar", "lidar_weathers", "radar", "radar_weathers", "depth", "camera",
    }  # fmt: skip
    for file in files:
        assert np.asarray(Image.open(file).convert("L")).std() > 5, file


def test_pose_of_a_sensor_is_its_mount_on_its_agent(dataset: Path) -> None:
    key = {"scenario": "town03_roundabout", "weather": "foggy", "frame": 0, "agent": "rsu_1"}
    agent = np.array([values[0] for values in read_rows(dataset, "poses", POSE, **key).values()])
    mount = pose_from_mount((1, 0, 4), yaw_deg=90)
    pose = sensor_pose(dataset, "town03_roundabout", "foggy", 0, "rsu_1", "radar")
    point = np.array([3.0, -2.0, 1.0])
    expected = transform_points(agent, transform_points(mount, point))
    np.testing.assert_allclose(transform_points(pose, point), expected, atol=1e-9)


def test_the_snippet_of_the_guide_gives_carlas_arrays(dataset: Path) -> None:
    guide = (Path(__file__).parents[2] / "docs" / "sensors" / "index.md").read_text()
    blocks = re.findall(r"```python\n(.*?)```", guide, re.DOTALL)
    assert len(blocks) == 1
    found = {}
    exec(blocks[0].replace('"DATASET"', repr(str(dataset))), found)
    key = {"scenario": "town03_roundabout", "weather": "sunny", "frame": 0}
    y = np.array(read_rows(dataset, "lidar", ["y"], **key, agent="cav_1")["y"][0])
    azimuth = np.array(read_rows(dataset, "radar", ["azimuth"], **key)["azimuth"][0])
    np.testing.assert_array_equal(found["lidar"][:, 1], -y)
    np.testing.assert_array_equal(found["radar"][:, 1], -azimuth)
    assert found["lidar"].shape == (len(y), 4) and found["radar"].shape == (len(azimuth), 4)
    assert found["radar"][:, 3].min() > 0.0 and found["radar"][:, 3].max() < 175.0  # CARLA's rays reach past 100 m
    assert found["grey"].shape == found["tags"].shape == (48, 64)
    assert found["grey"][found["tags"] == 11].min() == 255 and 1 in found["tags"]  # sky is white; there is a road


def test_a_sensor_that_is_not_there_is_named(dataset: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no row"):
        plot_radar(dataset, "town03_roundabout", "foggy", 0, "cav_1", tmp_path / "radar.png")
