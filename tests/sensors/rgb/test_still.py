"""Pictures do not flicker: a camera that stands still sees the same where nothing moves, frame after frame."""

import numpy as np

from mmw.core.transforms import pose_from_mount
from mmw.physics.weather.weather import PRESETS
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData
from mmw.sensors import RgbCamera
from mmw.sensors.render.image_config import ImageConfig, NoiseConfig
from mmw.sensors.render.sky.sky import sun_direction
from tests.fixtures import flicker
from tests.fixtures.scenes import box_model, pose, street_canyon

FRAMES = 10
CONFIG = RgbCamera(width_px=96, height_px=72)
CAMERA = pose_from_mount((-30.0, -6.0, 5.0), 10.0, -5.0)
"""Along the street, from one side of it."""


def street(step: float, frames: int = FRAMES) -> SceneData:
    """Return the street with a red car that drives away, a step [m] each frame, and a parked one."""
    rows = [[pose(-15.0 + step * k, -3.0), pose(-22.0, 4.0)] for k in range(frames)]
    actors = [("veh_001", "vehicle", 0), ("veh_002", "vehicle", 0)]
    return street_canyon([box_model("car", material=3)], actors, np.array(rows))


def clip_of(arrays: SceneData, device: str, config: RgbCamera = CONFIG, slots: int = 4) -> flicker.Clip:
    scene = DeviceScene(arrays, device, slots)
    return flicker.film(scene, np.tile(CAMERA, (len(arrays.frames), 1)), "sunny", config)


def test_a_still_scene_gives_equal_bytes(device: str) -> None:
    rgb = clip_of(street(0.0), device).rgb
    assert rgb[0].std() > 10.0
    for k in range(1, FRAMES):
        np.testing.assert_array_equal(rgb[k], rgb[0])


def test_only_what_moves_changes(device: str) -> None:
    arrays = street(0.15)
    clip = clip_of(arrays, device)
    result = flicker.result_of(flicker.still_differences(arrays, clip, "sunny"), 96 * 72)
    assert result.pairs == FRAMES - 1 and 0.5 < result.compared < 1.0
    assert result.worst < 1.0 and result.changed < 0.01
    mask = flicker.moving_mask(arrays, clip, 0, sun_direction(PRESETS["sunny"]))
    changed = np.abs(clip.rgb[1].astype(int) - clip.rgb[0]).max(axis=-1)
    assert changed[mask].max() > 50 and mask[clip.object_id[0] == arrays.actors[0].object_id].all()
    parked = clip.object_id[0] == arrays.actors[1].object_id
    assert parked[~mask].any(), "a car that stands still is left out"


def test_the_measure_sees_noise(device: str) -> None:
    noisy = RgbCamera(width_px=96, height_px=72, image=ImageConfig(noise=NoiseConfig(enabled=True)))
    arrays = street(0.0, 2)
    differences = flicker.still_differences(arrays, clip_of(arrays, device, noisy), "sunny")
    assert flicker.result_of(differences, 96 * 72).worst > 1.0


def test_points_lie_where_the_rays_end(device: str) -> None:
    arrays = street(0.0, 1)
    clip = clip_of(arrays, device)
    (road,) = (o.object_id for o in arrays.objects if o.label == "road")
    points = clip.points[0][clip.object_id[0] == road]
    assert len(points) > 500 and np.abs(points[:, 2]).max() < 1e-3 and np.abs(points[:, 1]).max() < 10.001


def test_a_mask_grows_into_a_square() -> None:
    mask = np.zeros((9, 12), dtype=bool)
    mask[4, 0] = mask[8, 11] = True
    wanted = np.zeros_like(mask)
    wanted[2:7, :3] = wanted[6:, 9:] = True
    np.testing.assert_array_equal(flicker.grow(mask, 2), wanted)


def test_the_shadow_and_the_surroundings_of_a_body_count_as_moving() -> None:
    arrays = street(1.0, 2)
    behind_body = np.array([[[-15.0, -3.0 - 4.0, 0.0]], [[-15.0, -3.0 + 4.0, 0.0]], [[-15.0, 3.5, 0.0]]])
    low_sun = np.array([0.0, 0.8, 0.6])  # from +y: the shadow of the body falls to -y
    found = flicker.is_reached(behind_body.astype(np.float32), arrays.poses[0, 0], arrays, 0, low_sun)
    np.testing.assert_array_equal(found[:, 0], [True, False, False])
