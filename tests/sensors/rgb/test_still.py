"""Pictures do not flicker: a camera that stands still sees the same where nothing moves, frame after frame."""

import numpy as np
from scipy.ndimage import binary_dilation

from mmw.core.transforms import pose_from_mount, rotate
from mmw.scene.scene_data import SceneData
from mmw.sensors import RgbCamera
from mmw.sensors.render.image_config import ImageConfig, NoiseConfig
from tests.fixtures.rgb_scenes import Rendering, at, render
from tests.fixtures.scenes import box_model, pose, street_canyon

FRAMES = 10
CONFIG = RgbCamera(width_px=96, height_px=72)
CAMERA = pose_from_mount((-30.0, -6.0, 5.0), 10.0, -5.0)
"""Along the street, from one side of it."""

NEAR_M = 6.0
"""Distance from the center of a moving car within which it and its shadow change the light [m]."""
GROW_PX = 10
"""Pixels around a change that the filters of the camera may change too."""


def street(step: float, frames: int = FRAMES) -> SceneData:
    """Return the street with a red car that drives away, a step [m] each frame, and a parked one."""
    rows = [[pose(-15.0 + step * k, -3.0), pose(-22.0, 4.0)] for k in range(frames)]
    actors = [("veh_001", "vehicle", 0), ("veh_002", "vehicle", 0)]
    return street_canyon([box_model("car", material=3)], actors, np.array(rows))


def film(arrays: SceneData, device: str, config: RgbCamera = CONFIG) -> Rendering:
    views = at(*[CAMERA] * len(arrays.frames), frame=arrays.frames)
    return render(arrays, device, views, config=config)


def test_a_still_scene_gives_equal_bytes(device: str) -> None:
    rgb = film(street(0.0), device).rgb()["sunny"]
    assert rgb[0].std() > 10.0 and (rgb == rgb[0]).all()
    np.testing.assert_array_equal(film(street(0.0, 3), device).rgb()["sunny"], rgb[:3])  # in a batch of another size


def test_only_what_moves_changes(device: str) -> None:
    arrays = street(0.15)
    camera = film(arrays, device)
    rgb, objects = camera.rgb()["sunny"].astype(int), camera.objects().reshape(FRAMES, 72, 96)
    ahead = camera.rays @ rotate(CAMERA[3:], (1.0, 0.0, 0.0))
    depth = camera.depth().depth_m.numpy() / ahead
    points = CAMERA[:3] + camera.rays * np.where(np.isfinite(depth), depth, 1e9)[..., None]
    car, parked = (objects == actor.object_id for actor in arrays.actors)
    is_near = np.linalg.norm(points - arrays.poses[:, None, None, 0, :3], axis=-1) < NEAR_M
    moving, still = [], []
    for k in range(FRAMES - 1):
        moves = binary_dilation((is_near | car)[k : k + 2].any(axis=0), np.ones((3, 3)), GROW_PX)
        change = np.abs(rgb[k + 1] - rgb[k])
        moving.append(change[moves])
        still.append(change[~moves])
        assert 0.0 < moves.mean() < 0.5 and parked[k][~moves].any()
        assert np.sqrt(np.square(still[-1]).mean()) < 1.0
    assert np.concatenate(moving).max() > 50 and np.concatenate(still).any(axis=-1).mean() < 0.01


def test_noise_is_seen(device: str) -> None:
    noisy = RgbCamera(width_px=96, height_px=72, image=ImageConfig(noise=NoiseConfig(enabled=True)))
    first, second = film(street(0.0, 2), device, noisy).rgb()["sunny"].astype(int)
    assert np.sqrt(np.square(second - first).mean()) > 1.0
