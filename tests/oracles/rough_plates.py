"""Integrate Lambertian scattering over rectangular plates in float64, over one of them and over two."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Plate:
    """Rectangle, seen on the side of edge_u x edge_v."""

    corner: np.ndarray
    edge_u: np.ndarray
    edge_v: np.ndarray

    @property
    def normal(self) -> np.ndarray:
        across = np.cross(self.edge_u, self.edge_v)
        return across / np.linalg.norm(across)

    @property
    def corners(self) -> list[np.ndarray]:
        """Corners, counter-clockwise on the side that scatters."""
        return [self.corner, self.corner + self.edge_u, self.corner + self.edge_u + self.edge_v,
                self.corner + self.edge_v]  # fmt: skip

    def mirrored(self, point: np.ndarray) -> np.ndarray:
        """Return the image of a point behind the plane of the plate."""
        return point - 2 * ((point - self.corner) @ self.normal) * self.normal

    def nodes(self, ends: list[np.ndarray], points: int = 8) -> tuple[np.ndarray, np.ndarray]:
        """Return points [N, 3] and areas [N] of Gauss's rule on panels that grow with the distance from the ends."""
        lines = []
        for edge in (self.edge_u, self.edge_v):
            length = np.linalg.norm(edge)
            cuts = {0.0, 1.0}
            for end in ends:
                foot = (end - self.corner) @ edge / length**2
                height = abs((end - self.corner) @ self.normal) / length
                steps = height * np.array([0.25, 0.5, 1, 2, 4, 8, 16, 32, 64])
                cuts |= {float(c) for c in (foot, *(foot + steps), *(foot - steps)) if 0.0 < c < 1.0}
            cut = np.array(sorted(cuts))
            node, weight = np.polynomial.legendre.leggauss(points)
            middle, half = (cut[1:] + cut[:-1]) / 2, np.diff(cut) / 2
            lines.append(((middle[:, None] + half[:, None] * node).ravel(), (half[:, None] * weight).ravel()))
        (u, weight_u), (v, weight_v) = lines
        place = self.corner + u[:, None, None] * self.edge_u + v[None, :, None] * self.edge_v
        area = np.outer(weight_u, weight_v) * np.linalg.norm(np.cross(self.edge_u, self.edge_v))
        return place.reshape(-1, 3), area.ravel()


def one_patch(plate: Plate, tx: np.ndarray, rx: np.ndarray) -> float:
    """Return the integral of cos(theta_i) cos(theta_s) / (pi r_1^2 r_2^2) over a plate [1/m^2].

    Times (lambda / 4 pi)^2 S^2 Gamma^2 it is the power that the plate scatters.

    Source: V. Degli-Esposti et al., IEEE Trans. AP 55(1), 2007, equations 2 to 5.
    """
    place, area = plate.nodes([tx, rx])
    return float(np.sum(area * _flux(place, plate.normal, tx) * _flux(place, plate.normal, rx)) / np.pi)


def two_patches(first: Plate, second: Plate, tx: np.ndarray, rx: np.ndarray) -> float:
    """Return the integral of one_patch's density over a plate and another that scatters what comes from it [1/m^2].

    It has the factor cos cos / (pi r^2) between the plates. Times (lambda / 4 pi)^2 S_1^2 S_2^2 Gamma_1^2 Gamma_2^2 it
    is the power.
    """
    (one, area), (other, other_area) = first.nodes([tx], 6), second.nodes([rx], 6)
    arriving = area * _flux(one, first.normal, tx) / np.pi
    total = 0.0
    for place, weight in zip(other, other_area * _flux(other, second.normal, rx) / np.pi, strict=True):
        way = place - one
        distance = np.linalg.norm(way, axis=1)
        out, into = np.maximum(way @ first.normal, 0.0), np.maximum(-way @ second.normal, 0.0)
        total += weight * np.sum(arriving * out * into / distance**4)
    return float(total)


def _flux(place: np.ndarray, normal: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return cos / r^2 from an end to points of a plate, 0 from behind it."""
    way = end - place
    return np.maximum(way @ normal, 0.0) / np.linalg.norm(way, axis=1) ** 3
