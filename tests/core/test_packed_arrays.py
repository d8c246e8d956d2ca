"""Arrays that share one block hold what was put into them, and blocks are used again only after their release."""

import gc

import numpy as np
import pytest
import warp as wp

from mmw.core.packed_arrays import KEPT_BYTES, PackedArrays, borrow_arrays, device_arrays, padded_count


@pytest.mark.parametrize("rows", [5, KEPT_BYTES // 8 + 1])
def test_a_block_goes_to_the_device_and_back(device, rows):
    block = borrow_arrays(device, ((rows,), wp.int32), ((rows, 2), wp.vec3d))
    block.host[0][...], block.host[1][...] = 3, 0.5
    numbers, points = block.upload()
    np.testing.assert_array_equal(points.numpy(), np.full((rows, 2, 3), 0.5))
    numbers.fill_(4)
    found = block.download()
    assert (found[0] == 4).all() and (found[1] == 0.5).all()
    numbers.fill_(5)
    block.queue_download()
    assert (block.download(is_queued=True)[0] == 5).all()
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
    block = borrow_arrays(device, ((KEPT_BYTES,), wp.float64), ((0, 3), wp.vec3d))
    block.host[0][...] = np.arange(KEPT_BYTES)
    array, nothing = block.upload()
    del block
    others = [borrow_arrays(device, ((KEPT_BYTES,), wp.float64), ((0, 3), wp.vec3d)) for _ in range(5)]
    for other in others:
        other.host[0][...] = -1.0
        other.upload()
    np.testing.assert_array_equal(array.numpy(), np.arange(KEPT_BYTES))
    assert nothing.shape == (0, 3)


@pytest.mark.parametrize("count", [1, 64, 65, 1000, KEPT_BYTES + 3])
def test_padded_counts_are_few_and_large_enough(count):
    assert count <= padded_count(count) <= max(64, 2 * count)
    assert padded_count(count) in (64, 128, 1024, KEPT_BYTES + 3)


def test_arrays_of_a_block_live_as_long_as_one_of_them(device: str) -> None:
    arrays = device_arrays(device, [((4,), wp.float32), ((0,), wp.int32), ((2, 3), wp.vec3)])
    assert [array.shape for array in arrays] == [(4,), (0,), (2, 3)]
    for number, array in enumerate(arrays[::2]):
        array.fill_(float(number + 1))
    kept, values = arrays[2][1:], arrays[0].numpy()
    del arrays, array
    gc.collect()
    others = [wp.full(16, 7.0, dtype=float, device=device) for _ in range(8)]
    assert values.tolist() == [1.0] * 4 and (kept.numpy() == 2.0).all() and len(others) == 8


def test_scratch_is_kept_though_it_is_large_but_only_one_block_of_a_kind(device):
    layouts = ((KEPT_BYTES + 7,), wp.uint8), ((5,), wp.vec3d)
    one, other = (borrow_arrays(device, *layouts, is_scratch=True) for _ in range(2))
    assert one.host == [] and one.arrays[0].ptr != other.arrays[0].ptr
    one.release()
    other.release()
    again = [borrow_arrays(device, *layouts, is_scratch=True) for _ in range(2)]
    assert again[0] is one and again[1] is not other
    assert borrow_arrays(device, *layouts) not in (one, other)


def test_blocks_may_be_larger_than_two_gibibytes() -> None:
    """Memory that is never written costs nothing."""
    half = ((1 << 28) + 64,), wp.int32
    block = PackedArrays("cpu", (half, half, ((2,), wp.float64)), is_scratch=True)
    first, second, last = block.arrays
    assert second.ptr - first.ptr == 4 * ((1 << 28) + 64)
    last.fill_(3.0)
    np.testing.assert_array_equal(last.numpy(), 3.0)
