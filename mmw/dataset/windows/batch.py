"""Make batches of windows: arrays joined along a new first axis, point clouds and boxes padded."""

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from mmw.core.errors import InputError

Ragged = Literal["pad", "list"]


def make_batch(samples: Sequence[dict[str, Any]], ragged: Ragged = "pad") -> dict[str, Any]:
    """Return samples of `Windows` as one batch of new arrays.

    Args:
        samples: Windows of one dataset. A tuple of arrays, as `Windows.load` has it, is joined too.
        ragged: Treatment of a list of arrays [N, ...], such as point clouds and boxes. `pad`: KEY is [B, T, N, ...]
            with N the largest of the batch, zeros behind each (-1 where numbers are whole), and KEY_count [B, T],
            int64, is the number of valid rows. `list`: KEY is a list a window of a list a frame of arrays.

    Raises:
        InputError: If there is no sample, arrays of one key differ in shape, or `ragged` is neither.

    Examples:
        >>> from mmw.dataset.windows import Feature, WindowSpec, open_windows
        >>> spec = WindowSpec(["poses", Feature("lidar", every=2)], past=2, future=1)
        >>> windows = open_windows("out/quickstart", spec, weathers=["sunny"], agents=["cav"])
        >>> make_batch([windows[0], windows[1]])["lidar_count"].shape
        (2, 1)
    """
    if ragged not in ("pad", "list") or not samples:
        raise InputError(f"make_batch: {len(samples)} samples, ragged = {ragged!r}; give some, and pad or list")
    batch: dict[str, Any] = {}
    for key, first in samples[0].items():
        values = [sample[key] for sample in samples]
        if isinstance(first, list) and ragged == "list":
            batch[key] = [[np.array(one) for one in window] for window in values]
        elif isinstance(first, list):
            batch[key], batch[f"{key}_count"] = _pad(values)
        else:
            rows = [one for window in values for one in window] if isinstance(first, tuple) else values
            shapes = sorted({one.shape for one in rows})
            if len(shapes) > 1:
                raise InputError(f"batch: {key} has shapes {shapes}; choose sensors of one size, or `shrink` some")
            joined = np.stack(rows)
            batch[key] = joined.reshape(len(values), -1, *shapes[0]) if isinstance(first, tuple) else joined
    return batch


def _pad(values: list[list[np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Return ragged arrays as one, shape [B, T, N, ...], and how many of N count, shape [B, T]."""
    count = np.array([[len(one) for one in window] for window in values], dtype=np.int64)
    first = values[0][0]
    padded = np.empty((*count.shape, int(count.max()), *first.shape[1:]), dtype=first.dtype)
    empty = 0 if first.dtype.kind == "f" else -1
    for window, row in zip(padded, values, strict=True):
        for place, one in zip(window, row, strict=True):
            place[: len(one)] = one
            place[len(one) :] = empty
    return padded, count
