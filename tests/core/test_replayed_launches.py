"""Launches that are replayed do what they did when they were recorded, on what is in the arrays now."""

import numpy as np
import warp as wp

from mmw.core.packed_arrays import PackedArrays
from mmw.core.replayed_launches import ReplayedLaunches


@wp.kernel
def scaled_kernel(values: wp.array[wp.float64], scale: wp.float64, out: wp.array[wp.float64]):
    """Write scale * value. Launch: dim=N."""
    index = wp.tid()
    out[index] = scale * values[index]


def test_each_call_sees_new_values_and_numbers(device: str) -> None:
    block = PackedArrays(device, (((3,), wp.float64),), is_pinned=True)
    out = wp.zeros(3, dtype=wp.float64, device=device)
    replayed, scale, calls = ReplayedLaunches(device), 1.0, []

    def launch() -> None:
        calls.append(scale)
        wp.launch(scaled_kernel, 3, inputs=[*block.upload(), scale], outputs=[out], device=device)

    for step, factor in enumerate((2.0, 2.0, 2.0, 2.0, 5.0, 5.0, 5.0)):
        scale = factor
        block.host[0][:] = [step, step + 1.0, -step]
        replayed.run(launch, scale)
        np.testing.assert_array_equal(out.numpy(), scale * np.array([step, step + 1.0, -step]))
    is_cuda = wp.get_device(device).is_cuda
    assert calls == ([2.0, 2.0, 5.0, 5.0] if is_cuda and wp.is_mempool_enabled(device) else [2.0] * 4 + [5.0] * 3)
