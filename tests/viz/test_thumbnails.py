"""Small pictures of samples on the page about a dataset: points and colors where geometry puts them."""

import io
from types import SimpleNamespace

import numpy as np
from PIL import Image

from mmw.dataset.frame import PointCloud
from mmw.viz.report.figures import EXTENT_M, thumbnail


def pixels(thumb) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(thumb[0][1])).convert("RGB"), dtype=int)


def agent_with(type_: str, **samples) -> SimpleNamespace:
    """Return an agent at the origin of the world with a sensor of a type and no boxes around."""
    pose, frame = np.array([0.0, 0, 0, 0, 0, 0, 1]), SimpleNamespace(boxes=())
    row = {"type": type_, "sensor": type_}
    given = {"sweeps": {}, "radars": {}, "views": {}} | samples
    return SimpleNamespace(name="cav", pose=pose, frame=frame, sensors={type_: row}, **given)


def test_points_are_drawn_where_they_are() -> None:
    pose, count, zero = np.array([0.0, 0, 0, 0, 0, 0, 1]), 40, np.zeros(40, dtype=int)
    place = np.tile([22.5, -15.0, 0.0], (count, 1)) + np.random.default_rng(1).normal(0.0, 0.5, (count, 3))
    columns = {"intensity": np.full(count, 0.5), "object_id": zero, "label": zero}
    cloud = PointCloud("cav", "lidar", pose, place, columns)
    image = pixels(thumbnail(agent_with("lidar", sweeps={"lidar": cloud}), "lidar"))
    per_m = 320 / (2 * EXTENT_M)
    yellow = np.argwhere((image[..., 0] > 200) & (image[..., 2] < 90))
    np.testing.assert_allclose(yellow.mean(axis=0), [120 - 22.5 * per_m, 160 + 15.0 * per_m], atol=2.5)
    place = np.array([[38.0, 12.0, 0.0], [38.0, -12.0, 0.0]])
    columns = {"range": np.full(2, 40.0), "velocity": np.array([-8.0, 8.0]), "label": zero[:2], "snr_db": np.ones(2)}
    cloud = PointCloud("cav", "radar", pose, place, columns)
    image = pixels(thumbnail(agent_with("radar", radars={"radar": cloud}), "radar"))
    blue, red = np.argwhere(image[..., 2] > image[..., 0] + 60), np.argwhere(image[..., 0] > image[..., 2] + 60)
    assert 100 < blue[:, 1].mean() < 160 < red[red[:, 0] < 180, 1].mean()  # the one that approaches is on the left


def test_near_is_bright_and_nothing_is_white() -> None:
    depth = np.repeat([3.0, 100.0, np.inf], 80).reshape(3, 80).repeat(40, axis=0)
    size = SimpleNamespace(intrinsics=SimpleNamespace(width=80, height=120))
    view = SimpleNamespace(depth=depth, camera=size, frame=SimpleNamespace(boxes=()))
    image = pixels(thumbnail(agent_with("depth", views={"depth": view}), "depth"))
    assert image.shape == (480, 320, 3)
    near, far, nothing = image[[80, 240, 400]].mean(axis=(1, 2))
    assert nothing > 250 > near > 180 > 60 > far
