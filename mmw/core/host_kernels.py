"""Run kernels on the host, on NumPy arrays: for a few rows one launch takes the time of some calls of NumPy."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from mmw.core.packed_arrays import Layout, PackedArrays, padded_count, take_free
from mmw.core.repeated_launch import launch_again

HOST = "cpu"
"""Warp device of the host."""


def run_on_host(
    kernel: wp.Kernel,
    dim: tuple[int, ...],
    inputs: Sequence[np.ndarray],
    others: Sequence[Any],
    outputs: tuple[tuple[int, ...], ...],
) -> list[np.ndarray]:
    """Return the outputs of a kernel, arrays of NumPy.

    Args:
        kernel: The kernel. Its arguments are the inputs, the others, the outputs. Inputs, or outputs, may be the fields
            of a struct, in their order, which is quicker to launch than single arrays.
        dim: Launch size.
        inputs: Values of each input; a vector, matrix or complex number is the last axes.
        others: Numbers, and arrays and structs of the host that stay the same from call to call.
        outputs: Shape of each output, without the axes of its elements.
    """
    plan = _plan(kernel, tuple([values.shape for values in inputs]), outputs)
    block = take_free(plan.free) or _Block(plan)
    for view, values in zip(block.inputs, inputs, strict=True):
        view[: len(values)] = values
    launch_again(kernel, dim, [*block.before, *others, *block.behind], HOST)
    made = [view[: shape[0]].copy() for view, shape in zip(block.outputs, outputs, strict=True)]
    if block.is_kept:
        plan.free.append(block)
    return made


@dataclass(frozen=True)
class _Plan:
    """Arrays of a kernel, with room for as many rows as blocks that are used again have."""

    layouts: tuple[Layout, ...]
    """Shape and type of each."""
    groups: tuple[tuple[Any, int], ...]
    """Arguments that they are: a struct, or None for a single array, and the number of arrays."""
    input_count: int
    """Number of inputs; outputs follow."""
    free: "deque[_Block]"
    """Blocks that nobody uses; found with the plan, since the hash of layouts would take as long as the kernel."""


class _Block:
    """Memory of a plan, as arrays of the host and as arguments of the kernel."""

    def __init__(self, plan: _Plan) -> None:
        self._arrays = PackedArrays(HOST, plan.layouts)
        many = plan.input_count
        self.inputs, self.outputs = self._arrays.host[:many], self._arrays.host[many:]
        self.is_kept = self._arrays.is_kept
        self.before: list[Any] = []
        self.behind: list[Any] = []
        first = 0
        for struct, count in plan.groups:
            own = self._arrays.arrays[first : first + count]
            (self.before if first < many else self.behind).append(own[0] if struct is None else _filled(struct, own))
            first += count


def _filled(struct: Any, arrays: Sequence[wp.array]) -> Any:
    made = struct()
    for name, array in zip(struct.vars, arrays, strict=True):
        setattr(made, name, array)
    return made


_free: dict[tuple[wp.Kernel, tuple[Layout, ...]], deque[_Block]] = {}
"""Blocks of all plans with equal layouts."""


@lru_cache(4096)
def _plan(kernel: wp.Kernel, shapes: tuple[tuple[int, ...], ...], outputs: tuple[tuple[int, ...], ...]) -> _Plan:
    """Return the plan of a kernel for the shapes of its inputs and outputs.

    What has no rows stays without: kernels tell what there is not by that.
    """
    types = [argument.type for argument in kernel.adj.args]
    before, kinds = _groups(types, len(shapes))
    behind, made = _groups(types, len(outputs), is_last=True)
    shapes = tuple(shape[: kind.ndim] for shape, kind in zip(shapes, kinds, strict=True)) + outputs
    layouts = tuple(
        ((padded_count(shape[0]), *shape[1:]) if shape[0] else shape, kind.dtype)
        for shape, kind in zip(shapes, (*kinds, *made), strict=True)
    )
    return _Plan(layouts, (*before, *behind), len(kinds), _free.setdefault((kernel, layouts), deque()))


def _groups(types: Sequence[Any], count: int, *, is_last: bool = False) -> tuple[list[tuple[Any, int]], list[Any]]:
    """Return the arguments that the first, or last, arrays of a signature are, and the types of these arrays."""
    groups: list[tuple[Any, list[Any]]] = []
    for kind in reversed(types) if is_last else types:
        if sum(len(fields) for _, fields in groups) >= count:
            break
        is_struct = hasattr(kind, "vars") and not hasattr(kind, "ndim")
        groups.append((kind, [field.type for field in kind.vars.values()]) if is_struct else (None, [kind]))
    if is_last:
        groups.reverse()
    return [(struct, len(fields)) for struct, fields in groups], [kind for _, fields in groups for kind in fields]


def as_pairs(values: np.ndarray) -> np.ndarray:
    """Return complex numbers as pairs of real and imaginary part, a view if they are contiguous, [...] -> [..., 2]."""
    values = np.ascontiguousarray(values, dtype=np.complex128)
    return values.view(np.float64).reshape(*values.shape, 2)


def as_complex(pairs: np.ndarray) -> np.ndarray:
    """Return pairs of real and imaginary part as complex numbers, a view, shape [..., 2] -> [...]."""
    return pairs.view(np.complex128)[..., 0]
