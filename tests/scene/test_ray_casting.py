"""Single rays into a scene: the surfaces of the brute-force oracle, and misses."""

import numpy as np

from mmw.scene.device_scene import DeviceScene
from mmw.scene.ray_casting import cast_rays
from tests.fixtures.device_rays import loaded
from tests.fixtures.scenes import random_triangles
from tests.oracles.tracing import cast_rays as oracle


def test_rays_hit_what_brute_force_finds(device: str) -> None:
    arrays = random_triangles(3, 200, vehicles=4, frames=2)
    scene = DeviceScene(arrays, device, 2)
    frames = list(arrays.frames[:2])
    scene.load_batch(frames)
    generator = np.random.default_rng(7)
    origins = generator.uniform(-20.0, 20.0, (2000, 3))
    directions = generator.normal(size=(2000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for index, frame in enumerate(frames):
        found = cast_rays(scene, origins, directions, batch_index=index)
        wanted = oracle(arrays, frame, origins, directions)
        is_hit = np.isfinite(wanted.t)
        assert 100 < is_hit.sum() < 2000
        np.testing.assert_array_equal(found.object_id, wanted.object_id)
        np.testing.assert_allclose(found.distance, wanted.t, rtol=1e-5, atol=1e-4)  # float32 on the device
        np.testing.assert_allclose(found.normal[is_hit], wanted.normal[is_hit], atol=1e-4)
        assert (found.material_id[~is_hit] == -1).all() and not found.normal[~is_hit].any()
        short = cast_rays(scene, origins, directions, batch_index=index, max_distance=5.0)
        is_near = np.abs(wanted.t - 5.0) > 1e-3
        np.testing.assert_array_equal(np.isfinite(short.distance)[is_near], (wanted.t < 5.0)[is_near])


def test_one_ray_needs_no_list(device: str) -> None:
    scene = loaded(random_triangles(3, 10), device)
    assert cast_rays(scene, (0, 0, 900.0), (0, 0, 1.0)).distance.tolist() == [np.inf]
