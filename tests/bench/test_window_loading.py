"""The benchmark of windows runs and counts windows."""

import pytest

pytest.importorskip("torch", reason="PyTorch is not installed: pip install 'multimodal-wireless[torch]'")

import mmw
from bench.window_loading import contents, measure, stretch
from tests.fixtures.window_data import window_data


def test_rows_are_repeated_and_measured(tmp_path) -> None:
    root = stretch(mmw.open(window_data()), tmp_path / "d", 130)
    data = mmw.open(root)
    frames = data.numpy("poses", columns=["frame"], agent="cav_1")["frame"]
    assert frames.tolist() == list(range(130))
    images = data.numpy("rgb", columns=["frame"], agent="cav_1")["frame"]
    assert images.tolist() == list(range(0, 130, 10))
    where = {"columns": ["x", "intensity", "ring"], "agent": "cav_3"}
    source = mmw.open(window_data()).read("lidar", scenario="circle", weather="rainy", frames=range(7, 8), **where)
    assert data.read("lidar", frames=range(67, 68), **where).equals(source)
    found = contents(root, "stream", 10, 28e9, 1)
    both = found["4 LiDAR + 4 JPEG"]
    assert both[0]["rgb_front"].shape == (4, 16, 24, 3) and len(both[0]["lidar"]) == 4
    assert both[0]["rgb_front_frame"].tolist() == both[0]["lidar_frame"].tolist() == [10, 20, 30, 40]
    for order in ("stream", "random"):
        assert measure(both, order, 1, min_s=0.01) > 0
