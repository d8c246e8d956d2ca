"""Interpolate a path between two instants: delay by a cubic, directions along an arc, transfer in carried bases."""

import numpy as np

from mmw.physics.em.vectors import direction_angles, dot, norm, spherical_basis, unit_vector


def cubic_between(
    values: tuple[np.ndarray, np.ndarray], slopes: tuple[np.ndarray, np.ndarray], s: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the cubic that has the given values and slopes at s = 0 and s = 1, and its slope, at s.

    With d = v_1 - v_0: v(s) = v_0 + r_0 s + (3 d - 2 r_0 - r_1) s^2 + (r_0 + r_1 - 2 d) s^3.

    Args:
        values: v_0 and v_1, shape [n] each.
        slopes: r_0 and r_1, changes from 0 to 1, shape [n] each.
        s: Position between the two, 0 to 1, shape [n].

    Returns:
        Value and slope, shape [n] each. At most 1 / 384 of the largest fourth derivative off, with exact slopes.

    Source: cubic Hermite interpolation, C. de Boor, A Practical Guide to Splines, chapter IV.
    """
    gap = values[1] - values[0]
    square, cube = 3.0 * gap - 2.0 * slopes[0] - slopes[1], slopes[0] + slopes[1] - 2.0 * gap
    value = values[0] + s * (slopes[0] + s * (square + s * cube))
    return value, slopes[0] + s * (2.0 * square + s * 3.0 * cube)


def direction_between(
    theta: tuple[np.ndarray, np.ndarray], phi: tuple[np.ndarray, np.ndarray], s: np.ndarray
) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Return the direction between two others, and the matrices that carry fields there.

    Args:
        theta: Zeniths of both directions, which are not opposite, shape [n] each.
        phi: Azimuths of both, shape [n] each.
        s: Position between the two, 0 to 1, shape [n].

    Returns:
        Zenith and azimuth of the unit vector in between, shape [n] each; and for both ends the matrix from
        components in the (theta, phi) basis there to components in the basis in between, shape [n, 2, 2] each.
    """
    ends = [unit_vector(*angles) for angles in zip(theta, phi, strict=True)]
    between = (1.0 - s)[:, None] * ends[0] + s[:, None] * ends[1]
    between = between / norm(between)[:, None]
    angles = direction_angles(between)
    basis = np.stack(spherical_basis(*angles), axis=1)
    turns = [_carried(theta[k], phi[k], ends[k], between, basis) for k in (0, 1)]
    return angles, (turns[0], turns[1])


def _carried(theta: np.ndarray, phi: np.ndarray, old: np.ndarray, new: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Return the matrix from the (theta, phi) basis of an old direction, carried along the arc, to that of a new one.

    The smallest rotation from unit vector k to k' takes v, across k, to v - (v . k') / (1 + k . k') (k + k'). A basis
    that is carried so does not swing about the zenith as azimuths do.

    Source: Rodrigues' rotation formula about the axis k x k'.
    """
    before = np.stack(spherical_basis(theta, phi), axis=1)
    along = dot(before, new[:, None]) / (1.0 + dot(old, new))[:, None]
    carried = before - along[..., None] * (old + new)[:, None]
    return dot(basis[:, :, None], carried[:, None])
