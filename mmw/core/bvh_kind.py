"""Select the BVH of this process: our own of four children a node, or Warp's."""

import pkgutil
from importlib import import_module

import warp as wp

import mmw.kernels
from mmw.core.bvh_default import BVH_KINDS, BVH_VARIABLE, default_bvh
from mmw.core.errors import InputError
from mmw.kernels.core import bvh as tree
from mmw.kernels.core.compiler import HOST, NO_CONTRACTION, NO_SLP


class _Choice:
    """Choice of this process."""

    kind = "wide"
    """Kind that `mmw.kernels` is set to."""
    is_made = False
    """Whether the kind was chosen."""
    is_built = False
    """Whether a BVH was built, so that kernels may have been compiled for its kind."""


_flags: dict[str, str | None] = {}
"""Compiler flags that were removed from modules of kernels."""


def select_bvh(kind: str) -> None:
    """Choose the BVHs of this process, before it builds one; the same choice again changes nothing.

    Args:
        kind: `wide` for our own BVHs, `warp` for Warp's, without native code and with the compiler's plain flags.

    Raises:
        InputError: If there is no such kind, or this process has built a BVH of the other.
    """
    if kind not in BVH_KINDS:
        raise InputError(f"compute.bvh = {kind!r}; give {' or '.join(BVH_KINDS)}")
    if kind != _Choice.kind:
        if _Choice.is_built:
            raise InputError(
                f"compute.bvh = {kind!r}: this process has built a BVH of kind {_Choice.kind!r}, and its kernels are "
                f"compiled for one kind; start a new process, and set {BVH_VARIABLE} = {kind} for all that it does"
            )
        _compile_for(kind)
    _Choice.kind, _Choice.is_made = kind, True


def kind_to_build() -> str:
    """Return the BVH kind of this process for building one; it can no longer be changed.

    Raises:
        InputError: If no kind was chosen, and the environment names an unknown one.
    """
    if not _Choice.is_made:
        select_bvh(default_bvh())
    _Choice.is_built = True
    return _Choice.kind


def _compile_for(kind: str) -> None:
    """Set all kernels to a kind; those compiled for the other are compiled again at their next launch."""
    tree.WIDE = kind == "wide"
    for info in pkgutil.walk_packages(mmw.kernels.__path__, "mmw.kernels."):
        if info.ispkg:
            continue
        module = import_module(info.name)
        if kind == "warp":
            _flags[info.name] = wp.get_module(info.name).options["cpu_compiler_flags"]
        flags = _flags[info.name]
        if kind == "warp":
            kept = [flag for flag in (NO_SLP, NO_CONTRACTION) if flag in (flags or "")]
            flags = " ".join([HOST, *kept]) if kept else None
        # Warp reads a constant and the flags again for a module whose options were set.
        wp.set_module_options({"cpu_compiler_flags": flags}, module=module)
