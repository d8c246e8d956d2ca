"""Launches that are recorded and used again do what `wp.launch` does."""

import gc
import weakref

import numpy as np
import pytest
import warp as wp

from mmw.core.repeated_launch import launch_again


@wp.struct
class Weights:
    """Factors by which the kernel below multiplies."""

    scale: wp.array[wp.float64]
    shift: wp.float64


@wp.kernel
def weigh_kernel(weights: Weights, values: wp.array[wp.float64], power: int, out: wp.array[wp.float64]):
    """Write scale * value^power + shift. Launch: dim=N."""
    index = wp.tid()
    result = weights.scale[0]
    for _ in range(power):
        result = result * values[index]
    out[index] = result + weights.shift


def test_each_changed_argument_counts(device: str) -> None:
    def array(*values: float) -> wp.array:
        return wp.array(values, dtype=wp.float64, device=device)

    def launched(weights: Weights, values: wp.array, power: int, count: int) -> np.ndarray:
        out = wp.zeros(4, dtype=wp.float64, device=device)
        launch_again(weigh_kernel, (count,), [weights, values, power, out], device, block_dim=64)
        return out.numpy()

    weights = Weights()
    weights.scale, weights.shift = array(2.0), 1.0
    values = array(1.0, 2.0, 3.0, 4.0)
    np.testing.assert_array_equal(launched(weights, values, 1, 4), [3.0, 5.0, 7.0, 9.0])
    np.testing.assert_array_equal(launched(weights, values, 1, 4), [3.0, 5.0, 7.0, 9.0])
    np.testing.assert_array_equal(launched(weights, values, 2, 4), [3.0, 9.0, 19.0, 33.0])
    np.testing.assert_array_equal(launched(weights, array(5.0, 6.0, 7.0, 8.0), 1, 4), [11.0, 13.0, 15.0, 17.0])
    np.testing.assert_array_equal(launched(weights, values, 1, 2), [3.0, 5.0, 0.0, 0.0])
    np.testing.assert_array_equal(launched(weights, values, 1, 0), np.zeros(4))
    weights.shift = -1.0  # of the same object
    weights.scale = array(10.0)
    np.testing.assert_array_equal(launched(weights, values, 1, 4), [9.0, 19.0, 29.0, 39.0])
    other = Weights()
    other.scale, other.shift = array(1.0), 0.0
    np.testing.assert_array_equal(launched(other, values, 1, 3), [1.0, 2.0, 3.0, 0.0])


def test_numbers_and_arrays_are_checked_as_by_warp(device: str) -> None:
    weights, out = Weights(), wp.zeros(4, dtype=wp.float64, device=device)
    weights.scale, weights.shift = wp.ones(1, dtype=wp.float64, device=device), 0.5
    values = wp.ones(4, dtype=wp.float64, device=device)
    for power in (1, wp.int32(2), True):
        launch_again(weigh_kernel, (4,), [weights, values, power, out], device)
        np.testing.assert_array_equal(out.numpy(), np.full(4, 1.5))
    for wrong, text in ((wp.ones(4, dtype=wp.float32, device=device), "dtype"), (weights, "expects an array")):
        with pytest.raises(RuntimeError, match=text):
            launch_again(weigh_kernel, (4,), [weights, wrong, 1, out], device)
    with pytest.raises(RuntimeError, match="unable to pack"):
        launch_again(weigh_kernel, (4,), [weights, values, "one", out], device)
    launch_again(weigh_kernel, (4,), [weights, values, 1, out], device)
    np.testing.assert_array_equal(out.numpy(), np.full(4, 1.5))


def test_launches_are_recorded_with_a_graph(device: str) -> None:
    weights, out = Weights(), wp.zeros(4, dtype=wp.float64, device=device)
    weights.scale, weights.shift = wp.full(1, 3.0, dtype=wp.float64, device=device), 0.5
    values = wp.ones(4, dtype=wp.float64, device=device)
    launch_again(weigh_kernel, (4,), [weights, values, 1, out], device)
    with wp.ScopedCapture(device, force_module_load=False) as capture:
        launch_again(weigh_kernel, (4,), [weights, values, 1, out], device)
    values.fill_(2.0)
    wp.capture_launch(capture.graph)
    np.testing.assert_array_equal(out.numpy(), np.full(4, 6.5))


def test_arguments_are_not_kept_alive(device: str) -> None:
    weights, values = Weights(), wp.ones(4, dtype=wp.float64, device=device)
    weights.scale = wp.ones(1, dtype=wp.float64, device=device)
    out = wp.zeros(4, dtype=wp.float64, device=device)
    launch_again(weigh_kernel, (4,), [weights, values, 1, out], device)
    launch_again(weigh_kernel, (4,), [weights, values, 1, out], device)
    gone = [weakref.ref(one) for one in (weights, weights.scale, values)]
    wp.synchronize_device(device)
    del weights, values
    gc.collect()
    assert all(one() is None for one in gone)
