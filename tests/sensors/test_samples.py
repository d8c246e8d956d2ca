"""Samples: one view of many, and batches as one, on the host and on a device."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import warp as wp

from mmw.sensors import Boxes2d, PointCloud, PointSamples, RadarMaps, RadarPoints, Samples
from mmw.sensors.samples import join
from tests.fixtures.scene_captures import assert_same


@dataclass(frozen=True)
class Readings(Samples):
    """Samples with an array for each view, boxes, and what all views share."""

    values: np.ndarray
    unit: str
    boxes: Boxes2d | None = None


def boxes(*counts: int) -> Boxes2d:
    """Return boxes of views with some of them each."""
    ids = np.arange(sum(counts), dtype=np.int32)
    rectangles = np.repeat(ids[:, None], 4, axis=1)
    offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    return Boxes2d(offsets, ids, ids, rectangles, rectangles.astype(np.float32), ids / 2.0, ids * 1.0)


def test_a_view_takes_its_part_of_every_array() -> None:
    readings = Readings(np.arange(6.0).reshape(3, 2), "m", boxes(2, 0, 3))
    one = readings.view(2)
    np.testing.assert_array_equal(one.values, [4.0, 5.0])
    assert one.unit == "m" and one.boxes is not None and len(one.boxes) == 3
    np.testing.assert_array_equal(one.boxes.object_id, [2, 3, 4])
    np.testing.assert_array_equal(one.boxes.offsets, [0, 3])
    assert len(readings.view(1).boxes or ()) == 0
    assert replace(readings, boxes=None).view(0).boxes is None


def test_points_of_a_radar_keep_their_maps_and_samples() -> None:
    columns = [np.arange(5, dtype=np.float32) + k for k in range(7)]
    ids = np.arange(5, dtype=np.int32)
    maps = RadarMaps("range_azimuth", np.arange(12.0).reshape(2, 3, 2), 0.0, 0.5, -1.0, 0.25)
    iq = np.arange(16).reshape(2, 2, 2, 2).astype(np.complex64)
    points = RadarPoints(np.array([0, 1, 5]), *columns, ids, ids.astype(np.uint8), (maps,), iq)
    second = points.view(1)
    np.testing.assert_array_equal(second.range, [1, 2, 3, 4])
    np.testing.assert_array_equal(second.maps[0].values, maps.values[1])
    assert second.maps[0].column_step == 0.25 and second.iq is not None
    np.testing.assert_array_equal(second.iq, iq[1])
    bare = replace(points, power_db=None, maps=(), iq=None).view(0)
    assert bare.power_db is None and bare.maps == () and bare.iq is None and len(bare) == 1


def test_columns_of_a_point_cloud_are_not_copied() -> None:
    """Rows of the device's matrix, which tables take as they are."""
    matrix = np.arange(12, dtype=np.float32).reshape(4, 3)
    marks = np.zeros(3, dtype=np.uint8)
    cloud = PointCloud(np.array([0, 3], dtype=np.int32), matrix.T, marks, marks, marks, marks, marks)
    for name, row in zip(("x", "y", "z", "intensity"), matrix, strict=True):
        column = getattr(cloud, name)
        np.testing.assert_array_equal(column, row)
        assert column.flags.c_contiguous and np.shares_memory(column, matrix)
    assert cloud.xyz.shape == (3, 3) and np.shares_memory(cloud.view(0).xyz, matrix)


@pytest.mark.parametrize("kind", ["numpy", "warp"])
def test_batches_are_joined(device: str, kind: str) -> None:
    values = np.arange(8.0, dtype=np.float32).reshape(4, 2)

    def part(rows: slice, *counts: int) -> Readings:
        own = values[rows] if kind == "numpy" else wp.array(values[rows], dtype=float, device=device)
        return Readings(own, "m", boxes(*counts))

    parts = [part(slice(0, 1), 2), part(slice(1, 1)), part(slice(1, 4), 1, 0, 3)]
    whole = join(parts)
    found = whole.values if kind == "numpy" else whole.values.numpy()
    np.testing.assert_array_equal(found, values)
    assert whole.boxes is not None
    np.testing.assert_array_equal(whole.boxes.offsets, [0, 2, 3, 3, 6])
    np.testing.assert_array_equal(whole.boxes.object_id, [0, 1, 0, 1, 2, 3])
    assert_same(join(parts[:1]), parts[0])
    assert isinstance(whole.boxes, PointSamples)
