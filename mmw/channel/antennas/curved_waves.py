"""Follow the lengths of paths that a curved surface reflects, over the elements of arrays at both ends.

Near the point of reflection the surface is q(u) = E u - n u^T K u / 2 over its tangent plane, with the stored curvature
K; the length |q - t| + |q - r| is the least over u (Fermat). For elements of one end it is found by Newton's method;
what both ends add together is -g_t^T H^-1 g_r to second order, with H the second derivatives by u, and g those by u and
by the offsets of elements.
"""

from dataclasses import dataclass

import numpy as np

from mmw.core.transforms import cross
from mmw.physics.em.vectors import dot, norm

STEPS = 5
"""Steps of Newton's method: elements are a small part of the distance away, so that it doubles the digits of the first.
Design value."""


@dataclass(frozen=True)
class CurvedEnd:
    """Reflections at curved surfaces, seen from one end: P paths."""

    source: np.ndarray
    """Distance of the point of reflection [m], shape [P]."""
    other: np.ndarray
    """Distance of the other end from it [m], shape [P]."""
    direction: np.ndarray
    """Unit direction to it from this end, shape [P, 3]."""
    other_direction: np.ndarray
    """The same from the other end, shape [P, 3]."""
    curvature: np.ndarray
    """Curvature of the surface, a symmetric matrix over its tangent plane, positive where it bends away [1/m], shape
    [P, 3, 3]."""

    def frame(self) -> tuple[np.ndarray, np.ndarray]:
        """Return two unit vectors along the surface, shape [P, 2, 3], and its normal toward both ends, [P, 3]."""
        normal = -(self.direction + self.other_direction)
        normal /= norm(normal)[:, None]
        least = np.eye(3)[np.abs(normal).argmin(axis=1)]
        one = cross(normal, least)
        one /= norm(one)[:, None]
        return np.stack([one, cross(normal, one)], axis=1), normal

    def hessian(self) -> np.ndarray:
        """Return the second derivatives of the length along the surface at the point [1/m], shape [P, 2, 2]."""
        along, normal = self.frame()
        bend = np.einsum("pix,pxy,pjy->pij", along, self.curvature, along)
        out = -2.0 * dot(normal, self.direction)[:, None, None] * bend
        for distance, direction in ((self.source, self.direction), (self.other, self.other_direction)):
            slope = np.einsum("pix,px->pi", along, direction)
            out += (np.eye(2) - slope[:, :, None] * slope[:, None, :]) / distance[:, None, None]
        return out

    def shifts(self, offset: np.ndarray) -> np.ndarray:
        """Return the derivatives of the length by places on the surface for offsets of elements, [P, N, 2].

        Args:
            offset: Offsets from the phase center [m], world frame, shape [P, N, 3].
        """
        along, _ = self.frame()
        across = offset - dot(offset, self.direction[:, None])[..., None] * self.direction[:, None]
        return -np.einsum("pix,pnx->pni", along, across) / self.source[:, None, None]

    def longer(self, offset: np.ndarray) -> np.ndarray:
        """Return the length from elements over the surface to the phase center of the other end, less that between the
        phase centers [m], shape [P, N]."""
        along, normal = self.frame()
        bend = np.einsum("pix,pxy,pjy->pij", along, self.curvature, along)
        ends = (offset - (self.source[:, None] * self.direction)[:, None],
                -(self.other[:, None] * self.other_direction)[:, None])  # fmt: skip
        place = np.linalg.solve(self.hessian()[:, None], -self.shifts(offset)[..., None])[..., 0]
        total = np.zeros(offset.shape[:2])
        for step in range(STEPS + 1):
            bent = np.einsum("pij,pnj->pni", bend, place)
            point = np.einsum("pni,pix->pnx", place, along)
            point = point - 0.5 * (bent * place).sum(axis=2)[..., None] * normal[:, None]
            tangent = along[:, None] - bent[..., None] * normal[:, None, None]
            total[:] = -(self.source + self.other)[:, None]
            slope, second = np.zeros(place.shape), np.zeros((*place.shape, 2))
            for end in ends:
                away = point - end
                distance = norm(away)
                unit = away / distance[..., None]
                total += distance
                part = np.einsum("pnix,pnx->pni", tangent, unit)
                slope += part
                square = np.einsum("pnix,pnjx->pnij", tangent, tangent) - part[..., None] * part[..., None, :]
                second += square / distance[..., None, None]
                second -= dot(unit, normal[:, None])[..., None, None] * bend[:, None]
            if step < STEPS:
                place = place - np.linalg.solve(second, slope[..., None])[..., 0]
        return total


def symmetric(six: np.ndarray) -> np.ndarray:
    """Return symmetric matrices of xx, xy, xz, yy, yz, zz, shape [P, 6] -> [P, 3, 3]."""
    return six[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
