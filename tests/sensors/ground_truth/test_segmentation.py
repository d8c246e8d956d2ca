"""Segmentation: the object and the CARLA tag of every pixel, from the launch that makes the depth image."""

from dataclasses import replace

import numpy as np
import pytest

from mmw.config import MountConfig
from mmw.scene.scene_data import SceneData, SceneObject
from mmw.scene.views import make_views
from mmw.sensors.ground_truth.segmentation import object_tags
from mmw.sensors.lidar.scan_pattern import pinhole, pinhole_directions
from mmw.storage.codecs.images import decode_instance, decode_semantic, encode_instance, encode_semantic
from tests.fixtures.depth_cameras import camera
from tests.fixtures.scenes import random_triangles, two_cars
from tests.fixtures.traced_depth import traced_depth
from tests.oracles.tracing import cast_rays, is_ambiguous, sensor_rays

STREET_MOUNT = {
    "rsu": MountConfig(position_m=(0, 0, -1.0), pitch_deg=8),
    "cav": MountConfig(position_m=(2.31, 0.02, 1.23)),
}


def many_tags(seed: int) -> SceneData:
    """Return a soup of triangles where each object has a tag of its own, and vehicles carry cameras."""
    arrays = random_triangles(seed, 200, vehicles=3, frames=2)
    objects = tuple(replace(entry, tag=3 + 2 * i) for i, entry in enumerate(arrays.objects))
    actors = tuple(replace(actor, role="cav") for actor in arrays.actors)
    return replace(arrays, objects=objects, actors=actors)


@pytest.mark.parametrize("size", [(60, 44), (33, 17)])
@pytest.mark.parametrize("kind", ["street", "soup"])
def test_every_pixel_equals_the_oracle(device: str, kind: str, size: tuple[int, int]) -> None:
    if kind == "street":
        arrays, frames = two_cars(3), [0, 2]
        config = camera(on=("cav", "rsu"), mount=STREET_MOUNT, width_px=size[0], height_px=size[1])
    else:
        arrays, frames = many_tags(5), [1, 0]
        config = camera(on=("cav",), width_px=size[0], height_px=size[1])
    views = make_views(arrays, frames, config)
    object_id, tags = traced_depth(arrays, device, config, frames).object_id, object_tags(arrays)
    tag_of = {entry.object_id: entry.tag for entry in arrays.objects}
    through = pinhole_directions(pinhole(*size, config.fov_deg)).reshape(-1, 3)
    stretch = np.linalg.norm(through, axis=1)
    odd_pixels = 0
    for view in range(len(views)):
        frame = int(views.frame[view])
        origin, direction = sensor_rays(views.pose[view], through / stretch[:, None])
        hits = cast_rays(arrays, frame, origin, direction)
        expected = np.where(hits.t / stretch < config.range_m, hits.object_id, -1)
        instance = decode_instance(encode_instance(object_id[view])).ravel()
        semantic = decode_semantic(encode_semantic(object_id[view], tags)).ravel()
        odd = np.flatnonzero(instance != expected)
        if len(odd):
            assert is_ambiguous(arrays, frame, origin[odd], direction[odd], np.inf).all(), (view, odd)
        odd_pixels += len(odd)
        # The tag is the one that the table `objects` gives the object, 11 (sky) for none.
        np.testing.assert_array_equal(semantic, [tag_of.get(i, 11) for i in instance.tolist()])
        assert len(set(semantic.tolist())) > 2
    assert odd_pixels <= 2e-3 * object_id.size


def test_images_tell_the_highest_object_and_nothing() -> None:
    object_id = np.array([[-1, 0, 65_534]], dtype=np.int32)
    np.testing.assert_array_equal(decode_instance(encode_instance(object_id)), object_id)
    tags = np.array([7, 24, 11], dtype=np.uint8)
    assert decode_semantic(encode_semantic(np.array([[-1, 0, 1]]), tags)).tolist() == [[11, 7, 24]]


def test_too_many_objects_are_refused() -> None:
    arrays = two_cars(1)
    most = SceneObject(65_534, "/World/Town/Props/last", "static", 20, ())
    assert object_tags(replace(arrays, objects=(*arrays.objects, most)))[[65_534, -1]].tolist() == [20, 11]
    one_more = replace(most, object_id=65_535)
    with pytest.raises(ValueError, match=r"ids reach 65535.*segmentation: false"):
        object_tags(replace(arrays, objects=(*arrays.objects, one_more)))


def test_scene_without_objects_is_sky() -> None:
    assert object_tags(replace(two_cars(1), objects=())).tolist() == [11]
