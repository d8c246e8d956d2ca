"""The benchmark's kernels trace every ray once, and the order of the rays changes no value."""

from pathlib import Path

import numpy as np
import pytest
import warp as wp

from bench import first_hit
from bench.rays import PRESETS, compare, make_views
from bench.scenes import grid_town, with_vehicles
from mmw.config.lens import LensConfig
from mmw.kernels.core import structs
from mmw.scene.device_scene import DeviceScene
from mmw.sensors import Lidar
from mmw.sensors.lidar.scan_pattern import lidar_pattern
from tests.fixtures.device_rays import loaded
from tests.fixtures.scenes import two_cars
from tests.fixtures.traced_depth import pixel_rays

pytestmark = pytest.mark.slow  # benchmarks are not part of the package


def small_scene(device: str) -> tuple[DeviceScene, structs.Views]:
    scene, views = loaded(two_cars(2), device), structs.Views()
    views.batch_index = wp.array([0, 1], dtype=wp.int32, device=device)
    views.pose = wp.array([[0, 0, 3, 0, 0, 0, 1], [1, 0, 3, 0, 0, 0.6, 0.8]], dtype=wp.transformf, device=device)
    views.ignore = wp.array([-1, 0], dtype=wp.int32, device=device)
    return scene, views


def trace(
    kernel: wp.Kernel, scene: DeviceScene, views: structs.Views, rays: int, *values
) -> tuple[np.ndarray, np.ndarray]:
    t = wp.full((2, rays), -1.0, dtype=float, device=scene.device)
    objects = wp.full((2, rays), -7, dtype=int, device=scene.device)
    inputs = [scene.struct, views, *values]
    wp.launch(kernel, dim=(2, rays), inputs=inputs, outputs=[t, objects], device=scene.device, block_dim=64)
    return t.numpy(), objects.numpy()


@pytest.mark.parametrize("arm", [55, 233])
def test_spiral_order_changes_no_ray(device: str, arm: int) -> None:
    scene, views = small_scene(device)
    plain = trace(first_hit.sphere_kernel, scene, views, 5000, 5000, 1)
    spirals = trace(first_hit.sphere_kernel, scene, views, 5000, 5000, arm)
    assert (plain[1] >= 0).mean() > 0.5
    np.testing.assert_array_equal(plain[0], spirals[0])
    np.testing.assert_array_equal(plain[1], spirals[1])


def test_tiled_pixels_look_where_the_camera_model_says(device: str) -> None:
    scene, views = small_scene(device)
    camera = LensConfig().intrinsics(48, 32, 80.0)
    rays = camera.width * camera.height
    tiled = trace(first_hit.camera_kernel, scene, views, rays, camera.width, camera.fx)
    table = wp.array(pixel_rays(camera).astype(np.float32), dtype=wp.vec3, device=device)
    order = wp.array(np.arange(rays)[::-1].astype(np.int32), dtype=wp.int32, device=device)
    rows = trace(first_hit.lidar_kernel, scene, views, rays, table, order)
    assert (tiled[1] >= 0).mean() > 0.5
    assert (tiled[1] != rows[1]).mean() < 0.005
    np.testing.assert_allclose(tiled[0], rows[0], rtol=2e-4)


def test_measured_scene_is_large_enough() -> None:
    arrays = with_vehicles(grid_town(), 2)
    assert len(arrays.faces) >= 100_000
    assert len(arrays.actors) >= 40
    assert np.isfinite(arrays.poses).all()
    for preset in PRESETS:
        assert len(make_views(arrays, preset, "cpu").batch_index) == 2 * preset.views_per_frame
    assert lidar_pattern(Lidar()).shape == (PRESETS[2].rays_per_view, 3)


def test_hits_that_differ_are_counted(tmp_path: Path) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    for folder, t, objects in (
        (one, [1.0, 2.0, 3.0, 4.0, np.inf, np.inf], [0, 1, 2, 3, -1, -1]),
        (other, [1.0, 2.0001, 3.01, 4.0, np.inf, 5.0], [0, 1, 2, 4, -1, 3]),
    ):
        folder.mkdir()
        np.save(folder / "sphere-static-t.npy", np.array([t], np.float32))
        np.save(folder / "sphere-static-object.npy", np.array([objects]))
    differing, apart = compare(one, other, "sphere-static")
    assert differing == 3
    np.testing.assert_allclose(apart, 1e-4, rtol=1e-2)
