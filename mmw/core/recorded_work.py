"""Run launches on a device directly, or record them once and replay them as one call on arrays that stay.

A record repeats launches with the arguments that they had: the same arrays, numbers and structs. So what changes from
call to call comes in arrays of one packed block (`PackedArrays`), what is written goes to arrays that a record keeps,
and no number comes back to the host in between. On CUDA a record is a graph; Warp records on the CPU too.
"""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from abc import ABC, abstractmethod
from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import warp as wp

from mmw.core.packed_arrays import HostViews, Layout, PackedArrays, borrow_arrays, device_arrays, packed_block
from mmw.core.transfer import HostCopy, scalar_type, to_host

T = TypeVar("T")

KEPT_BYTES = 4 << 30
"""Most memory of the arrays of all records of a `RecordedWork` [bytes]: the oldest are dropped beyond. An RGB image in
one weather takes 170 bytes a pixel: 13 images of 640 x 480 take 0.7 GB. Design value."""


class Same:
    """Names an object by its identity in the key of recorded work."""

    def __init__(self, value: object) -> None:
        """Name an object, and keep it."""
        self._value = value

    def __eq__(self, other: object) -> bool:
        """Return whether both name the same object."""
        return isinstance(other, Same) and self._value is other._value

    def __hash__(self) -> int:
        """Return the object's number."""
        return id(self._value)


Input = tuple[np.ndarray, Any]
"""Values and Warp type of an array; a vector is the last axis of the values."""


class NewArrays:
    """Source of arrays that launches write: new ones every time.

    Attributes:
        device: Warp device.
    """

    def __init__(self, device: str) -> None:
        """Allocate on a device."""
        self.device = device

    def empty(self, shape: int | tuple[int, ...], kind: Any) -> wp.array:
        """Return an array of a shape and Warp type with undefined values."""
        return self._take((shape, kind), lambda: wp.empty(shape, dtype=kind, device=self.device))

    def full(self, shape: int | tuple[int, ...], value: Any, kind: Any) -> wp.array:
        """Return an array whose elements have one value."""
        array = self.empty(shape, kind)
        if array.size:
            array.fill_(value)
        return array

    def struct(self, kind: Any, shape: int | tuple[int, ...], **shapes: int | tuple[int, ...]) -> Any:
        """Return a struct of arrays of one shape, but for those with a shape of their own, with undefined values.

        The arrays lie in one block of memory: an allocation costs the same for one as for all.
        """
        layouts = [(_shape(shapes.get(name, shape)), var.type.dtype) for name, var in kind.vars.items()]

        def make() -> Any:
            result = kind()
            for name, array in zip(kind.vars, device_arrays(self.device, layouts), strict=True):
                setattr(result, name, array)
            return result

        return self._take((kind, *layouts), make)

    def packed(self, layouts: Sequence[Layout]) -> tuple[wp.array, list[wp.array], HostViews]:
        """Return a block of bytes, arrays that share it, and what finds them in a copy of it on the host."""
        return self._take(("packed", *layouts), lambda: packed_block(self.device, layouts))

    def pinned_copy(self, block: wp.array) -> wp.array | None:
        """Return memory of the host that launches may copy a block to; None where the host fetches it."""
        return None

    def block(self, layouts: tuple[Layout, ...], *, is_scratch: bool = False) -> PackedArrays:
        """Return arrays in one block, with a side on the host but for scratch."""
        key = "block", is_scratch, layouts
        return self._take(key, lambda: PackedArrays(self.device, layouts, is_scratch, is_pinned=True))

    def once(self, name: str, make: Callable[[], T]) -> T:
        """Return what a function makes from what does not change: arrays of constants."""
        return self._take(("once", name), make)

    def _take(self, what: Hashable, make: Callable[[], T]) -> T:
        return make()


class GatheredArrays:
    """Copy of some arrays in one block, which comes to the host in one piece, see `Work.gathered`.

    Attributes:
        block: The block on the device.
        pinned: Page-locked memory on the host to which the launches copy the block; None where they do not.
        source: Source of the arrays.
    """

    def __init__(self, arrays: NewArrays, parts: Sequence[wp.array]) -> None:
        """Copy arrays to a block from a source of arrays."""
        layouts = [(part.shape, part.dtype) for part in parts]
        self.source = arrays
        self.block, places, self._views = arrays.packed(layouts)
        for part, place in zip(parts, places, strict=True):
            if part.size:
                wp.copy(place, part)
        self.pinned = arrays.pinned_copy(self.block)
        if self.pinned is not None:
            wp.copy(self.pinned, self.block)

    def on_host(self, block: np.ndarray) -> list[np.ndarray]:
        """Return the arrays as parts of the block on the host."""
        return self._views(block)


class KeptArrays(NewArrays):
    """Source of arrays that gives the same ones again, in the order of the first time, after each `rewind`.

    Attributes:
        done: End of the last launches that write the arrays, on CUDA.
    """

    def __init__(self, device: str) -> None:
        """Hold nothing yet."""
        super().__init__(device)
        self.done: wp.Event | None = None
        self._kept: list[tuple[Hashable, Any]] = []
        self._next = 0

    def rewind(self) -> None:
        """Begin with the first array again."""
        self._next = 0

    @property
    def size(self) -> int:
        """Memory of all arrays [bytes]."""
        return sum(_bytes(value) for _, value in self._kept)

    def pinned_copy(self, block: wp.array) -> wp.array | None:
        """See `NewArrays.pinned_copy`; a GPU copies small results itself, so that the host only waits."""
        if not wp.get_device(self.device).is_cuda:
            return None
        shape, kind = block.shape, block.dtype
        return self._take(("pinned", shape, kind), lambda: wp.empty(shape, dtype=kind, device="cpu", pinned=True))

    def _take(self, what: Hashable, make: Callable[[], T]) -> T:
        if self._next == len(self._kept):
            self._kept.append((what, make()))
        known, value = self._kept[self._next]
        if known != what:
            raise RuntimeError(
                f"array {self._next} of recorded work: {what} is asked for where it was {known}; what decides its "
                "shape must be part of the key of the work"
            )
        self._next += 1
        return value


Launch = Callable[[NewArrays, list[wp.array]], T]
"""See `Work.run`."""


class Work(ABC):
    """Runs launches on a device, see `run`.

    Attributes:
        device: Warp device.
        runs_beside: Whether the device goes on with what `run` launched beside what is launched within its statement.
    """

    runs_beside = False

    def __init__(self, device: str) -> None:
        """Run on a device."""
        self.device = device

    @abstractmethod
    def run(self, key: Hashable, inputs: Sequence[Input], launch: Launch[T]) -> AbstractContextManager[T]:
        """Copy values to the device and launch; the value of the `with` statement is what `launch` returned.

        The arrays of the result hold until the end of the statement, and come to the host by `to_host` alone. Several
        statements may be open at once. What launches read must not change within the statement.

        Args:
            key: All that decides what `launch` does, beside the values and shapes of the inputs; `Same` for objects.
            inputs: Values that go to the device, and their Warp types.
            launch: Launches kernels, given a source of all arrays that it needs, and the inputs on the device. It
                neither waits nor copies from or to the host.
        """

    def forget(self, key: Hashable, inputs: Sequence[Input]) -> None:  # noqa: B027  (direct work remembers nothing)
        """Drop what is kept of work that will not be run again with this key and inputs of these shapes."""

    @abstractmethod
    def to_host(self, arrays: Sequence[wp.array]) -> list[np.ndarray]:
        """Return arrays of a result as NumPy arrays that outlive it, after a single wait."""

    @abstractmethod
    def host_copy(self, arrays: Sequence[wp.array]) -> HostCopy:
        """Queue the copy of arrays of a result behind the launches, within the statement; `to_host` puts it off."""

    def gathered(self, gathered: GatheredArrays) -> list[np.ndarray]:
        """Return the arrays of a block that the launches gathered, as of `to_host`."""
        (block,) = self.to_host([gathered.block])
        return gathered.on_host(block)


class DirectWork(Work):
    """Launches at once, on new arrays."""

    @contextmanager
    def run(self, key: Hashable, inputs: Sequence[Input], launch: Launch[T]) -> Iterator[T]:
        """See `Work.run`."""
        block = borrow_arrays(self.device, *_layouts(inputs))
        _write(block, inputs)
        yield launch(NewArrays(self.device), block.upload())
        block.release()

    def to_host(self, arrays: Sequence[wp.array]) -> list[np.ndarray]:
        """See `Work.to_host`."""
        return to_host(arrays)

    def host_copy(self, arrays: Sequence[wp.array]) -> HostCopy:
        """See `Work.host_copy`."""
        return HostCopy(arrays)


@dataclass
class _Record:
    """Work of one key."""

    inputs: PackedArrays
    arrays: KeptArrays
    result: Any
    graph: wp.Graph | None = None
    is_busy: bool = False
    """True while the statement of a call holds the result."""


def can_record(device: str) -> bool:
    """Return whether work on a device can be recorded: sums of arrays allocate, for which CUDA needs memory pools."""
    return not wp.get_device(device).is_cuda or wp.is_mempool_enabled(device)


def prefers_records(device: str) -> bool:
    """Return whether records save time on a device: on the CPU they save little, and stop other threads."""
    return wp.get_device(device).is_cuda and can_record(device)


class RecordedWork(Work):
    """Launches directly at the first call with a key, records the second one, and replays the record from then on.

    The first call loads the kernels and makes all arrays, so that the record holds launches alone. See `can_record`.
    On CUDA records are replayed in a stream of their own, after all that was launched before: what is launched then
    neither waits for them nor holds them up. They touch nothing but their own arrays and what they read, and a call
    ends when the device is done, so that there is nothing else to be put in order.
    """

    runs_beside = True

    def __init__(self, device: str) -> None:
        """Hold no record yet."""
        super().__init__(device)
        self._records: OrderedDict[tuple[Hashable, tuple[Layout, ...], int], _Record] = OrderedDict()
        self._stream = wp.Stream(device) if wp.get_device(device).is_cuda else None

    @contextmanager
    def run(self, key: Hashable, inputs: Sequence[Input], launch: Launch[T]) -> Iterator[T]:
        """See `Work.run`."""
        record = self._launched(key, inputs, launch)
        record.is_busy = True
        try:
            yield record.result
        finally:
            if record.arrays.done is not None:  # over already where results were read
                wp.synchronize_event(record.arrays.done)
            record.is_busy = False

    def _launched(self, key: Hashable, inputs: Sequence[Input], launch: Launch[Any]) -> _Record:
        """Return a record that no open statement holds, whose launches the device works on."""
        layouts, number = _layouts(inputs), 0
        while (record := self._records.get((key, layouts, number))) is not None and record.is_busy:
            number += 1
        if record is None:
            block, arrays = PackedArrays(self.device, layouts, is_pinned=True), KeptArrays(self.device)
            _write(block, inputs)
            record = _Record(block, arrays, launch(arrays, block.upload()))
            self._records[key, layouts, number] = record
            self._drop()
            if self._stream is not None:
                record.arrays.done = wp.get_stream(self.device).record_event()
                self._stream.wait_event(record.arrays.done)  # copies to the host go into that stream
            return record
        self._records.move_to_end((key, layouts, number))
        _write(record.inputs, inputs)
        if record.graph is None:
            record.arrays.rewind()
            with wp.ScopedCapture(self.device, force_module_load=False) as capture:
                record.result = launch(record.arrays, record.inputs.upload())
            record.graph = capture.graph
        if self._stream is not None:
            self._stream.wait_stream(wp.get_stream(self.device))
        wp.capture_launch(record.graph, self._stream)
        if self._stream is not None:
            record.arrays.done = self._stream.record_event(record.arrays.done)
        return record

    def to_host(self, arrays: Sequence[wp.array]) -> list[np.ndarray]:
        """See `Work.to_host`."""
        return self.host_copy(arrays).wait()

    def host_copy(self, arrays: Sequence[wp.array]) -> HostCopy:
        """See `Work.host_copy`."""
        return HostCopy(arrays, self._stream, is_new=True)

    def gathered(self, gathered: GatheredArrays) -> list[np.ndarray]:
        """See `Work.gathered`."""
        if gathered.pinned is None:
            return super().gathered(gathered)
        assert isinstance(gathered.source, KeptArrays) and gathered.source.done is not None
        wp.synchronize_event(gathered.source.done)
        return gathered.on_host(gathered.pinned.numpy().copy())

    def forget(self, key: Hashable, inputs: Sequence[Input]) -> None:
        """See `Work.forget`."""
        own = key, _layouts(inputs)
        for place in [place for place in self._records if place[:2] == own]:
            del self._records[place]

    def _drop(self) -> None:
        """Drop the records that were not used for longest, as long as there are several with too much memory."""
        size = sum(record.arrays.size for record in self._records.values())
        while size > KEPT_BYTES and len(self._records) > 1:
            size -= self._records.popitem(last=False)[1].arrays.size


def _layouts(inputs: Sequence[Input]) -> tuple[Layout, ...]:
    return tuple((values.shape[: values.ndim - len(scalar_type(kind)[1])], kind) for values, kind in inputs)


def _write(block: PackedArrays, inputs: Sequence[Input]) -> None:
    for target, (values, _) in zip(block.host, inputs, strict=True):
        target[...] = values


def _shape(shape: int | tuple[int, ...]) -> tuple[int, ...]:
    return (shape,) if isinstance(shape, int) else shape


def _bytes(value: Any) -> int:
    """Return the memory of an array, of those of a struct, or of a packed block [bytes]."""
    if isinstance(value, wp.array):
        return value.size * wp.types.type_size_in_bytes(value.dtype)
    if isinstance(value, PackedArrays):
        return value.size
    if isinstance(value, tuple):
        return _bytes(value[0])
    return sum(_bytes(getattr(value, name)) for name in value._cls.vars)
