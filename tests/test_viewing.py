"""Previews and plots: they show what is there."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mmw.__main__ import main
from mmw.paths import configs_dir
from mmw.run import main as run
from mmw.scene import Scene
from mmw.viewing.plots import read_rows
from mmw.viewing.preview import look, map_view, to_srgb
from tests.scenes import two_cars


def mean_color(image: Image.Image, box: tuple[int, int, int, int]) -> np.ndarray:
    return np.asarray(image.crop(box), dtype=float).mean(axis=(0, 1))


@pytest.fixture
def scene(device: str) -> Scene:
    scene = Scene(two_cars(1), device, 1)
    scene.load_batch([0])
    return scene


def test_srgb_of_known_values() -> None:
    np.testing.assert_array_equal(to_srgb(np.array([-1.0, 0.0, 0.214041, 1.0, 9.0])), [0, 0, 127, 255, 255])


def test_sky_is_above_and_ground_below(scene: Scene) -> None:
    image = look(scene, "sunny", (0, 0, 1.5), (10, 0, 1.5), width=64, height=48, samples=1)
    sky, ground = mean_color(image, (0, 0, 64, 6)), mean_color(image, (0, 42, 64, 48))
    assert image.size == (64, 48)
    assert sky[2] > sky[0]  # blue
    assert not np.allclose(sky, ground, atol=20)


def test_map_has_north_up_and_east_right(scene: Scene) -> None:
    """A map moved by some metres shows the same thing, moved by as many pixels the other way."""
    one = np.asarray(map_view(scene, "sunny", (0.0, 0.0), 40.0, width=80, samples=1)).astype(int)
    east = np.asarray(map_view(scene, "sunny", (5.0, 0.0), 40.0, width=80, samples=1)).astype(int)
    north = np.asarray(map_view(scene, "sunny", (0.0, 5.0), 40.0, width=80, samples=1)).astype(int)
    assert one.std() > 5
    assert np.abs(one[:, 10:] - east[:, :-10]).mean() < 3
    assert np.abs(one[:-10] - north[10:]).mean() < 3


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("view") / "d"
    small = [
        "frames.count=3",
        "channel.rays=10_000",
        "sensors=[{type: lidar, channels: 16, points_per_channel: 64}, {type: depth, width_px: 64, height_px: 48}]",
    ]
    assert run(["--config", str(configs_dir() / "quickstart.yaml"), *small, "--out", str(root), "--device", "cpu"]) == 0
    return root


def test_pictures_of_a_dataset(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert (
        main(["pictures", str(dataset), "--out", str(tmp_path), "--agent", "cav_2", "--frame", "1", "--samples", "1"])
        == 0
    )
    files = [Path(line) for line in capsys.readouterr().out.splitlines()]
    assert {file.stem.removeprefix("town03_roundabout_") for file in files} == {
        "above", "close", "street", "lidar", "depth", "link",
    }  # fmt: skip
    for file in files:
        assert np.asarray(Image.open(file).convert("L")).std() > 5, file


def test_unknown_agent_frame_and_folder_are_named(dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    for arguments, part in (
        ([str(dataset), "--agent", "cav_9"], "cav_9"),
        ([str(dataset), "--frame", "77"], "77"),
        ([str(dataset), "--samples", "0"], "samples"),
        ([str(tmp_path)], "dataset.json"),
    ):
        assert main(["pictures", *arguments, "--out", str(tmp_path / "p")]) == 2
        assert part in capsys.readouterr().err
    with pytest.raises(ValueError, match="no row"):
        read_rows(dataset, "links", ["frame"], agent="nobody")
