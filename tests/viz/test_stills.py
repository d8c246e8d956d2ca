"""Pictures for people and plots: they show what is there."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mmw.core.transforms import rotate
from mmw.physics.weather.weather import PRESETS, Weather
from mmw.scene.scene_data import SceneData
from mmw.viz.stills.image_files import save_jpeg
from mmw.viz.stills.renderer import StillRenderer, follow_view, look_pose, street_camera
from tests.fixtures.device_rays import loaded
from tests.fixtures.scenes import arrays_from_parts, pose, quad_part, two_cars


def mean_color(image: Image.Image, box: tuple[int, int, int, int]) -> np.ndarray:
    return np.asarray(image.crop(box), dtype=float).mean(axis=(0, 1))


def pictures_of(arrays: SceneData, device: str, weather: Weather = PRESETS["sunny"]) -> StillRenderer:
    scene = loaded(arrays, device, [0])
    return StillRenderer(scene, {"sunny": weather})


@pytest.fixture
def pictures(device: str) -> StillRenderer:
    return pictures_of(two_cars(1), device)


def test_sky_is_above_and_ground_below(pictures: StillRenderer) -> None:
    image = pictures.look("sunny", (0, 0, 1.5), (10, 0, 1.5), street_camera(64, 48, 1))
    sky, ground = mean_color(image, (0, 0, 64, 6)), mean_color(image, (0, 42, 64, 48))
    assert image.size == (64, 48)
    assert sky[2] > sky[0]  # blue
    assert not np.allclose(sky, ground, atol=20)


def test_a_view_looks_at_its_target_and_north_is_up_from_above() -> None:
    eye, target = np.array([3.0, -2.0, 5.0]), np.array([-4.0, 1.0, 2.0])
    pose = look_pose(eye, target)
    way = (target - eye) / np.linalg.norm(target - eye)
    np.testing.assert_allclose(rotate(pose[3:], (1, 0, 0)), way, atol=1e-12)
    assert rotate(pose[3:], (0, 1, 0))[2] == pytest.approx(0.0, abs=1e-12)  # level
    above = look_pose(eye, eye - (0, 0, 4))
    np.testing.assert_allclose(rotate(above[3:], (1, 0, 0)), (0, 0, -1), atol=1e-12)
    np.testing.assert_allclose(rotate(above[3:], (0, 0, 1)), (0, 1, 0), atol=1e-12)
    with pytest.raises(ValueError, match="both"):
        look_pose(eye, eye)


def test_map_has_north_up_and_the_given_scale(device: str) -> None:
    """A bright square of 10 m on dark ground is as many pixels wide as the map says, and where it says."""
    arrays = arrays_from_parts([
        quad_part("/World/Ground", [(-60, -60, -0.1), (60, -60, -0.1), (60, 60, -0.1), (-60, 60, -0.1)], "dark"),
        quad_part("/World/Square", [(5, 15, 0), (15, 15, 0), (15, 25, 0), (5, 25, 0)], "bright"),
    ])  # fmt: skip
    names = [material.name for material in arrays.materials["sunny"]]
    painted = tuple(
        replace(material, appearance=replace(material.appearance, color=(shade,) * 3))
        for material, shade in zip(
            arrays.materials["sunny"], [0.02 if n == "dark" else 0.8 for n in names], strict=True
        )
    )
    arrays = replace(arrays, materials={"sunny": painted})
    for weather in ("sunny", "heavy_fog"):  # a map shows the ground through any air
        image = pictures_of(arrays, device, PRESETS[weather]).map_view("sunny", (0.0, 0.0), 80.0, width=160, samples=1)
        grey = np.asarray(image.convert("L")).astype(int)
        is_bright = grey > 0.5 * (int(grey.min()) + int(grey.max()))
        assert grey.max() - grey.min() > 60
        rows, columns = np.nonzero(is_bright)
        for found, first in ((columns, 90), (rows, 30)):  # from x = -40 m eastwards, from y = 40 m southwards
            assert found.min() == pytest.approx(first, abs=1)
            assert found.max() == pytest.approx(first + 19, abs=1)
        assert len(rows) == pytest.approx(400, abs=25)


def test_distances_are_those_of_the_pixels_rays(device: str) -> None:
    """A wall 12 m ahead fills the right half of the picture; there is nothing to the left of it."""
    wall = quad_part("Buildings/wall", [(12, -40, -40), (12, 0, -40), (12, 0, 40), (12, -40, 40)], "brick", "building")
    camera = street_camera(64, 48, 1, 90.0)
    found = pictures_of(arrays_from_parts([wall]), device).distances(np.array(pose(0.0, 0.0)), camera)
    v, u = np.indices((48, 64))
    right, down = (u + 0.5 - 32.0) / 32.0, (v + 0.5 - 24.0) / 32.0
    expected = np.where(u >= 32, 12.0 * np.sqrt(1.0 + right**2 + down**2), np.inf)
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_an_actor_is_followed_from_behind_on_its_left() -> None:
    eye, target = follow_view(np.array(pose(100.0, 50.0, 2.0, np.pi / 2)))
    np.testing.assert_allclose(eye, (97.5, 41.0, 5.2))
    np.testing.assert_allclose(target, (100.0, 62.0, 3.0))


def test_a_jpeg_stays_below_its_limit(tmp_path: Path) -> None:
    noise = Image.fromarray(np.random.default_rng(0).integers(0, 256, (120, 160, 3), dtype=np.uint8))
    save_jpeg(noise, tmp_path / "large.jpg", 10**6)
    save_jpeg(noise, tmp_path / "small.jpg", 10_000)
    assert (tmp_path / "small.jpg").stat().st_size < 10_000 < (tmp_path / "large.jpg").stat().st_size
