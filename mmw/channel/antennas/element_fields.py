"""Launch the kernels of element patterns and fields; apart from patterns, since datasets are read without Warp."""

from collections.abc import Callable

import numpy as np

from mmw.core.host_kernels import as_complex, as_pairs, run_on_host
from mmw.kernels.channel.antenna_field import (
    local_angles_kernel,
    pattern_field_kernel,
    pattern_kernel,
    slanted_field_kernel,
)

Rows = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Directions [N, 3], their zenith and azimuth [N], and antenna-to-world rotations [N, 3, 3]."""


def pattern_amplitude(number: int, theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Return the amplitude of a pattern of mmw in directions [rad], of the shape of the angles.

    Args:
        number: Place of the pattern in `mmw.channel.antennas.patterns.PatternName`.
        theta: Zenith in the antenna's frame [rad].
        phi: Azimuth in the antenna's frame [rad].
    """
    both = np.broadcast_arrays(np.asarray(theta, dtype=np.float64), np.asarray(phi, dtype=np.float64))
    inputs, shape = [angle.reshape(-1) for angle in both], (both[0].size,)
    (amplitude,) = run_on_host(pattern_kernel, shape, inputs, [number], (shape,))
    return amplitude.reshape(both[0].shape)


def pattern_field(number: int, rows: Rows, slants: np.ndarray, is_turned_in_space: bool) -> np.ndarray:
    """Return the field (theta, phi) in the world's basis of elements of a pattern of mmw, shape [N, elements, 2].

    Args:
        number: Place of the pattern in `mmw.channel.antennas.patterns.PatternName`.
        rows: The directions.
        slants: Slant of each element [rad].
        is_turned_in_space: Whether the polarization model is `tr38901_1`.
    """
    shape = (len(rows[0]), len(slants))
    return run_on_host(pattern_field_kernel, shape, (*rows, slants), (number, is_turned_in_space), (shape,))[0]


def slanted_field(
    components: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]],
    rows: Rows,
    slants: np.ndarray,
    is_turned_in_space: bool,
) -> np.ndarray:
    """Return the field of elements whose amplitudes a function of zenith and azimuth gives, shape [N, elements, 2].

    It is real, or complex for a complex amplitude.

    Args:
        components: Function that returns the amplitudes (C_theta, C_phi) without a slant.
        rows: The directions.
        slants: Slant of each element [rad].
        is_turned_in_space: Whether the polarization model is `tr38901_1`.
    """
    count, shape = len(rows[0]), (len(rows[0]), len(slants))
    local, turn = run_on_host(local_angles_kernel, (count,), rows, (), ((count,), (count,)))
    amplitude = np.stack(components(*np.ascontiguousarray(local.T)), axis=1)
    inputs = as_pairs(amplitude), local, turn, slants
    (field,) = run_on_host(slanted_field_kernel, shape, inputs, [is_turned_in_space], ((*shape, 2),))
    return as_complex(field) if np.iscomplexobj(amplitude) else np.ascontiguousarray(field[..., 0])
