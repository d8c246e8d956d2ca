"""The tracer against a float64 brute-force oracle, and the traps of a grouped tree."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import warp as wp

from mmw.core.constants import FRAME_DT
from mmw.core.transforms import make_pose, normalize, transform_points
from mmw.kernels.core import structs, trace
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData
from tests.fixtures.scenes import (
    ABSENT,
    arrays_from_parts,
    box_model,
    closed_box,
    ground_and_wall,
    ground_part,
    moving_poses,
    pose,
    random_triangles,
    two_cars,
)
from tests.oracles.tracing import cast_rays, sphere_directions


@dataclass
class Hits:
    t: np.ndarray
    object_id: np.ndarray
    material_id: np.ndarray
    surface: np.ndarray
    face: np.ndarray
    instance: np.ndarray
    normal: np.ndarray
    occluded: np.ndarray

    def assert_equals(self, other: "Hits") -> None:
        for name, value in vars(self).items():
            np.testing.assert_array_equal(value, getattr(other, name), err_msg=name)


def cast(scene: DeviceScene, slot, origin, direction, t_max: float = 1.0e4, ignore=-1, time_offset=None) -> Hits:
    """Trace rays on the scene's device; `slot`, `origin`, `ignore` and `time_offset` broadcast to the rays.

    With a time offset they are rays of a rolling sweep.
    """
    direction = np.atleast_2d(np.asarray(direction, dtype=np.float64))
    count = len(direction)
    origin = np.broadcast_to(np.asarray(origin, dtype=np.float64) - scene.origin, (count, 3))
    device = scene.device
    hit = wp.zeros(count, dtype=structs.Hit, device=device)
    blocked = wp.zeros(count, dtype=wp.bool, device=device)
    inputs = [
        scene.struct,
        wp.array(np.broadcast_to(slot, count).astype(np.int32), dtype=int, device=device),
        wp.array(origin.astype(np.float32), dtype=wp.vec3, device=device),
        wp.array(direction.astype(np.float32), dtype=wp.vec3, device=device),
        t_max,
        wp.array(np.broadcast_to(ignore, count).astype(np.int32), dtype=int, device=device),
    ]
    if time_offset is None:
        wp.launch(trace.cast_kernel, dim=count, inputs=inputs, outputs=[hit, blocked], device=device, block_dim=64)
    else:
        inputs.append(wp.array(np.broadcast_to(time_offset, count).astype(np.float32), dtype=float, device=device))
        wp.launch(trace.cast_at_kernel, dim=count, inputs=inputs, outputs=[hit], device=device, block_dim=64)
    rows = hit.numpy()
    return Hits(**{name: rows[name].copy() for name in rows.dtype.names}, occluded=blocked.numpy())


def loaded(
    arrays: SceneData, device: str, frames=None, max_slots: int | None = None, sweep_s: float = 0.0
) -> DeviceScene:
    frames = list(arrays.frames) if frames is None else frames
    scene = DeviceScene(arrays, device, max_slots or len(frames), sweep_s=sweep_s)
    scene.load_batch(frames)
    return scene


def random_rays(seed: int, count: int, half: float = 20.0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(count, 3))
    direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    return rng.uniform(-half, half, (count, 3)).astype(np.float32).astype(float), direction.astype(np.float32).astype(
        float
    )


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_hits_equal_the_oracle(device: str, seed: int) -> None:
    arrays = random_triangles(seed, vehicles=40, frames=3)
    scene = loaded(arrays, device)
    origin, direction = random_rays(seed, 600)
    seen = 0
    for slot, frame in enumerate(arrays.frames):
        found = cast(scene, slot, origin, direction)
        wanted = cast_rays(arrays, frame, origin, direction)
        # A ray within float32 of an edge may pass on either side: at most one in a hundred differs in any way.
        clear = np.isclose(found.t, wanted.t, rtol=0.0, atol=1e-3)
        assert (~clear).mean() < 0.01
        alone = clear & ((wanted.next_t > wanted.t + 1e-3) | ~np.isfinite(wanted.t))
        assert alone.mean() > 0.95
        for name, ours in (("object_id", "object_id"), ("material", "material_id"), ("surface", "surface")):
            np.testing.assert_array_equal(getattr(found, ours)[alone], getattr(wanted, name)[alone], err_msg=name)
        np.testing.assert_array_equal(found.face[alone], wanted.face[alone])
        np.testing.assert_array_equal(found.instance[alone], wanted.instance[alone])
        np.testing.assert_allclose(found.normal[alone], wanted.normal[alone], atol=2e-4)
        np.testing.assert_array_equal(found.occluded, np.isfinite(found.t))
        seen += int((found.instance[alone] >= 0).sum())
    assert seen > 50, "rays must meet vehicles, or the test shows nothing"


def test_t_max_ends_the_ray(device: str) -> None:
    scene = loaded(ground_and_wall(), device)
    origin, down = (0.0, 0.0, 5.0), (0.0, 0.0, -1.0)
    short, long = cast(scene, 0, origin, down, 4.999), cast(scene, 0, origin, down, 5.001)
    assert (
        short.t[0] == np.inf and short.object_id[0] == short.face[0] == short.surface[0] == short.material_id[0] == -1
    )
    assert not short.occluded[0]
    assert long.occluded[0]
    np.testing.assert_allclose(long.t[0], 5.0, atol=1e-6)


def test_t_max_ends_the_ray_at_a_vehicle(device: str) -> None:
    arrays = arrays_from_parts([], [box_model("car")], [("veh", "vehicle", 0)], [[pose(10.0, 0.0)]])
    scene = loaded(arrays, device)
    front = 10.0 - 2.25
    assert not cast(scene, 0, (0, 0, 1), (1, 0, 0), front - 1e-3).occluded[0]
    assert cast(scene, 0, (0, 0, 1), (1, 0, 0), front - 1e-3).t[0] == np.inf
    assert cast(scene, 0, (0, 0, 1), (1, 0, 0), front + 1e-3).occluded[0]


def test_every_ray_of_a_closed_box_hits(device: str) -> None:
    found = cast(loaded(closed_box(), device), 0, (0.3, -0.2, 0.1), sphere_directions(5000))
    assert np.isfinite(found.t).all()
    assert set(found.surface) == set(range(6))


def test_normal_faces_the_ray_from_either_side(device: str) -> None:
    scene = loaded(ground_and_wall(), device)
    above = cast(scene, 0, (0, 0, 5), (0, 0, -1))
    below = cast(scene, 0, (0, 0, -5), (0, 0, 1))
    np.testing.assert_allclose(above.normal[0], [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(below.normal[0], [0, 0, -1], atol=1e-6)


def test_ignored_instance_is_transparent(device: str) -> None:
    arrays = two_cars()
    scene = loaded(arrays, device)
    start = np.array([-20.0, -3.0, 0.75])  # inside cav_1 of frame 0
    inside = cast(scene, 0, start, (1, 0, 0))
    assert inside.instance[0] == 0 and inside.object_id[0] == arrays.actors[0].object_id
    through = cast(scene, 0, start, (0, -1, 0), ignore=0)
    assert through.instance[0] == -1
    np.testing.assert_allclose(through.t[0], 7.0, atol=1e-5)
    assert cast(scene, 0, start, (0, -1, 0), 5.0, ignore=-1).occluded[0]
    assert not cast(scene, 0, start, (0, -1, 0), 5.0, ignore=0).occluded[0]


def test_surface_ids_are_global(device: str) -> None:
    arrays = two_cars(1)
    scene = loaded(arrays, device)
    assert scene.surface_count == arrays.town_surface_count + 12
    np.testing.assert_array_equal(scene.surface_offset, arrays.town_surface_count + np.array([0, 6]))
    hit = cast(scene, 0, (20.0, 3.0, 10.0), (0, 0, -1))
    assert hit.instance[0] == 1
    assert scene.surface_offset[1] <= hit.surface[0] < scene.surface_offset[1] + 6


def frame_of_its_own(frames: int = 5) -> SceneData:
    """One car, which is present in frame 2 only; no town."""
    rows = [[ABSENT] for _ in range(frames)]
    rows[2] = [pose(10.0, 0.0)]
    return arrays_from_parts([], [box_model("car")], [("veh", "vehicle", 0)], rows)


def test_root_minus_one_of_an_empty_frame_is_not_the_whole_tree(device: str) -> None:
    """`wp.bvh_get_group_root` gives -1 for a frame without vehicles; a query would read that as all vehicles."""
    scene = loaded(frame_of_its_own(), device)
    roots = scene.struct.group_root.numpy()
    np.testing.assert_array_equal(roots[[0, 1, 3, 4]], -1)
    assert roots[2] >= 0
    found = cast(scene, np.arange(5), (0, 0, 0.75), np.tile([1.0, 0, 0], (5, 1)))
    np.testing.assert_array_equal(np.isfinite(found.t), [False, False, True, False, False])
    np.testing.assert_array_equal(found.occluded, [False, False, True, False, False])


def test_roots_are_fetched_again_for_every_batch(device: str) -> None:
    scene = DeviceScene(frame_of_its_own(), device, 5)
    for frames in ([2, 0], [0, 2], [0, 1, 3], [2, 2, 2, 2, 2], [2]):
        scene.load_batch(frames)
        found = cast(scene, np.arange(len(frames)), (0, 0, 0.75), np.tile([1.0, 0, 0], (len(frames), 1)))
        np.testing.assert_array_equal(np.isfinite(found.t), [frame == 2 for frame in frames], err_msg=str(frames))


def test_absent_instance_is_not_at_the_origin(device: str) -> None:
    rows = [[pose(10.0, 0.0), ABSENT]]
    actors = [("a", "vehicle", 0), ("b", "vehicle", 0)]
    scene = loaded(arrays_from_parts([ground_part()], [box_model("car")], actors, rows), device)
    found = cast(scene, 0, (0, 0, 20), (0, 0, -1))
    assert found.instance[0] == -1
    np.testing.assert_allclose(found.t[0], 20.0, atol=1e-5)


def test_scene_without_anything(device: str) -> None:
    found = cast(loaded(arrays_from_parts([]), device), 0, (0, 0, 0), sphere_directions(16))
    assert not np.isfinite(found.t).any() and not found.occluded.any()


def test_batch_equals_single_frames(device: str) -> None:
    arrays = random_triangles(5, vehicles=8, frames=6)
    origin, direction = random_rays(5, 300)
    together = loaded(arrays, device)
    for slot, frame in enumerate(arrays.frames):
        cast(together, slot, origin, direction).assert_equals(
            cast(loaded(arrays, device, [frame]), 0, origin, direction)
        )


def test_two_runs_are_bit_equal(device: str) -> None:
    arrays = random_triangles(6, vehicles=8, frames=2)
    origin, direction = random_rays(6, 400)
    first = cast(loaded(arrays, device), 1, origin, direction)
    first.assert_equals(cast(loaded(arrays, device), 1, origin, direction))


def test_equal_distances_go_to_the_lower_instance_whatever_the_batch(device: str) -> None:
    """Cars in the same place: the tree of another batch meets them in another order, the answer must not change."""
    rng = np.random.default_rng(0)
    rows = np.array([[pose(*rng.uniform(-30, 30, 2)) for _ in range(12)] for _ in range(4)])
    rows[:, 7] = rows[:, 3]
    rows[:, 9] = rows[:, 3]
    actors = [(f"veh_{v}", "vehicle", 0) for v in range(12)]
    arrays = arrays_from_parts([], [box_model("car")], actors, rows)
    for frames in ([0, 1, 2, 3], [2], [3, 2]):
        scene = loaded(arrays, device, frames)
        for slot, frame in enumerate(frames):
            found = cast(scene, slot, rows[frame, 3, :3] + [0, 0, 10], (0, 0, -1))
            assert found.instance[0] == 3


def test_town_far_from_the_origin_is_rebased(device: str) -> None:
    near = random_triangles(8, vehicles=4, frames=1)
    shift = np.array([500_000.0, 4_000_000.0, 100.0])
    poses = near.poses.copy()
    poses[..., :3] += shift
    far = replace(near, points=near.points + shift, poses=poses)
    origin, direction = random_rays(8, 300)
    scene = loaded(far, device)
    assert np.abs(scene.origin - shift).max() < 30.0
    found, wanted = cast(scene, 0, origin + shift, direction), cast(loaded(near, device), 0, origin, direction)
    same = found.object_id == wanted.object_id
    assert same.mean() > 0.99
    np.testing.assert_allclose(found.t[same], wanted.t[same], atol=1e-3)


SWEEP_S = 0.01


def fast_vehicles(seed: int, vehicles: int = 40, frames: int = 3) -> tuple[SceneData, tuple[np.ndarray, ...]]:
    """Return a scene of vehicles at 40 m/s that turn about any axis, and their poses at frame 0, velocity and rate."""
    rng = np.random.default_rng(seed)
    arrays = random_triangles(seed, vehicles=vehicles, frames=frames)
    velocity = 40.0 * normalize(rng.normal(size=(vehicles, 4)))[:, :3]
    start = make_pose(rng.uniform(-20, 20, (vehicles, 3)), normalize(rng.normal(size=(vehicles, 4))))
    motion = start, velocity, rng.uniform(-3, 3, (vehicles, 3))
    return replace(arrays, poses=moving_poses(*motion, FRAME_DT * np.arange(frames))), motion


@pytest.mark.parametrize("time_offset", [0.0, -0.0025, -SWEEP_S])
def test_hits_of_a_sweep_equal_the_oracle(device: str, time_offset: float) -> None:
    arrays, motion = fast_vehicles(11)
    scene = loaded(arrays, device, sweep_s=SWEEP_S)
    origin, direction = random_rays(11, 600)
    seen = changed = 0
    for slot, frame in enumerate(arrays.frames):
        found = cast(scene, slot, origin, direction, time_offset=time_offset)
        poses = moving_poses(*motion, FRAME_DT * np.array(arrays.frames) + time_offset)
        wanted = cast_rays(replace(arrays, poses=poses), frame, origin, direction)
        clear = np.isclose(found.t, wanted.t, rtol=0.0, atol=1e-3)
        assert (~clear).mean() < 0.01
        alone = clear & ((wanted.next_t > wanted.t + 1e-3) | ~np.isfinite(wanted.t))
        assert alone.mean() > 0.95
        for name, ours in (("object_id", "object_id"), ("material", "material_id"), ("surface", "surface")):
            np.testing.assert_array_equal(getattr(found, ours)[alone], getattr(wanted, name)[alone], err_msg=name)
        np.testing.assert_array_equal(found.face[alone], wanted.face[alone])
        np.testing.assert_array_equal(found.instance[alone], wanted.instance[alone])
        np.testing.assert_allclose(found.normal[alone], wanted.normal[alone], atol=2e-4)
        still = cast(scene, slot, origin, direction)
        same = {name: value for name, value in vars(still).items() if name != "occluded"}
        if time_offset == 0.0:
            for name, value in same.items():  # other instructions on a GPU: the last bits of distances may differ
                np.testing.assert_allclose(getattr(found, name), value, rtol=1e-6, atol=1e-6, err_msg=name)
        seen += int((found.instance[alone] >= 0).sum())
        changed += int((~np.isclose(found.t, still.t)).sum())
    assert seen > 50 and (changed > 50 or time_offset == 0.0), "vehicles must be met, and have moved"


def test_each_ray_of_a_sweep_has_its_own_time(device: str) -> None:
    """A car 4.5 m long at 40 m/s: its front, at x = 2.25 in the frame, is 0.4 m further back 10 ms before."""
    rows = [[pose(40.0 * FRAME_DT * k, 0.0)] for k in range(-1, 2)]
    arrays = arrays_from_parts([], [box_model("car")], [("car", "vehicle", 0)], rows, first_frame=6)
    scene = loaded(arrays, device, [7], sweep_s=SWEEP_S)
    times = np.linspace(-SWEEP_S, 0.0, 9)
    towards = np.tile([-1.0, 0.0, 0.0], (9, 1))
    np.testing.assert_allclose(cast(scene, 0, (10, 0, 1), towards, time_offset=times).t, 7.75 - 40.0 * times, atol=1e-5)
    down = np.tile([0.0, 0.0, -1.0], (9, 1))
    behind = cast(scene, 0, (-2.47, 0, 5), down, time_offset=times)  # its rear end passed 5.5 ms before the frame
    np.testing.assert_array_equal(np.isfinite(behind.t), times < -0.0055)
    assert not np.isfinite(cast(scene, 0, (2.3, 0, 5), down, time_offset=times).t).any()  # its front comes there later
    ignored = cast(scene, 0, (10, 0, 1), towards, ignore=0, time_offset=times)
    assert not np.isfinite(ignored.t).any()


def test_boxes_hold_the_way_of_a_sweep(device: str) -> None:
    arrays, motion = fast_vehicles(12, vehicles=20)
    for sweep_s in (0.0, SWEEP_S, 0.1):
        scene = loaded(arrays, device, sweep_s=sweep_s)
        lower, upper = (box.numpy().reshape(3, 20, 3) for box in (scene._lower, scene._upper))
        slack = []
        for frame in arrays.frames:
            poses = moving_poses(*motion, FRAME_DT * frame - sweep_s * np.linspace(0.0, 1.0, 21))
            for v in range(20):
                points = transform_points(poses[:, v, None], arrays.models[v].points)
                assert (points.min(axis=(0, 1)) >= lower[frame, v]).all()
                assert (points.max(axis=(0, 1)) <= upper[frame, v]).all()
                slack.append(
                    np.concatenate(
                        [points.min(axis=(0, 1)) - lower[frame, v], upper[frame, v] - points.max(axis=(0, 1))]
                    )
                )
        # The box of the model and the widening for turning are loose by design; the way itself is not counted twice.
        assert np.median(slack) < 1.3 + 25.0 * sweep_s


def test_sweep_of_zero_changes_nothing_and_batches_change_nothing(device: str) -> None:
    arrays, _ = fast_vehicles(13)
    origin, direction = random_rays(13, 400)
    times = np.random.default_rng(13).uniform(-SWEEP_S, 0.0, 400)
    plain, swept = loaded(arrays, device), loaded(arrays, device, sweep_s=SWEEP_S)
    for slot, frame in enumerate(arrays.frames):
        cast(plain, slot, origin, direction).assert_equals(cast(swept, slot, origin, direction))
        alone = loaded(arrays, device, [frame], sweep_s=SWEEP_S)
        cast(swept, slot, origin, direction, time_offset=times).assert_equals(
            cast(alone, 0, origin, direction, time_offset=times)
        )
