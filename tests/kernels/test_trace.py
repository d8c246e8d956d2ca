"""The tracer against a float64 brute-force oracle, and the traps of a grouped BVH."""

from dataclasses import replace

import numpy as np
import pytest

from mmw.core.constants import FRAME_DT
from mmw.core.transforms import transform_points
from mmw.scene.device_scene import DeviceScene
from tests.fixtures.device_rays import SWEEP_S, Hits, cast, fast_vehicles, frame_of_its_own, loaded, random_rays
from tests.fixtures.scenes import (
    ABSENT,
    arrays_from_parts,
    box_model,
    closed_box,
    ground_part,
    moving_poses,
    pose,
    random_triangles,
    two_cars,
)
from tests.oracles.tracing import OracleHits, cast_rays, sphere_directions


def assert_equal_hits(found: Hits, wanted: OracleHits) -> np.ndarray:
    """Check hits against the oracle's and return which rays have no second hit nearby, shape [R].

    A ray within float32 of an edge may pass on either side: at most one in a hundred differs in any way.
    """
    clear = np.isclose(found.t, wanted.t, rtol=0.0, atol=1e-3)
    assert (~clear).mean() < 0.01
    alone = clear & ((wanted.next_t > wanted.t + 1e-3) | ~np.isfinite(wanted.t))
    assert alone.mean() > 0.95
    for ours in ("object_id", "material_id", "surface", "face", "instance"):
        theirs = getattr(wanted, ours.replace("material_id", "material"))
        np.testing.assert_array_equal(getattr(found, ours)[alone], theirs[alone], err_msg=ours)
    np.testing.assert_allclose(found.normal[alone], wanted.normal[alone], atol=2e-4)
    return alone


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_hits_equal_the_oracle(device: str, seed: int) -> None:
    arrays = random_triangles(seed, vehicles=40, frames=3)
    scene = loaded(arrays, device)
    origin, direction = random_rays(seed, 600)
    seen = 0
    for batch_index, frame in enumerate(arrays.frames):
        found = cast(scene, batch_index, origin, direction)
        wanted = cast_rays(arrays, frame, origin, direction)
        alone = assert_equal_hits(found, wanted)
        np.testing.assert_array_equal(found.occluded, np.isfinite(found.t))
        seen += int((found.instance[alone] >= 0).sum())
    assert seen > 50, "rays must hit vehicles, or the test shows nothing"


def test_t_max_ends_the_ray(device: str) -> None:
    scene = loaded(arrays_from_parts([ground_part()]), device)
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
    scene = loaded(arrays_from_parts([ground_part()]), device)
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


@pytest.mark.parametrize("constructor", [None, "median"])
def test_tree_rebuilt_in_place_equals_a_new_one(device: str, constructor: str | None) -> None:
    """Presence, number of frames and sweep change from load to load; on a GPU the third load replays a record."""
    arrays, _ = fast_vehicles(21, vehicles=12, frames=7)
    poses = arrays.poses.copy()
    poses[np.random.default_rng(21).random(poses.shape[:2]) < 0.4] = ABSENT
    poses[3], poses[5] = ABSENT, arrays.poses[5]
    arrays = replace(arrays, poses=poses)
    is_there = np.isfinite(poses).all(axis=2)
    origin, direction = random_rays(21, 300)
    times = np.random.default_rng(22).uniform(-SWEEP_S, 0.0, 300)
    scene, ids = DeviceScene(arrays, device, 4, sweep_s=SWEEP_S, instance_constructor=constructor), set()
    for frames in ([0, 1, 2, 3], [3], [5, 3, 4], [6, 6, 0, 5], [1], [2]):
        if frames == [1]:
            scene.sweep_s = 2.0 * SWEEP_S
        scene.load_batch(frames)
        ids.add(int(scene.struct.instances.numpy()[0]))
        wanted = np.zeros(4, dtype=bool)
        wanted[: len(frames)] = is_there[frames].any(axis=1)
        np.testing.assert_array_equal(scene.struct.group_root.numpy() >= 0, wanted)
        new = loaded(arrays, device, frames, 4, sweep_s=SWEEP_S)
        for batch_index, frame in enumerate(frames):
            found = cast(scene, batch_index, origin, direction)
            found.assert_equals(cast(new, batch_index, origin, direction))
            assert is_there[frame][found.instance[found.instance >= 0]].all(), "an absent vehicle is hit"
            swept = cast(scene, batch_index, origin, direction, time_offset=times)
            swept.assert_equals(cast(new, batch_index, origin, direction, time_offset=times))
    if constructor is None:
        assert len(ids) == 1, "kernels that a record holds find the tree where it was"


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
    for batch_index, frame in enumerate(arrays.frames):
        cast(together, batch_index, origin, direction).assert_equals(
            cast(loaded(arrays, device, [frame]), 0, origin, direction)
        )


def test_equal_distances_go_to_the_lower_instance_whatever_the_batch(device: str) -> None:
    """Cars in the same place: the BVH of another batch has another order, the result must not change."""
    rng = np.random.default_rng(0)
    rows = np.array([[pose(*rng.uniform(-30, 30, 2)) for _ in range(12)] for _ in range(4)])
    rows[:, 7] = rows[:, 3]
    rows[:, 9] = rows[:, 3]
    actors = [(f"veh_{v}", "vehicle", 0) for v in range(12)]
    arrays = arrays_from_parts([], [box_model("car")], actors, rows)
    for frames in ([0, 1, 2, 3], [2], [3, 2]):
        scene = loaded(arrays, device, frames)
        for batch_index, frame in enumerate(frames):
            found = cast(scene, batch_index, rows[frame, 3, :3] + [0, 0, 10], (0, 0, -1))
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


@pytest.mark.parametrize("time_offset", [0.0, -0.0025, -SWEEP_S])
def test_hits_of_a_sweep_equal_the_oracle(device: str, time_offset: float) -> None:
    arrays, motion = fast_vehicles(11)
    scene = loaded(arrays, device, sweep_s=SWEEP_S)
    origin, direction = random_rays(11, 600)
    seen = changed = 0
    for batch_index, frame in enumerate(arrays.frames):
        found = cast(scene, batch_index, origin, direction, time_offset=time_offset)
        poses = moving_poses(*motion, FRAME_DT * np.array(arrays.frames) + time_offset)
        wanted = cast_rays(replace(arrays, poses=poses), frame, origin, direction)
        alone = assert_equal_hits(found, wanted)
        still = cast(scene, batch_index, origin, direction)
        same = {name: value for name, value in vars(still).items() if name != "occluded"}
        if time_offset == 0.0:
            for name, value in same.items():  # other instructions on a GPU: the last bits of distances may differ
                np.testing.assert_allclose(getattr(found, name), value, rtol=1e-6, atol=1e-6, err_msg=name)
        seen += int((found.instance[alone] >= 0).sum())
        changed += int((~np.isclose(found.t, still.t)).sum())
    assert seen > 50 and (changed > 50 or time_offset == 0.0), "vehicles must be hit, and have moved"


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
    assert not np.isfinite(cast(scene, 0, (2.3, 0, 5), down, time_offset=times).t).any()  # its front is there later
    ignored = cast(scene, 0, (10, 0, 1), towards, ignore=0, time_offset=times)
    assert not np.isfinite(ignored.t).any()


def test_boxes_hold_a_whole_sweep(device: str) -> None:
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
        # The box of the model and the margin for turning are loose by design; the motion itself is not counted twice.
        assert np.median(slack) < 1.3 + 25.0 * sweep_s


def test_sweep_of_zero_changes_nothing_and_batches_change_nothing(device: str) -> None:
    arrays, _ = fast_vehicles(13)
    origin, direction = random_rays(13, 400)
    times = np.random.default_rng(13).uniform(-SWEEP_S, 0.0, 400)
    plain, swept = loaded(arrays, device), loaded(arrays, device, sweep_s=SWEEP_S)
    for batch_index, frame in enumerate(arrays.frames):
        cast(plain, batch_index, origin, direction).assert_equals(cast(swept, batch_index, origin, direction))
        alone = loaded(arrays, device, [frame], sweep_s=SWEEP_S)
        moving = cast(swept, batch_index, origin, direction, time_offset=times)
        moving.assert_equals(cast(alone, 0, origin, direction, time_offset=times))
