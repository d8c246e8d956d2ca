"""Fill a closed hull of a crown with leaf cards: small quads, which light passes between as between leaves.

A crown is a turbid medium: leaf area spread evenly over a volume, its normals in every direction alike. A ray that runs
a length s inside meets no leaf with the probability exp(-G u s), u being the leaf area in a cubic meter and G = 1/2 the
area that a unit of leaf area shows on average in any direction. A card stands for a twig with its leaves.

Source: Beer-Lambert law of canopies and the spherical distribution of leaf angles, J. Ross, "The Radiation Regime and
Architecture of Plant Stands", 1981, and G. Campbell and J. Norman, "An Introduction to Environmental Biophysics", 1998,
chapter 15.
"""

from dataclasses import dataclass

import numpy as np

from mmw.core.random_keys import random_key
from mmw.core.random_series import philox

LEAF_AREA_INDEX = 4.5
"""Area of the leaves of one side over the ground below the crown [-]: the mean of plant canopies. Source: G. Asner,
J. Scurlock and J. Hicke, "Global synthesis of leaf area index observations", Global Ecology and Biogeography 12, 2003:
4.5 with a standard deviation of 2.5, outliers left out."""

PROJECTION = 0.5
"""G: mean projection of a unit of leaf area whose normals are distributed as those of a sphere [-]."""

CARD_AREA_M2 = 0.075
"""Area of a card [m2], a twig with its leaves: about 300 cards in a street tree. Design value: with 200 they look like
scraps of paper from 10 m away."""

SLENDER = 0.35
"""Largest length of a mean card over the smallest side of the box about the hull [-]: hedges have smaller cards than
trees. Design value."""

CARDS = (40, 700)
"""Fewest and most cards of a closed hull; beyond, their area changes instead. Design values."""

SIZES = (0.75, 1.25)
"""Smallest and largest length of a card over the mean one [-]; design values."""

WIDTH = 0.75
"""Width of a card over its length [-]: a kite, pointed at its ends as a twig is. Design value."""

WIDEST = -0.1
"""Place of a card's largest width, from its middle toward its tip, over its length [-]; design value."""

SOFTNESS = 0.85
"""Share of the crown's rounded shape in the normals that cards are shaded with; the rest is their own direction [-].
Design value: a crown has a light and a dark side, and its cards differ."""

REACH = 0.25
"""How far middles of cards stay from the hull, over the length of a card [-]. Design value: tips reach the hull."""

CANDIDATES = 4
"""Places that are drawn at a time for each card in a hull that hides parts of itself from its middle."""


@dataclass(frozen=True)
class LeafCards:
    """Leaf cards of one hull, K of them, two triangles each."""

    points: np.ndarray
    """Vertices [m], shape [4 K, 3], float64: foot, side, tip and other side of each card."""
    faces: np.ndarray
    """Triangles, shape [2 K, 3], int32; their normals look outward rather than inward."""
    normals: np.ndarray
    """Unit normals at the corners to shade with, shape [2 K, 3, 3], float32."""
    uv: np.ndarray
    """Texture coordinates at the corners [m], shape [2 K, 3, 2], float32: lengths on the card from a random origin."""
    hull_face: np.ndarray
    """Face of the hull that each triangle lies below, shape [2 K], int64."""


@dataclass(frozen=True)
class _Hull:
    """Closed hull as tetrahedra that its faces form with its middle; those of faces that look inward are negative."""

    middle: np.ndarray
    corner: np.ndarray
    """Corners of the faces from the middle [m], shape [F, 3, 3]."""
    volume: np.ndarray
    """Signed volume of each tetrahedron [m3], shape [F]."""
    edge_plane: np.ndarray
    """Normals, inward, of the three sides of the cone below each face, shape [3, F, 3]."""
    normal: np.ndarray
    """Normal of each face, such that its product with a point of the face is 1 [1/m], shape [F, 3]."""

    def depths(self, points: np.ndarray) -> np.ndarray:
        """Return how deep points lie in the tetrahedra: 0 in the middle, 1 on the face, inf beside. Shape [P, F].

        Args:
            points: From the middle [m], shape [P, 3].
        """
        depth = _products(points, self.normal)
        is_beside = depth <= 0.0
        for plane in self.edge_plane:
            is_beside |= _products(points, plane) < 0.0
        depth[is_beside] = np.inf
        return depth


def leaf_area_density(points: np.ndarray, faces: np.ndarray, leaf_area_index: float = LEAF_AREA_INDEX) -> float:
    """Return the leaf area in a cubic meter of a closed hull [m2/m3].

    Args:
        points: Vertices [m], shape [N, 3].
        faces: Triangles, counter-clockwise from outside, shape [M, 3].
        leaf_area_index: Leaf area over the ground area below the hull [-].
    """
    hull = _hull(points, faces)
    return leaf_area_index * _ground_area(hull) / float(hull.volume.sum())


def leaf_cards(
    points: np.ndarray,
    faces: np.ndarray,
    *,
    seed: int | str,
    leaf_area_index: float = LEAF_AREA_INDEX,
    count: int | None = None,
) -> LeafCards:
    """Return the leaf cards of a closed hull.

    Their middles are spread evenly over the hull, as far from its surface as lets them reach it; what would stand out
    is drawn in to the surface. Their normals have the spherical distribution.

    Args:
        points: Vertices of the hull [m], shape [N, 3].
        faces: Triangles, counter-clockwise from outside, which close a volume, shape [M, 3].
        seed: Names the crown; the same one gives the same cards.
        leaf_area_index: Area of all cards over the ground area below the hull [-].
        count: Number of cards; None for one that goes with the leaf area, see `CARD_AREA_M2`, `SLENDER` and `CARDS`.
    """
    hull = _hull(points, faces)
    leaf_area = leaf_area_index * _ground_area(hull)
    extent = np.ptp(hull.corner.reshape(-1, 3), axis=0)
    if count is None:
        area = min(CARD_AREA_M2, 0.5 * WIDTH * (SLENDER * float(extent.min())) ** 2)
        count = int(np.clip(round(leaf_area / area), *CARDS))
    key = random_key("leaf cards", seed)
    drawn = _uniform(key, 0, count, 8)
    low, high = SIZES
    share = low + (high - low) * drawn[:, 0]
    length = share * np.sqrt(leaf_area / (0.5 * WIDTH * (share**2).sum()))
    middle, face = _places(hull, key, count)
    middle *= np.maximum(1.0 - 2.0 * REACH * float(length.mean()) / extent, 0.5)
    # Normal evenly over the sphere, and a direction in the plane of the card.
    up, turn, spin = 2.0 * drawn[:, 1] - 1.0, 2.0 * np.pi * drawn[:, 2], 2.0 * np.pi * drawn[:, 3]
    flat = np.sqrt(1.0 - up**2)
    normal = np.stack([flat * np.cos(turn), flat * np.sin(turn), up], axis=1)
    aside = np.stack([-np.sin(turn), np.cos(turn), np.zeros(count)], axis=1)
    other = np.cross(normal, aside)
    along = np.cos(spin)[:, None] * aside + np.sin(spin)[:, None] * other
    is_inward = np.einsum("kx,kx->k", normal, middle / extent**2) < 0.0
    normal[is_inward] *= -1.0
    across = np.cross(normal, along)
    shape = np.array([(-0.5, 0.0), (WIDEST, -0.5 * WIDTH), (0.5, 0.0), (WIDEST, 0.5 * WIDTH)])
    place = length[:, None, None] * shape
    vertex = middle[:, None] + place[..., :1] * along[:, None] + place[..., 1:] * across[:, None]
    vertex = _drawn_in(hull, vertex.reshape(-1, 3)).reshape(vertex.shape)
    round_normal = vertex / extent**2
    round_normal /= np.maximum(np.linalg.norm(round_normal, axis=2, keepdims=True), 1e-12)
    shading = SOFTNESS * round_normal + (1.0 - SOFTNESS) * normal[:, None]
    shading /= np.maximum(np.linalg.norm(shading, axis=2, keepdims=True), 1e-12)
    uv = place + 16.0 * drawn[:, None, 4:6]
    pick = np.array([(0, 1, 2), (0, 2, 3)])
    index = (4 * np.arange(count)[:, None, None] + pick).reshape(-1, 3)
    return LeafCards(
        points=vertex.reshape(-1, 3) + hull.middle,
        faces=index.astype(np.int32),
        normals=shading.reshape(-1, 3)[index].astype(np.float32),
        uv=uv.reshape(-1, 2)[index].astype(np.float32),
        hull_face=np.repeat(face, 2),
    )


def _hull(points: np.ndarray, faces: np.ndarray) -> _Hull:
    corner = np.asarray(points, dtype=np.float64)[faces]
    start = corner.reshape(-1, 3).mean(axis=0)
    volume = _volumes(corner - start)
    middle = start + (volume[:, None] * (corner - start).sum(axis=1)).sum(axis=0) / (4.0 * volume.sum())
    corner = corner - middle
    volume = _volumes(corner)
    side = np.sign(volume)[:, None]
    plane = np.stack([side * np.cross(corner[:, k], corner[:, (k + 1) % 3]) for k in range(3)])
    cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    # A face in a plane with the middle has no tetrahedron: a normal of 0 keeps it out.
    normal = np.where(side != 0.0, cross / np.where(side != 0.0, 6.0 * volume[:, None], 1.0), 0.0)
    return _Hull(middle, corner, volume, plane, normal)


def _products(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the scalar products of vectors [P, 3] and [F, 3], shape [P, F].

    Not by BLAS, whose last bits depend on the machine, and whose threads wait for each other on busy cores.
    """
    total = one[:, :1] * other[:, 0]
    for axis in (1, 2):
        total += one[:, axis, None] * other[:, axis]
    return total


def _volumes(corner: np.ndarray) -> np.ndarray:
    return np.einsum("fx,fx->f", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])) / 6.0


def _ground_area(hull: _Hull) -> float:
    """Return the area of the ground below a hull [m2]; what is folded over counts each time."""
    corner = hull.corner
    return float(0.25 * np.abs(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])[:, 2]).sum())


def _uniform(key: tuple[int, int], block: int, count: int, width: int) -> np.ndarray:
    """Return numbers that are evenly distributed between 0 and 1, shape [count, width]."""
    words = -(-width // 4)
    counter = np.zeros((count, words, 4), dtype=np.uint64)
    counter[..., 0], counter[..., 1] = np.arange(count)[:, None], np.arange(words)
    counter[..., 2] = block
    drawn = philox(np.array(key), counter).reshape(count, 4 * words)[:, :width]
    return (drawn + 0.5) * 2.0**-32


def _places(hull: _Hull, key: tuple[int, int], count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return places evenly over a hull, from its middle [m], and the face above each.

    A place is drawn in one of the tetrahedra, after their volumes. Where these overlap, in a hull that hides parts of
    itself from its middle, a place counts once, and only inside.
    """
    size = np.abs(hull.volume)
    up_to = np.cumsum(size) / size.sum()
    is_star = bool((hull.volume >= 0.0).all())
    place, above = [np.zeros((0, 3))], [np.zeros(0, dtype=np.int64)]
    block = 1
    while sum(map(len, place)) < count:
        drawn = _uniform(key, block, count if is_star else CANDIDATES * count, 8)
        face = np.minimum(np.searchsorted(up_to, drawn[:, 0], side="right"), len(size) - 1)
        depth = drawn[:, 1] ** (1.0 / 3.0)
        root, second = np.sqrt(drawn[:, 2]), drawn[:, 3]
        weight = np.stack([1.0 - root, root * (1.0 - second), root * second], axis=1)
        points = depth[:, None] * np.einsum("kc,kcx->kx", weight, hull.corner[face])
        if not is_star:
            is_below = hull.depths(points) <= 1.0
            winding, ways = (is_below * np.sign(hull.volume)).sum(axis=1), is_below.sum(axis=1)
            keep = (winding > 0.5) & (drawn[:, 4] * ways < 1.0)
            points, face = points[keep], face[keep]
        place.append(points)
        above.append(face)
        block += 1
    return np.concatenate(place)[:count], np.concatenate(above)[:count]


def _drawn_in(hull: _Hull, points: np.ndarray) -> np.ndarray:
    """Return points of which those that are beyond the outermost face above them lie on it; from the middle [m]."""
    depth = hull.depths(points).min(axis=1)
    is_beyond = (depth > 1.0) & np.isfinite(depth)
    return np.where(is_beyond[:, None], points / np.where(is_beyond, depth, 1.0)[:, None], points)
