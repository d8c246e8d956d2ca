"""Optical flow: a float64 reprojection of surface points along the true motion, closed forms, what stands still."""

import numpy as np
import pytest

from mmw.config import MountConfig
from mmw.config.lens import LensConfig
from mmw.core.camera_models import Intrinsics
from mmw.core.constants import FRAME_DT
from mmw.core.kinematics import differentiate
from mmw.core.transforms import compose, invert, make_pose, pose_from_ypr, transform_points
from mmw.scene.device_scene import DeviceScene
from mmw.scene.views import Views, make_views, view_twists
from mmw.sensors import DepthCamera
from mmw.sensors.render.optical_flow import device_twists, image_motion
from mmw.sensors.render.projection import project, unproject
from mmw.sensors.render.visibility_buffer import trace_samples
from tests.fixtures.device_rays import loaded
from tests.fixtures.scenes import arrays_from_parts, box_model, ground_part, moving_poses

SIZE = (96, 72)
FRAMES = 5
LENSES = {
    "pinhole": LensConfig().intrinsics(*SIZE, 100.0),
    "barrel": LensConfig(model="brown_conrady", k1=-0.2, k2=0.03, p1=0.001).intrinsics(*SIZE, 90.0),
    "fisheye": LensConfig(model="fisheye", k1=0.02).intrinsics(*SIZE, 170.0),
}


def scene_of(
    start: np.ndarray, velocity: np.ndarray, rate: np.ndarray, device: str
) -> tuple[DeviceScene, Views, tuple]:
    """Return a plane with bodies that keep velocity and rate; body 0 carries the camera, which looks along its x."""
    poses = moving_poses(start, velocity, rate, FRAME_DT * np.arange(FRAMES))
    actors = [("cav_1", "cav", 0), *((f"veh_{k}", "vehicle", 1) for k in range(1, len(start)))]
    models = [box_model("mast", (0.01, 0.01, 0.01), (0.0, 0.0, -0.5)), box_model("car")]
    arrays = arrays_from_parts([ground_part(200.0)], models, actors, poses)
    scene = loaded(arrays, device, [2])
    views = make_views(arrays, [2], DepthCamera(on=("cav",), mount={"cav": MountConfig(position_m=(0.0, 0.0, 0.0))}))
    twists = device_twists(view_twists(arrays, differentiate(arrays.poses), views), device)
    return scene, views, twists


def turn_of(pose: np.ndarray) -> np.ndarray:
    """Return the rotation of a pose alone, as a pose."""
    return make_pose(np.zeros(3), pose[3:])


def reprojected(lens: Intrinsics, buffer, start: np.ndarray, velocity: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """Return the flow [H, W, 2] of the traced points along the exact motion of every body, in float64."""
    u, v = np.meshgrid(np.arange(lens.width) + 0.5, np.arange(lens.height) + 0.5)
    pixels = np.stack([u, v], axis=-1).reshape(-1, 2)
    rays = unproject(lens, pixels)
    t, instance, face = (getattr(buffer.samples, name).numpy()[: buffer.count] for name in ("t", "instance", "face"))
    now, then = (moving_poses(start, velocity, rate, np.array([FRAME_DT * frame]))[0] for frame in (2, 3))
    met, body = face >= 0, np.maximum(instance, 0)
    point = transform_points(now[0], rays * np.where(met, t, 1.0)[:, None])
    carried = transform_points(then[body], transform_points(invert(now[body]), point))
    point = np.where((instance >= 0)[:, None], carried, point)
    turned = transform_points(compose(invert(turn_of(then[0])), turn_of(now[0])), rays)
    after = project(lens, np.where(met[:, None], transform_points(invert(then[0]), point), turned))
    return (after - pixels).reshape(lens.height, lens.width, 2)


@pytest.mark.parametrize("name", LENSES)
def test_flow_is_the_reprojection_along_the_true_motion(device: str, name: str) -> None:
    """The camera drives and turns, cars drive, turn and tumble: within 0.02 px wherever the point stays in sight."""
    lens = LENSES[name]
    start = np.array([
        pose_from_ypr([0.0, 0.0, 2.0], 0.1, 0.05, 0.02), pose_from_ypr([8.0, 2.0, 0.0], 0.4),
        pose_from_ypr([12.0, -3.0, 0.3], 2.0, 0.1), pose_from_ypr([5.0, -2.5, 0.1], -0.7),
    ])  # fmt: skip
    velocity = np.array([[12.0, 1.0, 0.2], [-9.0, 3.0, 0.0], [3.0, 14.0, 0.5], [0.0, 0.0, 0.0]])
    rate = np.array([[0.05, -0.1, 0.4], [0.0, 0.0, 0.8], [0.3, 0.2, -0.5], [0.0, 0.0, 1.5]])
    scene, views, twists = scene_of(start, velocity, rate, device)
    buffer = trace_samples(scene, views, lens, 100.0)
    found = image_motion(buffer, twists).numpy()[0]
    wanted = reprojected(lens, buffer, start, velocity, rate)
    instance, face = (getattr(buffer.samples, name).numpy()[: buffer.count] for name in ("instance", "face"))
    seen = set(instance[face >= 0].tolist())
    assert seen >= {-1, 1, 2, 3}, "the plane and every car must be in the picture, or the test shows nothing"
    assert (face < 0).any(), "so must the sky"
    size = np.linalg.norm(wanted, axis=-1)
    assert size.max() > 1.5
    # A float32 pose and differences of positions of 30 frames' worth of motion: 0.2 % of long flows.
    np.testing.assert_allclose(found, wanted, atol=0.02, rtol=2e-3)


def test_driving_over_a_plane(device: str) -> None:
    """Closed form: from height h a pixel s below the horizon shows depth f h / s, which shrinks by v dt."""
    speed, height = 20.0, 1.5
    start = np.array([pose_from_ypr([0.0, 0.0, height])])
    scene, views, twists = scene_of(start, np.array([[speed, 0.0, 0.0]]), np.zeros((1, 3)), device)
    lens = LENSES["pinhole"]
    found = image_motion(trace_samples(scene, views, lens, 100.0), twists).numpy()[0]
    u, v = np.meshgrid(np.arange(lens.width) + 0.5 - lens.cx, np.arange(lens.height) + 0.5 - lens.cy)
    below = v > 0.5
    depth = lens.fy * height / np.where(below, v, 1.0)
    grows = depth / (depth - speed * FRAME_DT) - 1.0
    np.testing.assert_allclose(found[below], np.stack([u * grows, v * grows], axis=-1)[below], atol=0.01)
    assert (found[v < 0] == 0.0).all(), "the sky stands still for a camera that does not turn"


def test_turning_camera_moves_the_sky(device: str) -> None:
    """A yaw to the left by w dt moves what is on the axis to the right by f tan(w dt), the sky as the ground."""
    rate = 1.5
    start = np.array([pose_from_ypr([0.0, 0.0, 1.5])])
    scene, views, twists = scene_of(start, np.zeros((1, 3)), np.array([[0.0, 0.0, rate]]), device)
    lens = LENSES["pinhole"]
    found = image_motion(trace_samples(scene, views, lens, 100.0), twists).numpy()[0]
    angle = np.arctan((np.arange(lens.width) + 0.5 - lens.cx) / lens.fx)
    wanted = lens.fx * (np.tan(angle + rate * FRAME_DT) - np.tan(angle))
    np.testing.assert_allclose(found[..., 0], np.broadcast_to(wanted, found.shape[:2]), atol=0.005)


def test_what_stands_still_has_no_flow(device: str) -> None:
    start = np.array([pose_from_ypr([30.1, -7.3, 1.5], 0.3, 0.1), pose_from_ypr([38.0, -5.0, 0.0], 1.0)])
    scene, views, twists = scene_of(start, np.zeros((2, 3)), np.zeros((2, 3)), device)
    for lens in LENSES.values():
        assert not image_motion(trace_samples(scene, views, lens, 100.0), twists).numpy().any()


def test_no_views(device: str) -> None:
    start = np.array([pose_from_ypr([0.0, 0.0, 1.5])])
    scene, views, _ = scene_of(start, np.zeros((1, 3)), np.zeros((1, 3)), device)
    none = views.take(slice(0))
    twists = device_twists((np.zeros((0, 3)), np.zeros((0, 3))), device)
    assert image_motion(trace_samples(scene, none, LENSES["pinhole"], 100.0), twists).shape == (0, SIZE[1], SIZE[0])
