"""Arrays from the device to the host: right values, and buffers that nobody looks at any more are used again."""

import gc

import numpy as np
import pytest
import warp as wp

from mmw.core import transfer as host
from mmw.core.transfer import HostCopy, to_host


def filled(device: str, seed: int) -> list[wp.array]:
    rng = np.random.default_rng(seed)
    return [
        wp.array(rng.normal(size=(4, 1000)).astype(np.float32), device=device),
        wp.array(rng.integers(0, 99, 5000).astype(np.int32), device=device),
        wp.array(rng.integers(0, 99, (2, 3)).astype(np.uint8), device=device),
        wp.empty(0, dtype=float, device=device),
    ]


@pytest.mark.parametrize("pool_bytes", [host.POOL_BYTES, 0])
def test_copies_keep_their_values(device: str, monkeypatch: pytest.MonkeyPatch, pool_bytes: int) -> None:
    monkeypatch.setattr(host, "POOL_BYTES", pool_bytes)
    sources = [filled(device, seed) for seed in range(4)]
    copies = [to_host(arrays) for arrays in sources]  # all held, so none may share a buffer
    for arrays, copy in zip(sources, copies, strict=True):
        for array, values in zip(arrays, copy, strict=True):
            assert values.shape == array.shape
            np.testing.assert_array_equal(values, array.numpy())


def test_a_copy_has_what_was_launched_before_it(device: str) -> None:
    late = wp.zeros(1 << 20, dtype=int, device=device)
    for k in range(20):
        late.fill_(k)
    copy = HostCopy([late])
    other = wp.zeros(1 << 20, dtype=int, device=device)
    other.fill_(7)
    (found,) = copy.wait()
    assert (found == 19).all() and (to_host([other])[0] == 7).all()


def test_buffers_are_used_again(device: str) -> None:
    if device == "cpu":
        arrays = filled(device, 0)
        assert all(np.shares_memory(a.numpy(), b) for a, b in zip(arrays[:3], to_host(arrays)[:3], strict=True))
        return
    taken = []
    for seed in range(6):
        row = to_host(filled(device, seed))[0][1]  # a view alone keeps its buffer
        taken.append(host._allocated)
        np.testing.assert_array_equal(row, filled(device, seed)[0].numpy()[1])
        del row
        gc.collect()
    assert taken[-1] == taken[1]
    assert to_host([]) == []
