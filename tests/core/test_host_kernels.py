"""Kernels on the host take and return arrays of NumPy of any number of rows."""

import numpy as np
import warp as wp

from mmw.core.host_kernels import as_complex, as_pairs, run_on_host


@wp.kernel
def turn_kernel(
    vector: wp.array[wp.vec3d],
    matrix: wp.array2d[wp.mat22d],
    flag: wp.array[wp.bool],
    scale: wp.float64,
    length_out: wp.array[wp.float64],
    number_out: wp.array2d[wp.vec2d],
):
    """Write lengths, and first columns of matrices as numbers, 0 without flags. Launch: dim=(N, M)."""
    row, column = wp.tid()
    length_out[row] = scale * wp.length(vector[row])
    number = wp.vec2d(wp.float64(0.0), wp.float64(0.0))
    if flag.shape[0] > 0 and flag[row]:
        number = wp.vec2d(matrix[row, column][0, 0], matrix[row, column][1, 0])
    number_out[row, column] = number


@wp.struct
class Turned:
    """Inputs of the kernel below."""

    vector: wp.array[wp.vec3d]
    matrix: wp.array2d[wp.mat22d]
    flag: wp.array[wp.bool]


@wp.struct
class Found:
    """Its outputs."""

    length: wp.array[wp.float64]
    number: wp.array2d[wp.vec2d]


@wp.kernel
def packed_kernel(given: Turned, scale: wp.float64, found_out: Found):
    """Do the same as `turn_kernel`. Launch: dim=(N, M)."""
    row, column = wp.tid()
    found_out.length[row] = scale * wp.length(given.vector[row])
    number = wp.vec2d(wp.float64(0.0), wp.float64(0.0))
    if given.flag.shape[0] > 0 and given.flag[row]:
        number = wp.vec2d(given.matrix[row, column][0, 0], given.matrix[row, column][1, 0])
    found_out.number[row, column] = number


def launched(count: int, many: int, *, has_flags: bool = True, scale: float = 1.0) -> tuple[list[np.ndarray], ...]:
    """Return what the kernel gives and what it should, for random rows."""
    rng = np.random.default_rng(count)
    vector, matrix = rng.normal(size=(count, 3)), rng.normal(size=(count, many, 2, 2))
    flag = rng.random(count if has_flags else 0) < 0.5
    inputs, outputs = (vector, matrix, flag), ((count,), (count, many))
    found = run_on_host(turn_kernel, (count, many), inputs, [scale], outputs)
    packed = run_on_host(packed_kernel, (count, many), inputs, [scale], outputs)
    for one, other in zip(found, packed, strict=True):
        np.testing.assert_array_equal(one, other)
    (alone,) = run_on_host(packed_kernel, (count, many), inputs, [scale], outputs, 1)
    np.testing.assert_array_equal(alone, found[1])
    number = matrix[..., 0] * (flag if has_flags else np.zeros(count, dtype=bool))[:, None, None]
    return found, [scale * np.linalg.norm(vector, axis=1), number]


def test_rows_of_any_number_and_shape() -> None:
    kept = []
    for count, many in ((5, 2), (6, 2), (70, 2), (5, 3), (1, 1), (5, 2), (400_000, 1)):
        found, expected = launched(count, many, scale=float(count))
        for one, other in zip(found, expected, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-15)
        kept.append((found, expected))
    for found, expected in kept:  # later calls write elsewhere
        np.testing.assert_allclose(found[0], expected[0], rtol=1e-15)


def test_nothing_has_no_rows_in_the_kernel_either() -> None:
    found, _ = launched(9, 2, has_flags=False)
    assert (found[1] == 0.0).all()
    found, _ = launched(0, 2)
    assert found[0].shape == (0,) and found[1].shape == (0, 2, 2)


def test_pairs_are_complex_numbers() -> None:
    values = np.arange(12.0).reshape(2, 6) - 1j
    pairs = as_pairs(values[:, ::2])
    assert pairs.shape == (2, 3, 2)
    np.testing.assert_array_equal(as_complex(pairs), values[:, ::2])
    np.testing.assert_array_equal(as_pairs(np.array([3.0])), [[3.0, 0.0]])
