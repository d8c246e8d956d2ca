"""Choose the default BVH of a process."""

import os
from typing import Literal, get_args

from mmw.core.errors import InputError

BvhKind = Literal["wide", "warp"]
BVH_KINDS: tuple[BvhKind, ...] = get_args(BvhKind)

BVH_VARIABLE = "MMW_BVH"
"""Environment variable that is the default of `compute.bvh`, and the choice of commands without a configuration."""


def default_bvh() -> BvhKind:
    """Return the trees of a process for which no configuration chooses: those of `MMW_BVH`, or our own.

    Raises:
        InputError: If the variable names no kind.
    """
    name = os.environ.get(BVH_VARIABLE) or "wide"
    for kind in BVH_KINDS:
        if name == kind:
            return kind
    raise InputError(f"{BVH_VARIABLE} = {name!r} in the environment; set it to {' or '.join(BVH_KINDS)}, or unset it")
