"""Segmentation: the object and the CARLA tag of every pixel, from the launch that makes the depth image."""

from dataclasses import replace

import numpy as np
import pytest

from mmw.scene.scene_data import SceneObject
from mmw.sensors.ground_truth.segmentation import object_tags
from mmw.storage.codecs.images import decode_instance, decode_semantic, encode_instance, encode_semantic
from tests.fixtures.depth_cameras import STREET, camera
from tests.fixtures.scenes import random_triangles, two_cars
from tests.fixtures.sensor_runs import all_carriers
from tests.fixtures.traced_depth import traced_depth


@pytest.mark.parametrize("kind", ["street", "soup"])
def test_images_hold_object_and_tag_of_every_pixel(device: str, kind: str) -> None:
    """The tag is the one that the table `objects` gives the object, 11 (sky) for none.

    That pixels show the right objects is tested in `tests/sensors/depth/test_depth.py`.
    """
    arrays, config = two_cars(3), camera(on=("cav", "rsu"), mount=STREET)
    if kind == "soup":
        arrays, config = all_carriers(random_triangles(5, 200, vehicles=3, frames=2)), camera(on=("cav",))
        arrays = replace(arrays, objects=tuple(replace(one, tag=3 + 2 * i) for i, one in enumerate(arrays.objects)))
    tag_of, tags = {entry.object_id: entry.tag for entry in arrays.objects}, object_tags(arrays)
    for image in traced_depth(arrays, device, config, [1, 0]).object_id:
        np.testing.assert_array_equal(decode_instance(encode_instance(image)), image)
        semantic = decode_semantic(encode_semantic(image, tags)).ravel().tolist()
        assert semantic == [tag_of.get(i, 11) for i in image.ravel().tolist()] and len(set(semantic)) > 2


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
