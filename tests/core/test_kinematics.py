"""Motion of surfaces and sensors: finite differences of world positions in float64, closed forms of a wheel."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from mmw.config import MountConfig
from mmw.core.constants import FRAME_DT
from mmw.core.kinematics import Motion, differentiate, differentiate_row, placed
from mmw.core.transforms import (
    invert,
    make_pose,
    multiply,
    normalize,
    pose_from_ypr,
    quaternion_exp,
    rotate,
    transform_points,
)
from mmw.kernels.core import rigid_motion as motion
from mmw.kernels.core import structs
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import Prototype, SceneData
from mmw.scene.views import make_views, view_twists
from mmw.sensors import DepthCamera
from tests.fixtures.device_rays import loaded
from tests.fixtures.kernels import launched
from tests.fixtures.scenes import ABSENT, IDENTITY_POSE, arrays_from_parts, box_model, ground_part, moving_poses
from tests.oracles.kinematics import differentiate_plainly

FRAMES = 7


@wp.kernel
def velocity_kernel(
    scene: structs.Scene,
    batch_index: wp.array[int],
    instance: wp.array[int],
    face: wp.array[int],
    point: wp.array[wp.vec3],
    # out
    velocity_out: wp.array[wp.vec3],
):
    row = wp.tid()
    velocity_out[row] = motion.surface_velocity(scene, batch_index[row], instance[row], face[row], point[row])


@wp.kernel
def moved_pose_kernel(
    pose: wp.array[wp.transformf],
    velocity: wp.array[wp.vec3],
    rate: wp.array[wp.vec3],
    time_offset: wp.array[float],
    # out
    pose_out: wp.array[wp.transformf],
):
    row = wp.tid()
    pose_out[row] = motion.moved_pose(pose[row], velocity[row], rate[row], time_offset[row])


def surface_velocities(scene: DeviceScene, batch_index, instance, face, point) -> np.ndarray:
    """Return the velocity of surface points at the frame, shape [N, 3]."""
    ids = [np.broadcast_to(k, len(point)) for k in (batch_index, instance, face)]
    return launched(velocity_kernel, len(point), [scene.struct, *ids, point - scene.origin], scene.device)[0]


def turning_boxes(seed: int = 0, count: int = 6) -> tuple[SceneData, np.ndarray, np.ndarray, np.ndarray]:
    """Return boxes of constant velocity and rate about any axis, their poses at frame 0, velocities and rates."""
    rng = np.random.default_rng(seed)
    start = make_pose(rng.uniform(-30, 30, (count, 3)), normalize(rng.normal(size=(count, 4))))
    velocity, rate = rng.uniform(-25, 25, (count, 3)), rng.uniform(-2, 2, (count, 3))
    poses = moving_poses(start, velocity, rate, FRAME_DT * np.arange(FRAMES))
    actors = [(f"veh_{k}", "vehicle", 0) for k in range(count)]
    return arrays_from_parts([ground_part()], [box_model("box")], actors, poses), start, velocity, rate


def random_poses(frames: int, bodies: int) -> np.ndarray:
    """Return unrelated poses, shape [F, N, 7]."""
    rng = np.random.default_rng(7)
    return make_pose(rng.normal(size=(frames, bodies, 3)), normalize(rng.normal(size=(frames, bodies, 4))))


def is_same(one: Motion, other: Motion, at: tuple) -> bool:
    """Return whether derivatives at some frames and bodies have the same bits."""
    return all(getattr(one, name)[at].tobytes() == getattr(other, name)[at].tobytes() for name in vars(one))


@pytest.mark.parametrize("frames", [1, 2, 3, 4, 9])
def test_derivatives_are_those_of_whole_recordings(frames: int) -> None:
    """Unrelated poses: every rotation is large. Rounding of a sum of four numbers, and of an arc tangent."""
    poses = random_poses(frames, 40)
    if frames > 4:
        poses[np.random.default_rng(8).random((frames, 40)) < 0.3] = np.nan
    found, wanted = differentiate(poses, 1.0), differentiate_plainly(poses, 1.0)
    for name, values in vars(wanted).items():  # meters and radians of a few
        np.testing.assert_allclose(getattr(found, name), values, rtol=0.0, atol=1e-13, err_msg=name)
    beside = np.isfinite(poses[:-2, :, 0]) & np.isfinite(poses[1:-1, :, 0]) & np.isfinite(poses[2:, :, 0])
    for name in ("velocity", "acceleration"):  # a sum and a quotient, rounded as NumPy does
        assert (getattr(found, name)[1:-1][beside] == getattr(wanted, name)[1:-1][beside]).all()


def test_zero_quaternion_is_an_error() -> None:
    poses = random_poses(4, 3)
    poses[2, 1, 3:] = 0.0
    with pytest.raises(ValueError, match="differentiate: a quaternion is zero"):
        differentiate(poses)
    assert differentiate(poses[:, :1]).velocity.shape == (4, 1, 3)
    assert differentiate(np.zeros((0, 3, 7))).velocity.shape == (0, 3, 3)
    assert differentiate(np.zeros((5, 0, 7))).velocity.shape == (5, 0, 3)


def test_absent_bodies_leave_the_others_as_they_are() -> None:
    """Each interval of presence has the bits that it has alone; bodies with the same intervals are taken together."""
    poses = random_poses(9, 8)
    poses[:, 2], poses[:3, 3], poses[4, 4], poses[1:, 5], poses[:3, 6] = (np.nan,) * 5
    found = differentiate(poses)
    for body, intervals in enumerate(
        [[(0, 9)], [(0, 9)], [], [(3, 9)], [(0, 4), (5, 9)], [(0, 1)], [(3, 9)], [(0, 9)]]
    ):
        expected = np.full((9, 3), np.nan)
        for start, stop in intervals:
            alone = differentiate(poses[start:stop, body])
            assert is_same(
                Motion(*(getattr(found, name)[start:stop, body] for name in vars(found))), alone, (slice(None),)
            )
            expected[start:stop] = alone.velocity
        assert np.array_equal(found.velocity[:, body], expected, equal_nan=True)


def test_one_frame_has_the_bits_of_all() -> None:
    """Bodies that come or go about the frame are at the ends of their intervals."""
    poses = random_poses(9, 6)
    for absent in (np.s_[:0, :0], np.s_[:, 2], np.s_[:4, 3], np.s_[5:, 4]):
        poses[absent] = np.nan
        one, all_frames = differentiate_row(poses, 4), differentiate(poses)
        assert is_same(one, Motion(*(getattr(all_frames, name)[4] for name in vars(one))), (slice(None),))
        rows = placed(one, 4, 9)
        assert is_same(rows, all_frames, (4,)) and np.isnan(np.delete(rows.velocity, 4, axis=0)).all()
    assert np.isnan(one.velocity[2]).all() and np.isfinite(one.velocity[[0, 1, 3, 4, 5]]).all()
    assert is_same(differentiate_row(poses[3:6, :2], 1), one, ([0, 1],))


def test_every_point_moves_as_its_finite_difference(device: str) -> None:
    arrays, start, velocity, rate = turning_boxes()
    scene = loaded(arrays, device)
    rng = np.random.default_rng(1)
    seen = []
    for batch_index in range(FRAMES):
        instance = rng.integers(0, len(start), 50)
        local = rng.uniform([-2.25, -0.9, 0.0], [2.25, 0.9, 1.5], (50, 3))

        def place(time: float, instance=instance, local=local) -> np.ndarray:
            moved = moving_poses(start, velocity, rate, np.array([time]))[0]
            return transform_points(moved[instance], local)

        now, step = batch_index * FRAME_DT, 1e-5
        wanted = (place(now + step) - place(now - step)) / (2.0 * step)
        np.testing.assert_allclose(surface_velocities(scene, batch_index, instance, 0, place(now)), wanted, atol=2e-4)
        seen.append(np.linalg.norm(wanted - velocity[instance], axis=1).max())
    assert min(seen) > 1.0, "points must move against their bodies' origins, or the test shows nothing"


def test_outer_side_of_a_turn_is_faster(device: str) -> None:
    """On a circle of radius R at speed v the side at R + d moves at v (R + d) / R."""
    radius, speed = 30.0, 20.0
    angle = speed / radius * FRAME_DT * np.arange(FRAMES)
    position = radius * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    poses = pose_from_ypr(position, yaw=angle + 0.5 * np.pi)[:, None]
    scene = loaded(arrays_from_parts([], [box_model("car")], [("car", "vehicle", 0)], poses), device)
    for batch_index in range(FRAMES):
        sides = transform_points(poses[batch_index], [[0.0, 0.9, 0.5], [0.0, -0.9, 0.5]])
        found = surface_velocities(scene, batch_index, 0, 0, sides)
        lengths = np.linalg.norm(found, axis=1)
        np.testing.assert_allclose(lengths, speed * np.array([radius - 0.9, radius + 0.9]) / radius, rtol=2e-5)
        np.testing.assert_allclose(found[0] @ position[batch_index] / radius, 0.0, atol=2e-3)


def test_town_and_absent_instances_stand_still(device: str) -> None:
    rows = [
        [pose_from_ypr([0.3 * k, 0.0, 0.0]), ABSENT if k < 3 else pose_from_ypr([0.0, 0.2 * k, 0.0])] for k in range(6)
    ]
    actors = [("a", "vehicle", 0), ("b", "vehicle", 0)]
    scene = loaded(arrays_from_parts([ground_part()], [box_model("car")], actors, np.array(rows)), device)
    assert not surface_velocities(scene, 0, -1, 0, np.array([[3.0, 4.0, 0.0]])).any()
    velocity, rate = scene.struct.instance_velocity.numpy(), scene.struct.instance_rate.numpy()
    np.testing.assert_allclose(velocity[:, 0], np.tile([30.0, 0.0, 0.0], (6, 1)), atol=1e-4)
    np.testing.assert_allclose(velocity[:, 1], [[0.0, 0.0 if k < 3 else 20.0, 0.0] for k in range(6)], atol=1e-4)
    assert not rate.any()


def test_moved_pose_is_the_exponential(device: str) -> None:
    rng = np.random.default_rng(3)
    count = 200
    poses = make_pose(rng.uniform(-50, 50, (count, 3)), normalize(rng.normal(size=(count, 4))))
    velocity, rate = rng.uniform(-40, 40, (count, 3)), rng.uniform(-30, 30, (count, 3))
    rate[:20] *= 1e-6
    rate[20:30] = 0.0
    time = rng.uniform(-0.1, 0.1, count)
    time[::7] = 0.0
    (found,) = launched(moved_pose_kernel, count, [poses, velocity, rate, time], device)
    turned = multiply(quaternion_exp(rate * time[:, None]), poses[:, 3:])
    np.testing.assert_allclose(found, make_pose(poses[:, :3] + velocity * time[:, None], turned), atol=1e-5)
    np.testing.assert_array_equal(found[::7], poses.astype(np.float32)[::7])


WHEEL = (1.4, 0.79, 0.325, 0.325)
"""Center and radius of the wheel of the tests [m]."""


def wheeled(poses: np.ndarray, wheels=(WHEEL,)) -> SceneData:
    """Return one box car along `poses` [F, 7] whose face 3 belongs to wheel 0, face 4 to wheel 1 where there is one.

    Another model with a wheel of its own comes first, so that faces and wheels of the car have an offset.
    """
    box = box_model("car")
    wheel = np.full(12, -1, dtype=np.int32)
    wheel[3 : 3 + len(wheels)] = np.arange(len(wheels))
    first = replace(box, name="first", wheels=np.array([[0.0, 0.0, 1.0, 9.0]]), wheel=np.zeros(12, dtype=np.int32))
    car = replace(box, wheels=np.array(wheels), wheel=wheel)
    rows = np.stack([np.broadcast_to([0.0, 50.0, 0.0, 0.0, 0.0, 0.0, 1.0], poses.shape), poses], axis=1)
    return arrays_from_parts([], [first, car], [("first", "vehicle", 0), ("car", "vehicle", 1)], rows)


@pytest.mark.parametrize("speed", [12.0, -3.0])
def test_wheel_rolls_without_slip(device: str, speed: float) -> None:
    """Contact point at rest, top at 2 v, front going down at v, hub at v, whatever the heading and the slope."""
    yaw, pitch = 0.7, -0.1
    body = pose_from_ypr(np.zeros(3), yaw, pitch)
    forward, up = rotate(body[3:], [1.0, 0.0, 0.0]), rotate(body[3:], [0.0, 0.0, 1.0])
    position = speed * FRAME_DT * np.arange(FRAMES)[:, None] * forward
    poses = pose_from_ypr(position, yaw, pitch)
    scene = loaded(wheeled(poses), device)
    center, radius = np.array(WHEEL[:3]), WHEEL[3]
    local = center + radius * np.array([[0, 0, -1], [0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 0, 0], [0, 0.3, 0]])
    wanted = speed * np.array([0 * forward, 2 * forward, forward - up, forward + up, forward, forward])
    for batch_index in (0, 3, FRAMES - 1):
        points = transform_points(poses[batch_index], local)
        np.testing.assert_allclose(surface_velocities(scene, batch_index, 1, 3, points), wanted, atol=2e-4)
        body_only = surface_velocities(scene, batch_index, 1, 2, points)
        np.testing.assert_allclose(body_only, np.tile(speed * forward, (6, 1)), atol=2e-4)


def test_each_wheel_of_a_turn_rolls_at_its_own_speed(device: str) -> None:
    """About the rear axle's line every wheel of that axle has a contact point at rest; the outer one turns faster."""
    speed, turn, radius = 10.0, 0.5, 0.325
    wheels = ((0.0, 0.8, radius, radius), (0.0, -0.8, radius, radius))
    angle = turn * FRAME_DT * np.arange(FRAMES)
    position = speed / turn * np.stack([np.sin(angle), 1.0 - np.cos(angle), 0.0 * angle], axis=1)
    poses = pose_from_ypr(position, yaw=angle)
    scene = loaded(wheeled(poses, wheels), device)
    for wheel, side in ((0, 0.8), (1, -0.8)):
        local = np.array([[0.0, side, 0.0], [0.0, side, 2.0 * radius]])
        found = surface_velocities(scene, 4, 1, 3 + wheel, transform_points(poses[4], local))
        forward = rotate(poses[4, 3:], [1.0, 0.0, 0.0])
        np.testing.assert_allclose(found[0], 0.0, atol=1e-3)
        np.testing.assert_allclose(found[1], 2.0 * (speed - turn * side) * forward, atol=1e-3)


def test_derivatives_do_not_depend_on_the_batch(device: str) -> None:
    arrays, *_ = turning_boxes(5)
    together = loaded(arrays, device, sweep_s=0.01)
    for batch_index, frame in enumerate(arrays.frames):
        alone = loaded(arrays, device, [frame], sweep_s=0.01)
        for name in ("instance_velocity", "instance_rate", "instance_pose"):
            ours, theirs = (getattr(scene.struct, name).numpy() for scene in (together, alone))
            assert ours[batch_index].tobytes() == theirs[0].tobytes(), name


def test_view_twists_are_finite_differences_of_the_view() -> None:
    arrays, start, velocity, rate = turning_boxes(7, 2)
    actors = (replace(arrays.actors[0], role="cav"), replace(arrays.actors[1], role="rsu"))
    poses = arrays.poses.copy()
    poses[:, 1] = IDENTITY_POSE
    arrays = replace(arrays, actors=actors, poses=poses)
    mount = MountConfig(position_m=(1.5, -0.7, 2.4), yaw_deg=90.0)
    sensor = DepthCamera(type="depth", name="d", on=("cav", "rsu"), mount={"cav": mount, "rsu": mount})
    views = make_views(arrays, [4, 2], sensor)
    linear, angular = view_twists(arrays, differentiate(arrays.poses), views)
    assert linear.dtype == angular.dtype == np.float64 and linear.shape == angular.shape == (4, 3)
    for row in range(4):
        if views.actor[row] == 1:
            assert not linear[row].any() and not angular[row].any()
            continue
        now, step = views.frame[row] * FRAME_DT, 1e-5
        arm = transform_points(invert(arrays.poses[views.frame[row], 0]), views.pose[row, :3])
        np.testing.assert_allclose(arm, mount.position_m, atol=1e-9)
        ends = [
            transform_points(moving_poses(start, velocity, rate, np.array([now + t]))[0, 0], arm) for t in (-step, step)
        ]
        np.testing.assert_allclose(linear[row], (ends[1] - ends[0]) / (2.0 * step), atol=1e-6)
        np.testing.assert_allclose(angular[row], rate[0], atol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"wheel": np.zeros(3, dtype=np.int32)}, "wheel has 3 rows; the model has 12 faces"),
        ({"wheel": np.zeros(12, dtype=np.int32)}, "wheel 0 of a face; the model has 0 wheels"),
        ({"wheels": np.array([[0.0, 0.0, 0.3, 0.0]])}, "radius is not above 0 m"),
    ],
)
def test_models_check_their_wheels(change: dict, message: str) -> None:
    box: Prototype = box_model("car")
    with pytest.raises(ValueError, match=message):
        replace(box, **change)


def test_sweep_is_checked() -> None:
    with pytest.raises(ValueError, match=r"sweep_s = -0\.01; a scene needs a time of 0 s or more"):
        DeviceScene(turning_boxes()[0], "cpu", 1, sweep_s=-0.01)
