"""Share what samples of sensors are made of: arrays of all views of a batch, on the host or on a device."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Literal, Self, TypeAlias, TypeVar

import numpy as np
import warp as wp

from mmw.core.transfer import to_host

Array: TypeAlias = Any
"""Array of a sample: of NumPy, or of Warp on the scene's device (`Output`)."""

S = TypeVar("S", bound="Samples | PointSamples")

Output = Literal["numpy", "warp"]
"""Arrays of a sample: `numpy` copies them to the host, `warp` leaves them on the device."""


@dataclass(frozen=True)
class Samples:
    """Arrays of A views along their first axis; the sample of one view has no such axis.

    The base of samples that `mmw.sensors.scene_capture` takes apart; sensors of other packages may derive from it.
    """

    def view(self, index: int) -> Self:
        """Return the sample of one view."""
        return replace(self, **{name: _part(value, index) for name, value in _values(self).items()})


@dataclass(frozen=True)
class PointSamples:
    """Arrays of N points along their first axis: those of view a are rows `offsets[a]` to `offsets[a + 1]`."""

    offsets: np.ndarray
    """First point of every view, and N, shape [A + 1], int32."""

    def __len__(self) -> int:
        return int(self.offsets[-1])

    def view(self, index: int) -> Self:
        """Return the points of one view; its `offsets` are 0 and their number."""
        begin, end = (int(row) for row in self.offsets[index : index + 2])
        points = {
            name: value[begin:end] for name, value in _values(self).items() if is_array(value) and name != "offsets"
        }
        return replace(self, offsets=np.array([0, end - begin], dtype=np.int32), **points)


def is_array(value: object) -> bool:
    """Return whether a value is an array of NumPy or Warp."""
    return isinstance(value, np.ndarray | wp.array)


def _values(samples: Any) -> dict[str, Any]:
    return {field.name: getattr(samples, field.name) for field in fields(samples)}


def _part(value: Any, index: int) -> Any:
    if is_array(value):
        return value[index]
    return value.view(index) if isinstance(value, Samples | PointSamples) else value


def to_output(array: wp.array, output: Output) -> Array:
    """Return an array of a device as samples hold it."""
    return to_host([array])[0] if output == "numpy" else array


def join(parts: Sequence[S]) -> S:
    """Return the samples of several batches of views as those of one; a single batch is not copied."""
    if len(parts) == 1:
        return parts[0]
    columns = [_values(part) for part in parts]
    return replace(parts[0], **{name: _joined(name, [column[name] for column in columns]) for name in columns[0]})


def _joined(name: str, values: Sequence[Any]) -> Any:
    if isinstance(values[0], Samples | PointSamples):
        return join(values)
    if not is_array(values[0]):
        return values[0]
    if name == "offsets":
        firsts = np.cumsum([0, *(offsets[-1] for offsets in values)])
        shifted = [offsets[1:] + first for offsets, first in zip(values, firsts, strict=False)]
        return np.concatenate([[0], *shifted]).astype(np.int32)
    if isinstance(values[0], np.ndarray):
        return np.concatenate(values)
    whole = wp.empty(
        (sum(part.shape[0] for part in values), *values[0].shape[1:]), dtype=values[0].dtype, device=values[0].device
    )
    begin = 0
    for part in values:
        if part.size:
            wp.copy(whole[begin : begin + part.shape[0]], part)
        begin += part.shape[0]
    return whole
