"""The camera benchmarks measure what they say: every image, every ray, the same picture however it is cut up."""

import numpy as np
import pytest
import warp as wp

from bench import rgb
from bench.camera_views import launch_of, rgb_camera
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData
from mmw.sensors import RgbCamera
from mmw.sensors.camera_group.launches import Launch
from tests.fixtures.scenes import box_model, pose, street_canyon

pytestmark = pytest.mark.slow  # benchmarks are not part of the package

VIEWS = 10
"""Four of the CAV and one of the roadside unit in two frames."""

SMALL = RgbCamera(width_px=40, height_px=32)


def street(weathers: list[str]) -> SceneData:
    rows = [[pose(-20.0 + k, -3.0), pose(0.0, 9.0, 5.0, yaw=-np.pi / 2)] for k in range(2)]
    arrays = street_canyon([box_model("car", material=3)], [("cav_1", "cav", 0), ("rsu_1", "rsu", -1)], np.array(rows))
    arrays.materials.update(dict.fromkeys(weathers, arrays.materials["sunny"]))
    return arrays


def loaded(weathers: list[str], config: RgbCamera = SMALL) -> tuple[DeviceScene, Launch]:
    scene = DeviceScene(street(weathers), "cpu", 2)
    scene.load_batch([0, 1])
    return scene, launch_of(scene.arrays, 2, config)


def test_one_weather_and_all_are_measured() -> None:
    scene, launch = loaded(["sunny", "rainy"])
    results = rgb.measure(scene, launch, SMALL, ["sunny", "rainy"], 1, [rgb.DEVICE, rgb.COPY, rgb.FILES])
    assert [(r.weathers, r.where) for r in results] == [
        (weathers, where)
        for where in ("on the device", "with copy", "as JPEG files")
        for weathers in ("sunny", "sunny+rainy")
    ]
    assert [r.images for r in results] == [VIEWS, 2 * VIEWS] * 3
    assert results[0].cost == results[2].cost == 1.0
    assert all(np.isclose(r.images_per_s * r.seconds, r.images) and r.weathers in rgb.line(r) for r in results)


def test_every_kernel_has_its_stage_and_every_ray_a_thread() -> None:
    scene, launch = loaded(["sunny", "rainy"])
    found = rgb.measure_stages(scene, launch, SMALL, ["sunny", "rainy"], 1)
    allowed = {*rgb.STAGES, "streaks_kernel"}
    assert set(rgb.STAGES) <= set(found.milliseconds) <= allowed, "a kernel belongs to no stage"
    assert all(spent > 0.0 for spent in found.milliseconds.values())
    views = sum(threads for kernel, threads in found.rays.items() if "visibility" in kernel)
    assert views >= VIEWS * 40 * 32
    for stage in ("visibility", "light", "reflections"):
        assert any(rgb.stage_of(kernel) == stage and threads > 0 for kernel, threads in found.rays.items())
    assert 0.0 < found.tracing_ms <= sum(found.milliseconds.values())
    assert all(name in rgb.stage_lines(found) for name in (*rgb.STAGES, *found.rays))


def test_what_is_off_takes_no_rays() -> None:
    plain = SMALL.model_copy(update={"samples": 1, "shadows": False, "sky_light": False, "reflections": False})
    scene, launch = loaded(["sunny"], plain)
    launch_before = wp.launch
    found = rgb.measure_stages(scene, launch, plain, ["sunny"], 1)
    assert wp.launch is launch_before
    assert {rgb.stage_of(kernel) for kernel, threads in found.rays.items() if threads} == {"visibility"}


def test_pieces_are_the_pictures_of_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    scene, launch = loaded(["sunny"])
    camera = rgb_camera(scene, ["sunny"])
    (whole,) = rgb.render(scene, camera, launch, SMALL, ["sunny"], rgb.COPY)
    monkeypatch.setattr(rgb, "max_pixels", lambda _: 3 * 40 * 32)
    pieces = rgb.render(scene, camera, launch, SMALL, ["sunny"], rgb.COPY)
    assert [len(piece) for piece in pieces] == [3, 3, 3, 1]
    np.testing.assert_array_equal(np.concatenate(pieces), whole)
    assert whole.shape == (VIEWS, 32, 40, 3) and whole.std() > 5.0


def test_few_views_are_the_first() -> None:
    scene, launch = loaded(["sunny"])
    few = launch_of(scene.arrays, 2, SMALL, max_views=3)
    assert len(launch.views) == VIEWS and len(few.views) == 3
    np.testing.assert_array_equal(few.views.pose, launch.views.pose[:3])
