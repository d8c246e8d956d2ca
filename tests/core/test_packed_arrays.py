"""Arrays that share one block hold what was put into them, and blocks are used again only after their release."""

import numpy as np
import pytest
import warp as wp

from mmw.core.packed_arrays import KEPT_BYTES, borrow_arrays, padded_count, upload_arrays


def test_uploaded_arrays_hold_their_values(device):
    integers = np.arange(7, dtype=np.int64)
    vectors = np.random.default_rng(1).normal(size=(3, 2, 3))
    ints, points, nothing = upload_arrays(
        device, (integers, wp.int32), (vectors, wp.vec3d), (np.zeros((0, 3)), wp.vec3d)
    )
    np.testing.assert_array_equal(ints.numpy(), integers)
    np.testing.assert_array_equal(points.numpy(), vectors)
    assert points.shape == (3, 2) and nothing.shape == (0,)
    integers[:] = -1  # the values were copied
    assert ints.numpy()[3] == 3


@pytest.mark.parametrize("rows", [5, KEPT_BYTES // 8 + 1])
def test_a_block_goes_to_the_device_and_back(device, rows):
    block = borrow_arrays(device, ((rows,), wp.int32), ((rows, 2), wp.vec3d))
    block.host[0][...], block.host[1][...] = 3, 0.5
    numbers, points = block.upload()
    np.testing.assert_array_equal(points.numpy(), np.full((rows, 2, 3), 0.5))
    numbers.fill_(4)
    found = block.download()
    assert (found[0] == 4).all() and (found[1] == 0.5).all()
    block.release()


def test_only_released_blocks_are_used_again(device):
    layouts = ((11,), wp.float32), ((13,), wp.uint8)
    one, other = borrow_arrays(device, *layouts), borrow_arrays(device, *layouts)
    assert one.arrays[0].ptr != other.arrays[0].ptr
    other.release()
    assert borrow_arrays(device, *layouts) is other
    assert borrow_arrays(device, *layouts) not in (one, other)
    large = borrow_arrays(device, ((KEPT_BYTES + 1,), wp.uint8))
    large.release()
    assert borrow_arrays(device, ((KEPT_BYTES + 1,), wp.uint8)) is not large


def test_an_array_keeps_its_block_alive(device):
    (array,) = upload_arrays(device, (np.arange(1000.0), wp.float64))
    others = [upload_arrays(device, (np.zeros(1000), wp.float64)) for _ in range(20)]
    np.testing.assert_array_equal(array.numpy(), np.arange(1000.0))
    assert len(others) == 20


@pytest.mark.parametrize("count", [1, 64, 65, 1000, KEPT_BYTES + 3])
def test_padded_counts_are_few_and_large_enough(count):
    assert count <= padded_count(count) <= max(64, 2 * count)
    assert padded_count(count) in (64, 128, 1024, KEPT_BYTES + 3)
