"""Choose the default BVH of a process."""

import os
from typing import Literal, get_args

from mmw.core.errors import InputError

BvhKind = Literal["wide", "warp"]
BVH_KINDS: tuple[BvhKind, ...] = get_args(BvhKind)

BVH_VARIABLE = "MMW_BVH"
"""Environment variable with the default of `compute.bvh`, and with the BVH of commands without a configuration."""


def default_bvh() -> BvhKind:
    """Return the BVH kind of a process without a configuration: that of `MMW_BVH`, or our own.

    Raises:
        InputError: If the variable names an unknown kind.
    """
    name = os.environ.get(BVH_VARIABLE) or "wide"
    for kind in BVH_KINDS:
        if name == kind:
            return kind
    raise InputError(f"{BVH_VARIABLE} = {name!r} in the environment; set it to {' or '.join(BVH_KINDS)}, or unset it")
