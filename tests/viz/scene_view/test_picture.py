"""Pictures with paths, coverage and antennas in them: where they are drawn, and what surfaces hide."""

import numpy as np
import pytest

from mmw.channel import Paths, PathSolver
from mmw.channel.radio_map.radio_map import RadioMap
from mmw.core.errors import InputError
from mmw.core.transforms import pose_from_ypr
from mmw.physics.weather.weather import PRESETS
from mmw.scene import Receiver, Scene, Transmitter
from mmw.sensors.rgb.config import RgbCamera
from mmw.viz.plots.style import ORANGE, scale_colors
from mmw.viz.scene_view import render_picture
from mmw.viz.scene_view.coverage import choose_coverage
from mmw.viz.scene_view.picture import COVERAGE_SHARE, DASH_PX, dashes
from tests.fixtures.scenes import arrays_from_parts, ground_part, quad_part

SIZE = {"width_px": 200, "height_px": 100}
CAMERA = RgbCamera(width_px=200, height_px=100, fov_deg=90.0, samples=1)
"""A point at (x, y, z) of the camera is at pixel (100 - 100 y / x, 50 - 100 z / x)."""

LEVEL = pose_from_ypr((0.0, 0.0, 2.0), 0.0, 0.0)
RED = np.array(scale_colors(1.0, 0.0, 1.0), dtype=float)
"""Color of the strongest path."""


@pytest.fixture(scope="module")
def behind() -> tuple[Scene, Paths]:
    """Return a scene with a wall over the left half of the picture, and a path that goes behind it."""
    wall = quad_part(
        "Buildings/wall", [(10, 0, 0), (10, 30, 0), (10, 30, 20), (10, 0, 20)], "concrete_facade", "building"
    )
    scene = Scene(arrays_from_parts([ground_part(60.0), wall]), {"sunny": PRESETS["sunny"]}, device="cpu", name="wall")
    scene.add(Transmitter("tx", position=(20.0, 8.0, 2.4)))  # behind the wall, at pixel (60, 48)
    scene.add(Receiver("rx", position=(20.0, -10.0, 2.4)))  # beside it, at pixel (150, 48)
    return scene, PathSolver(max_depth=0)(scene)


def array(image) -> np.ndarray:
    return np.asarray(image, dtype=float)


def is_red(pixels: np.ndarray, limit: float = 60.0) -> np.ndarray:
    return np.abs(pixels - RED).max(axis=-1) < limit


def test_a_path_is_solid_where_it_is_seen_and_dashed_behind_a_wall(behind: tuple[Scene, Paths]) -> None:
    scene, paths = behind
    options = {"pose": LEVEL, "camera": CAMERA, "show_devices": False, "show_legend": False}
    plain, drawn = array(render_picture(scene, **options)), array(render_picture(scene, paths=paths, **options))
    changed = np.abs(drawn - plain).max(axis=-1) > 20.0
    row = changed[46:50, 60:151].any(axis=0)  # columns 60 to 150 of the rows around 48
    assert row[42:].all()  # from column 102 on in front of nothing
    assert 0.3 < row[:38].mean() < 0.7  # dashes of 7 px and gaps of 7 px
    assert is_red(drawn[47:49, 110:140]).all()
    assert not is_red(drawn[47:49, 62:96]).any()  # faint
    over = array(render_picture(scene, paths=paths, occlude=False, **options))
    assert is_red(over[47:49, 66:146]).all()


def test_antennas_behind_a_wall_are_outlines(behind: tuple[Scene, Paths]) -> None:
    scene, _ = behind
    image = array(render_picture(scene, pose=LEVEL, camera=CAMERA))
    orange = np.array(list(bytes.fromhex(ORANGE[1:])), dtype=float)
    assert np.abs(image[48, 150] - orange).max() < 30.0  # a disc
    plain = array(render_picture(scene, pose=LEVEL, camera=CAMERA, show_devices=False))
    np.testing.assert_array_equal(image[48, 60], plain[48, 60])  # nothing in the middle of the outline
    assert (np.abs(image - plain).max(axis=-1)[40:58, 50:70] > 30.0).any()
    assert (image == plain).all(axis=-1)[60:].all()


def test_a_picture_from_an_eye_is_that_of_the_pose(behind: tuple[Scene, Paths]) -> None:
    scene, paths = behind
    one = render_picture(scene, pose=LEVEL, camera=CAMERA, paths=paths)
    other = render_picture(scene, eye=(0, 0, 2), look_at=(5, 0, 2), camera=CAMERA, paths=paths)
    np.testing.assert_array_equal(array(one), array(other))
    assert render_picture(scene, eye=(0, 0, 2), look_at=(5, 0, 2), width_px=64, height_px=32).size == (64, 32)
    assert render_picture(scene, pose=LEVEL, camera=CAMERA, height_px=50).size == (200, 50)


def test_coverage_lies_on_its_cells(street: Scene, street_map: RadioMap) -> None:
    """From straight above, cells are squares of pixels that can be counted."""
    pose = pose_from_ypr((0.0, 0.0, 41.0), np.pi / 2, np.pi / 2)  # 40 m over the map: 100 px are 40 m, north up
    options = {"pose": pose, "camera": CAMERA, "show_devices": False, "show_legend": False}
    plain = array(render_picture(street, **options))
    drawn = array(render_picture(street, radio_map=street_map, metric="sinr", **options))
    coverage = choose_coverage(street_map, "sinr")
    number = {tuple(np.floor(corners.mean(axis=0)[:2] / 4.0).astype(int)): k for k, corners in enumerate(
        coverage.triangles.reshape(-1, 6, 3))}  # fmt: skip
    compared = 0
    for row in range(2, 100, 10):
        for column in range(4, 200, 10):
            x, y = (column + 0.5 - 100.0) * 0.4, (50.0 - row - 0.5) * 0.4
            if abs(y) > 9.0 or 14.0 < abs(x) < 26.0:
                continue  # the walls hide what is outside, the cars what is under them
            cell = number.get((int(np.floor(x / 4.0)), int(np.floor(y / 4.0))))
            expected = plain[row, column]
            if cell is not None:
                expected = (1 - COVERAGE_SHARE) * expected + COVERAGE_SHARE * coverage.colors[cell]
                compared += 1
            np.testing.assert_allclose(drawn[row, column], expected, atol=1.0)
    assert compared > 30


def test_coverage_behind_a_wall_is_hidden(behind: tuple[Scene, Paths], street_map: RadioMap) -> None:
    """The cells behind the wall are not seen, those before and beside it are."""
    scene, _ = behind
    options = {"pose": LEVEL, "camera": CAMERA, "show_devices": False, "show_legend": False}
    plain = array(render_picture(scene, **options))
    drawn = array(render_picture(scene, radio_map=street_map, **options))
    over = array(render_picture(scene, radio_map=street_map, occlude=False, **options))
    changed, whole = ((np.abs(one - plain).max(axis=-1) > 2.0) for one in (drawn, over))
    # The map is 1 m below the camera: its row at a distance x is 50 + 100 / x. The wall stands at x = 10: row 60.
    assert changed[64:, 70:99].mean() > 0.9
    assert not changed[52:59, 70:99].any() and whole[53:59, 70:99].any()
    assert changed[54:59, 104:160].mean() > 0.9


def test_what_is_drawn_is_written_on_the_picture(
    street: Scene, street_paths: Paths, street_map: RadioMap, monkeypatch: pytest.MonkeyPatch
) -> None:
    import mmw.viz.scene_view.picture as module

    told: list[tuple] = []
    real = module.legend_image

    def legend(bars, lines, scale):
        told.append((bars, lines))
        return real(bars, lines, scale)

    monkeypatch.setattr(module, "legend_image", legend)
    options = {"eye": (-45.0, 0.0, 20.0), "look_at": (0.0, 0.0, 0.0), **SIZE}
    render_picture(street, **options)
    assert told == []  # a picture alone has no legend
    render_picture(street, paths=street_paths, radio_map=street_map, metric="rss", max_paths=5, **options)
    (bars, lines), gains = told[0], np.sort(20.0 * np.log10(np.abs(street_paths.a[:, 0])))[-5:]
    assert [bar.title for bar in bars] == ["path gain [dB]", "coverage: RSS [dBm]"]
    assert (bars[0].low, bars[0].high) == pytest.approx((gains[0], gains[-1]))
    assert lines[:3] == [
        "5 paths at 28 GHz", f"strongest: los, {gains[-1]:.1f} dB",
        f"the weakest {len(street_paths) - 5} are left out",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "no view given; eye and look_at, or pose"),
        ({"eye": (0, 0, 2)}, "eye given; eye and look_at, or pose"),
        ({"eye": (0, 0, 2), "look_at": (1, 0, 2), "pose": LEVEL}, "eye and look_at and pose given"),
        ({"eye": (0, 0, np.nan), "look_at": (1, 0, 2)}, r"eye = \(0.0, 0.0, nan\); 3 finite numbers"),
        ({"eye": (0, 0, 2), "look_at": (0, 0, 2)}, "both"),
        ({"pose": (0, 0, 0, 0, 0, 0, 0)}, r"rotation of the pose = \(0, 0, 0, 0\)"),
        ({"pose": LEVEL, "path_width_px": 0.0}, "path_width_px = 0"),
        ({"pose": LEVEL, "weather": "snowy"}, "weather 'snowy'"),
        ({"pose": LEVEL, "width_px": 0}, "width_px"),
    ],
)
def test_views_that_cannot_be_are_refused(street: Scene, options: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        render_picture(street, **options)


def test_paths_of_another_scene_are_refused(street: Scene, behind: tuple[Scene, Paths]) -> None:
    with pytest.raises(InputError, match="of scene 'wall', frame 0; the scene is 'street'"):
        render_picture(street, pose=LEVEL, paths=behind[1])


def test_dashes_are_half_of_a_line() -> None:
    bent = np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 50.0]])
    found = dashes(bent)
    assert len(found) == 5
    lengths = [np.linalg.norm(np.diff(one, axis=0), axis=1).sum() for one in found]
    np.testing.assert_allclose(lengths, DASH_PX)
    np.testing.assert_allclose(found[1], [(14, 0), (20, 0), (20, 1)])  # around the corner
    assert dashes(np.zeros((1, 2))) == []
