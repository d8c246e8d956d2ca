"""Assumptions about numbers that Warp's compiler for the CPU may make in a kernel; the option `fast_math` is for CUDA
alone.

The flags are those of Clang's front end, for the module option `cpu_compiler_flags`. They may change with Clang: with
`compute.bvh: warp` kernels have only Warp's own, `NO_SLP` and `NO_CONTRACTION` (`mmw.core.bvh_kind.select_bvh`).
"""

import warp as wp

HOST = "-march=native" if wp.config.cpu_compiler_flags is None else wp.config.cpu_compiler_flags
"""Warp's own flags."""

FINITE = f"{HOST} -menable-no-nans -Wno-nan-infinity-disabled"
"""No number is NaN, so that minimum and maximum are one instruction each: rays take a quarter less time and
every result is the same. Numbers may be infinite. Not for kernels that ask whether a number is finite."""

FAST = f"{FINITE} -mreassociate -freciprocal-math -fno-signed-zeros -fapprox-func -ffp-contract=fast"
"""Sums may be taken in another order and quotients by a reciprocal too, as CUDA's `fast_math` does: for kernels that
shade, not for those that cast rays. Shading takes 10 % less time; a picture changes by rounding."""

PICTURE_RAYS = {
    "enable_backward": False,
    "default_grid_stride": False,
    "fast_math": True,
    "max_unroll": 1,
    "cpu_compiler_flags": FINITE,
}
"""Module options of kernels that cast the rays of pictures."""

PICTURE_SHADING = {**PICTURE_RAYS, "cpu_compiler_flags": FAST}
"""Module options of kernels that shade the pixels of pictures and filter their light."""

NO_SLP = "-fno-slp-vectorize"
"""Single numbers are not combined to vectors. With its own flags, Warp 1.19's compiler loses a coordinate of points on
slabs on processors with AVX2 and without AVX-512: `tests/channel/path_solver/test_refraction.py` fails there."""

NO_CONTRACTION = "-ffp-contract=off"
"""A product and a sum are rounded one after the other, as in NumPy, on every processor."""

DOUBLE_PRECISION = {
    "enable_backward": False,
    "default_grid_stride": False,
    "fast_math": False,
    "cpu_compiler_flags": f"{HOST} {NO_SLP}",
}
"""Module options of kernels that compute paths in float64."""

AS_NUMPY = {**DOUBLE_PRECISION, "cpu_compiler_flags": f"{HOST} {NO_SLP} {NO_CONTRACTION}"}
"""Module options of kernels of the host that have the bits of NumPy's float64."""
