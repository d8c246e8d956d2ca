"""Run kernels on the host, on NumPy arrays: for a few rows one launch takes the time of some calls of NumPy."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from mmw.core.packed_arrays import Layout, PackedArrays, padded_count, take_free
from mmw.core.repeated_launch import RecordedLaunch, recorded_launch

HOST = "cpu"
"""Warp device of the host."""


def run_on_host(
    kernel: wp.Kernel,
    dim: tuple[int, ...],
    inputs: Sequence[np.ndarray],
    others: Sequence[Any],
    outputs: tuple[tuple[int, ...], ...],
    scratch: int = 0,
) -> list[np.ndarray]:
    """Return the outputs of a kernel, arrays of NumPy.

    Args:
        kernel: The kernel. Its arguments are the inputs, the others, the outputs. Inputs, or outputs, may be the fields
            of a struct, in their order, which is quicker to launch than single arrays.
        dim: Launch size.
        inputs: Values of each input; a vector, matrix or complex number is the last axes.
        others: Numbers, arrays and structs of the host, mostly the same in all calls. Fields of a struct never change.
        outputs: Shape of each output, without the axes of its elements.
        scratch: Number of first outputs that are scratch, which are not returned.
    """
    plan = _plan(kernel, tuple([values.shape for values in inputs]), outputs)
    block = take_free(plan.free) or _Block(plan)
    if block.plan is not plan:
        block.fit(plan)
    for view, values in zip(block.inputs, inputs, strict=True):
        view[...] = values
    if 0 not in dim:
        block.launch(kernel, dim, others)
    made = [view.copy() for view in block.outputs[scratch:]]
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
    rows: tuple[int, ...]
    """Rows of each array that are used."""
    input_count: int
    """Number of inputs; outputs follow."""
    free: "deque[_Block]"
    """Blocks that nobody uses; found with the plan, since the hash of layouts would take as long as the kernel."""


class _Block:
    """Memory of a plan, as arrays of the host and as arguments of the kernel.

    Attributes:
        plan: The last plan, one of those with equal layouts.
        inputs: Used rows of each input.
        outputs: Used rows of each output.
    """

    def __init__(self, plan: _Plan) -> None:
        self._arrays = PackedArrays(HOST, plan.layouts)
        self.is_kept = self._arrays.is_kept
        self._before: list[Any] = []
        self._behind: list[Any] = []
        self._launch: RecordedLaunch | None = None
        first = 0
        for struct, count in plan.groups:
            own = self._arrays.arrays[first : first + count]
            side = self._before if first < plan.input_count else self._behind
            side.append(own[0] if struct is None else _filled(struct, own))
            first += count
        self.fit(plan)

    def fit(self, plan: _Plan) -> None:
        """Use the rows of a plan."""
        views = [view[:count] for view, count in zip(self._arrays.host, plan.rows, strict=True)]
        self.plan, self.inputs, self.outputs = plan, views[: plan.input_count], views[plan.input_count :]

    def launch(self, kernel: wp.Kernel, dim: tuple[int, ...], others: Sequence[Any]) -> None:
        """Launch the kernel of the plan, by a record of its own: only the other arguments can be new ones."""
        arguments = [*self._before, *others, *self._behind]
        if self._launch is None:
            self._launch = recorded_launch(kernel, dim, arguments, HOST)
            self._launch.keep_structs()
        else:
            self._launch.update(dim, others, len(self._before))
        self._launch.run(arguments)


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
    rows, groups = tuple(shape[0] for shape in shapes), (*before, *behind)
    return _Plan(layouts, groups, rows, len(kinds), _free.setdefault((kernel, layouts), deque()))


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
    return np.ascontiguousarray(values, dtype=np.complex128)[..., None].view(np.float64)


def as_complex(pairs: np.ndarray) -> np.ndarray:
    """Return pairs of real and imaginary part as complex numbers, a view, shape [..., 2] -> [...]."""
    return pairs.view(np.complex128)[..., 0]
