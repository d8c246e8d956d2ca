"""Launch a kernel again and again: what stays the same from launch to launch is packed once."""

# Fields of Warp's recorded launches are optional or read-only to a type checker.
# pyright: reportIndexIssue=false, reportOptionalMemberAccess=false

import ctypes
import threading
from collections.abc import Sequence
from typing import Any
from weakref import ref

import warp as wp

NUMBERS = frozenset(
    (ctypes.c_bool, ctypes.c_int32, ctypes.c_uint32, ctypes.c_int64, ctypes.c_uint64, ctypes.c_float, ctypes.c_double)
)
"""C types of kernel arguments that hold a Python number as it is."""


def launch_again(
    kernel: wp.Kernel, dim: Sequence[int], arguments: Sequence[Any], device: str, block_dim: int | None = None
) -> None:
    """Launch a kernel as `wp.launch` does, in a fraction of its time where most arguments are objects of the last one.

    Fields of structs may have changed since. Nothing is kept alive for the next launch. Kernels stay as they were
    compiled for the first one.

    Args:
        kernel: The kernel.
        dim: Launch size.
        arguments: Inputs, then outputs.
        device: Warp device.
        block_dim: Threads of a block, see `wp.launch`.
    """
    key = kernel, device, block_dim
    launch = _launches.known.get(key)
    if launch is None:
        if 0 in dim:
            return
        launch = _launches.known[key] = recorded_launch(kernel, dim, arguments, device, block_dim)
    elif 0 in dim:
        return
    else:
        launch.update(dim, arguments)
    launch.run(arguments)


def recorded_launch(
    kernel: wp.Kernel, dim: Sequence[int], arguments: Sequence[Any], device: str, block_dim: int | None = None
) -> "RecordedLaunch":
    """Return a launch that has not run, with the arguments of `launch_again`, not of size 0."""
    command = wp.launch(kernel, dim, inputs=arguments, device=device, block_dim=block_dim, record_cmd=True)
    assert command is not None
    is_host = command.device.is_cpu and command.block_dim == 1
    return (_HostLaunch if is_host else RecordedLaunch)(command, dim, arguments)


class RecordedLaunch:
    """A recorded launch, with the size and arguments that it was given last.

    Attributes:
        dim: Its size.
        held: Numbers as they are, and weak references to arrays and structs.
    """

    def __init__(self, command: wp.Launch, dim: Sequence[int], arguments: Sequence[Any]) -> None:
        """Take a command and what it was recorded with."""
        command.fwd_args = None  # they would be kept alive
        self._command = command
        self._types = [_array_type(argument.type) for argument in command.kernel.adj.args]
        self.dim = dim
        self.held = [_held(value) for value in arguments]

    def keep_structs(self) -> None:
        """Take it that no field of a struct changes from here on."""

    def update(self, dim: Sequence[int], arguments: Sequence[Any], first: int = 0) -> None:
        """Take the size, which is not 0, and some arguments from `first` on of the next launch."""
        if self.dim != dim:
            self.resize(dim)
        held = self.held
        for index, new in enumerate(arguments, first):
            old = held[index]
            if old is not new and not (old.__class__ is ref and old() is new):
                self.change(index, new)

    def run(self, arguments: Sequence[Any]) -> None:
        """Launch; the arguments are all that it has."""
        self._command.launch()

    def resize(self, dim: Sequence[int]) -> None:
        """Set the size."""
        self._command.set_dim(dim)
        self.dim = dim

    def change(self, index: int, value: Any) -> None:
        """Set an argument."""
        params = self._command.params
        if value.__class__ is wp.array and self._types[index] == (value.dtype, value.ndim):
            params[index + 1] = value.__ctype__()
            self.held[index] = ref(value)
        elif value.__class__ in (int, float) and params[index + 1].__class__ in NUMBERS:
            params[index + 1].value = value
            self.held[index] = value
        else:  # in full, with the errors of Warp
            self._command.set_param_at_index(index, value)
            self.held[index] = _held(value)
        self._place(index, params[index + 1])

    def _place(self, index: int, packed: Any) -> None:
        if self._command.params_addr:  # on CUDA
            self._command.params_addr[index + 1] = ctypes.addressof(packed)


class _HostLaunch(RecordedLaunch):
    """A launch on the CPU: Warp calls a function with a structure of all arguments, which it makes for each launch."""

    def __init__(self, command: wp.Launch, dim: Sequence[int], arguments: Sequence[Any]) -> None:
        """See `RecordedLaunch`; make the structure."""
        super().__init__(command, dim, arguments)
        packed = command.params[1:]
        names = [f"argument_{index}" for index in range(len(packed))]
        kind = type("Arguments", (ctypes.Structure,), {"_fields_": list(zip(names, map(type, packed), strict=True))})
        self._arguments = kind(*packed)
        self._names = names
        self._structs = [
            (name, index)
            for index, (name, value) in enumerate(zip(names, arguments, strict=True))
            if hasattr(value, "_cls")
        ]
        self._call = command.hooks.forward
        self._reference = ctypes.byref(self._arguments)
        self._bounds = ctypes.byref(command.bounds)

    def keep_structs(self) -> None:
        """See `RecordedLaunch.keep_structs`."""
        self._structs.clear()

    def resize(self, dim: Sequence[int]) -> None:
        """See `RecordedLaunch.resize`."""
        super().resize(dim)
        self._bounds = ctypes.byref(self._command.bounds)

    def run(self, arguments: Sequence[Any]) -> None:
        """See `RecordedLaunch.run`."""
        command = self._command
        if command.device.is_capturing:  # Warp records the arguments themselves
            wp.launch(command.kernel, self.dim, inputs=arguments, device=command.device, block_dim=command.block_dim)
            return
        for name, index in self._structs:  # their fields may have changed
            setattr(self._arguments, name, command.params[index + 1])
        self._call(self._bounds, self._reference)

    def _place(self, index: int, packed: Any) -> None:
        setattr(self._arguments, self._names[index], packed)


def _array_type(kind: Any) -> tuple[Any, int] | None:
    return (kind.dtype, kind.ndim) if wp.types.is_array(kind) else None


def _held(value: Any) -> Any:
    return value if isinstance(value, (int, float)) else ref(value)


class _Launches(threading.local):
    """Launches of a thread, as it changes them."""

    def __init__(self) -> None:
        self.known: dict[tuple[wp.Kernel, str, int | None], RecordedLaunch] = {}


_launches = _Launches()
