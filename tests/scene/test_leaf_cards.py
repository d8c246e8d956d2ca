"""Leaf cards of crowns: gaps against Beer-Lambert's law, angles, area, and cards inside their hull."""

from collections.abc import Callable

import numpy as np
import pytest

from mmw.core.bvh import RayMesh
from mmw.core.mesh import TriangleMesh
from mmw.scene import leaf_cards as module
from mmw.scene.leaf_cards import LEAF_AREA_INDEX, REACH, LeafCards, leaf_area_density, leaf_cards
from mmw.worlds.towns.trees import broadleaf_tree, crown, oak, sphere

RADIUS = 1.5


def ball(frequency: int = 8) -> TriangleMesh:
    unit = sphere(frequency)
    return TriangleMesh(RADIUS * unit.points, unit.faces)


def card_mesh(cards: LeafCards) -> TriangleMesh:
    return TriangleMesh(cards.points, cards.faces)


def winding(points: np.ndarray, hull: TriangleMesh) -> np.ndarray:
    """Return how often a hull winds around each point, shape [P].

    Source: solid angles of triangles, A. Van Oosterom and J. Strackee, IEEE Trans. Biomed. Eng. 30(2), 1983.
    """
    a, b, c = np.moveaxis(hull.corners[None] - points[:, None, None], 2, 0)
    la, lb, lc = (np.linalg.norm(v, axis=-1) for v in (a, b, c))

    def dot(u: np.ndarray, v: np.ndarray) -> np.ndarray:
        return np.einsum("pfx,pfx->pf", u, v)

    below = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb
    return 2.0 * np.arctan2(dot(a, np.cross(b, c)), below).sum(axis=1) / (4.0 * np.pi)


def disc_rays(direction: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return origins of parallel rays over the disc of the ball, shape [count, 3], and their distances from its axis,
    shape [count]."""
    turn = np.arange(count) * np.pi * (3.0 - np.sqrt(5.0))
    away = RADIUS * np.sqrt((np.arange(count) + 0.5) / count)
    side = np.cross(direction, [0.3, -0.5, 0.8])
    side /= np.linalg.norm(side)
    place = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * np.cross(direction, side)
    return away[:, None] * place - 5.0 * direction, away


def chord(radius: float, away: np.ndarray) -> np.ndarray:
    return 2.0 * np.sqrt(np.maximum(radius**2 - away**2, 0.0))


def expected_gap(away: np.ndarray, leaf_area: float, card_length: float) -> np.ndarray:
    """Return the probability of no leaf on a ray past the axis of the ball: exp(-G u s)."""
    outer = RADIUS - REACH * card_length
    return np.exp(-0.5 * leaf_area / (4.0 / 3.0 * np.pi * outer**3) * chord(outer, away))


@pytest.mark.parametrize("direction", [(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.48, -0.64)])
def test_gap_fraction_of_many_small_cards_is_beer_lambert(direction: tuple[float, ...]) -> None:
    hull, axis = ball(), np.array(direction)
    cards = leaf_cards(hull.points, hull.faces, seed="gap", leaf_area_index=3.0, count=12_000)
    mesh = card_mesh(cards)
    origin, away = disc_rays(axis, 20_000)
    distance, _ = RayMesh(mesh.points, mesh.faces).cast(origin, axis, 10.0)
    is_gap = ~np.isfinite(distance)
    expected = expected_gap(away, mesh.areas.sum(), np.sqrt(mesh.areas.sum() / 12_000 / (0.5 * module.WIDTH)))
    inner = away < 0.9 * RADIUS  # at the rim the facets of the hull count
    # 12,000 cards of 0.04 m: rays closer than a card share their gaps, about 3,000 are independent: 0.9 % a sigma.
    assert is_gap[inner].mean() == pytest.approx(expected[inner].mean(), abs=0.02)
    for low, high in ((0.0, 0.5), (0.5, 0.75), (0.75, 0.9)):
        ring = (away >= low * RADIUS) & (away < high * RADIUS)
        assert is_gap[ring].mean() == pytest.approx(expected[ring].mean(), abs=0.05)


def test_gap_fraction_of_a_crown_as_it_is_made_is_beer_lambert_on_average() -> None:
    hull = ball()
    found, expected = [], []
    for seed in range(12):
        mesh = card_mesh(leaf_cards(hull.points, hull.faces, seed=seed))
        axis = np.array([np.cos(seed), np.sin(seed), 0.0])
        origin, away = disc_rays(axis, 1500)
        distance, _ = RayMesh(mesh.points, mesh.faces).cast(origin, axis, 10.0)
        found.append((~np.isfinite(distance)).mean())
        length = np.sqrt(mesh.areas.sum() / (len(mesh.faces) // 2) / (0.5 * module.WIDTH))
        expected.append(expected_gap(away, mesh.areas.sum(), length).mean())
    assert 0.1 < np.mean(expected) < 0.4
    # Cards of 0.45 m blur the edges of the crown and of its middle, which the law leaves sharp.
    assert np.mean(found) == pytest.approx(np.mean(expected), rel=0.15)


def test_normals_have_the_spherical_distribution() -> None:
    hull = ball(3)
    normal = card_mesh(leaf_cards(hull.points, hull.faces, seed=1, count=20_000)).normals[::2]
    for direction in np.eye(3):
        share = np.abs(normal @ direction)  # evenly from 0 to 1: each zone of a sphere has the area of its height
        assert share.mean() == pytest.approx(0.5, abs=0.01)
        assert np.quantile(share, [0.25, 0.75]) == pytest.approx([0.25, 0.75], abs=0.02)


def test_cards_have_the_leaf_area_of_the_ground_below_them() -> None:
    hull = ball()
    cards = card_mesh(leaf_cards(hull.points, hull.faces, seed=1))
    ground = 0.5 * np.abs(hull.crosses[:, 2]).sum() / 2.0
    assert ground == pytest.approx(np.pi * RADIUS**2, rel=0.02)
    assert cards.areas.sum() == pytest.approx(LEAF_AREA_INDEX * ground, rel=0.04)  # what stands out is drawn in
    assert leaf_area_density(hull.points, hull.faces) == pytest.approx(LEAF_AREA_INDEX * 0.75 / RADIUS, rel=0.01)


TREES: dict[str, Callable[[np.random.Generator], list]] = {"street tree": broadleaf_tree, "oak": oak}


@pytest.mark.parametrize("kind", TREES)
def test_cards_of_a_tree_lie_inside_its_hull(kind: str) -> None:
    hull = TREES[kind](np.random.default_rng(5))[1][1]
    cards = leaf_cards(hull.points, hull.faces, seed=kind)
    middle = hull.corners.mean(axis=(0, 1))
    inward = middle + (cards.points - middle) * (1.0 - 1e-6)  # vertices that were drawn in lie on the hull itself
    assert winding(inward, hull).min() > 0.99


def test_count_goes_with_the_leaf_area() -> None:
    hull = ball()
    assert len(leaf_cards(hull.points, hull.faces, seed=1).faces) == 2 * round(
        LEAF_AREA_INDEX * 0.25 * np.abs(hull.crosses[:, 2]).sum() / module.CARD_AREA_M2
    )
    fewest, most = module.CARDS
    assert len(leaf_cards(hull.points, hull.faces, seed=1, leaf_area_index=0.1).faces) == 2 * fewest
    assert len(leaf_cards(9.0 * hull.points, hull.faces, seed=1).faces) == 2 * most


def test_cards_of_a_hedge_are_small() -> None:
    hull = TriangleMesh(ball().points * [2.0, 0.25, 0.5], ball().faces)
    area = card_mesh(leaf_cards(hull.points, hull.faces, seed=1)).areas[::2] * 2.0
    length = np.sqrt(area / (0.5 * module.WIDTH))
    assert length.mean() < module.SLENDER * 0.5 * RADIUS * 1.05


def test_same_seed_makes_the_same_cards() -> None:
    hull = ball(2)
    one, same, other = (leaf_cards(hull.points, hull.faces, seed=seed) for seed in ("a", "a", "b"))
    for name, value in vars(one).items():
        np.testing.assert_array_equal(value, getattr(same, name))
    assert not np.array_equal(one.points, other.points)


def test_places_are_even_in_a_hull_that_hides_parts_of_itself() -> None:
    """An L of three cubes: its middle lies beside the inner edge, and faces look inward from there."""
    cell = np.array([(0, 0, 0), (3, 0, 0), (3, 1, 0), (1, 1, 0), (1, 3, 0), (0, 3, 0)], dtype=np.float64)
    points = np.concatenate([cell, cell + np.array([0, 0, 1])])
    walls = [(k, (k + 1) % 6, (k + 1) % 6 + 6, k + 6) for k in range(6)]
    quads = [*walls, (6, 7, 8, 9), (6, 9, 10, 11), (3, 2, 1, 0), (5, 4, 3, 0)]
    hull = TriangleMesh(points, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], dtype=np.int32))
    assert winding(np.array([[0.5, 0.5, 0.5], [2.0, 2.0, 0.5]]), hull) == pytest.approx([1.0, 0.0], abs=1e-9)
    cards = leaf_cards(hull.points, hull.faces, seed="L", leaf_area_index=0.01, count=20_000)
    middle = cards.points.reshape(-1, 4, 3).mean(axis=1)
    assert winding(middle[::20], hull).min() > 0.5
    for axis in (0, 1):  # the end of each arm is a fifth of the volume: 4,000 cards, one sigma is 57
        assert (middle[:, axis] > 2.0).mean() == pytest.approx(0.2, abs=0.012)
    assert ((middle[:, :2] < 1.0).all(axis=1)).mean() == pytest.approx(0.2, abs=0.012)


def test_shading_normals_are_rounder_than_the_cards() -> None:
    hull = crown(np.random.default_rng(1), 1.5, 2.0, 7.0, 10, 3)
    cards = leaf_cards(hull.points, hull.faces, seed=1)
    mesh = card_mesh(cards)
    assert np.linalg.norm(cards.normals, axis=2) == pytest.approx(1.0, abs=1e-6)
    outward = mesh.corners.mean(axis=1) - hull.points.mean(axis=0)
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)

    def agreement(normals: np.ndarray) -> float:
        return float(np.einsum("fx,fx->f", normals, outward).mean())

    assert agreement(cards.normals.mean(axis=1)) > agreement(mesh.normals) + 0.1
    assert (np.einsum("fcx,fx->f", cards.normals, mesh.normals) > 0.0).all()  # on the side of the winding
