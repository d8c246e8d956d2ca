"""A spatial order keeps neighbors together."""

import numpy as np

from mmw.core.spatial_order import spatial_order


def test_neighbors_in_order_are_near_each_other() -> None:
    points = np.stack(np.meshgrid(np.arange(128.0), np.arange(128.0), [2.0], indexing="ij"), axis=-1).reshape(-1, 3)
    order = spatial_order(points)
    np.testing.assert_array_equal(np.sort(order), np.arange(len(points)))
    blocks = points[order].reshape(-1, 16, 3)
    assert np.median(np.ptp(blocks, axis=1).max(axis=1)) <= 5.0  # of 4 m x 4 m, where a row of 16 takes 15 m
    np.testing.assert_array_equal(spatial_order(np.zeros((5, 3))), np.arange(5))
