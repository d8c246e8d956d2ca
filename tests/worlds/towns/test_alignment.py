"""Pieces of a road before it is a network: arcs, elevation, section, and strips of triangles."""

import numpy as np
import pytest

from mmw.worlds.towns.alignment import make_alignment, make_elevation
from mmw.worlds.towns.description import Profile
from mmw.worlds.towns.plan_geometry import twice_areas
from mmw.worlds.towns.section import make_section
from mmw.worlds.towns.strip_mesh import zipper


def test_alignment_is_an_arc_of_its_radius() -> None:
    line = make_alignment(np.array([[0.0, 0], [50, 0], [50, 60]]), np.array([20.0]), "r")
    assert line.length == pytest.approx(30 + 10 * np.pi + 40)
    s = np.linspace(0, line.length, 4001)
    xy, heading, _ = line.at(s)
    np.testing.assert_allclose(xy[[0, -1]], [[0, 0], [50, 60]], atol=1e-12)
    bend = (s > 30) & (s < 30 + 10 * np.pi)
    np.testing.assert_allclose(np.hypot(xy[bend, 0] - 30, xy[bend, 1] - 20), 20, rtol=1e-12)
    step = np.diff(xy, axis=0)
    middle = 0.5 * (heading[1:] + heading[:-1])
    np.testing.assert_allclose(np.arctan2(step[:, 1], step[:, 0]), middle, atol=3e-4)  # tangent everywhere, no kink
    np.testing.assert_allclose(np.linalg.norm(step, axis=1), s[1], rtol=1e-6)  # the station is the arc length


@pytest.mark.parametrize(
    ("points", "radii", "message"),
    [
        ([[0, 0], [10, 0], [10, 10]], [20], "too short for the arcs"),
        ([[0, 0], [0, 0]], [], "points coincide"),
        ([[0, 0], [10, 0], [0, 0.1]], [1], "split it"),
    ],
)
def test_alignment_refuses(points: list[list[float]], radii: list[float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make_alignment(np.array(points, dtype=float), np.array(radii, dtype=float), "r")


def test_elevation_is_flat_at_the_ends_and_smooth_between() -> None:
    profile = make_elevation(100, (8, 0), (15, 20), ((50, 6),), 12, "r")
    s = np.linspace(0, 100, 100_001)
    z = profile.at(s)
    assert np.all(z[s <= 15] == 8)
    assert np.all(np.abs(z[s >= 80]) < 1e-12)
    grade = np.diff(z) / np.diff(s)
    assert np.max(np.abs(grade)) <= profile.steepest + 1e-9
    assert np.max(np.abs(np.diff(grade))) / s[1] == pytest.approx(profile.steepest / 12, rel=0.35)  # bounded curvature
    assert profile.at(np.array([50.0]))[0] != 6.0  # the corner is rounded
    assert np.all(profile.is_curved(np.array([22.0, 52, 70])))
    assert not np.any(profile.is_curved(np.array([5.0, 35, 95])))


def test_section_is_symmetric_and_as_wide_as_its_lanes() -> None:
    section = make_section("p", Profile(lanes=2, width=3.5, shoulder=0.5, centre=3.5))
    assert section.half == pytest.approx(1.75 + 7 + 0.5)
    np.testing.assert_allclose(section.breaks, -section.breaks[::-1], atol=1e-12)
    assert np.all(np.diff(section.breaks) > 0)
    assert section.forward == pytest.approx((-3.5, -7.0))
    assert section.backward == pytest.approx((3.5, 7.0))
    assert len(section.paint) == len(section.breaks) - 1


def test_zipper_fills_the_strip_with_every_vertex() -> None:
    rng = np.random.default_rng(0)
    t0 = np.concatenate([[-4], np.sort(rng.uniform(-4, 4, 6)), [4]])
    t1 = np.concatenate([[-4], np.sort(rng.uniform(-4, 4, 3)), [4]])
    points = np.concatenate([np.stack([np.zeros(8), t0], axis=1), np.stack([np.full(5, 2.0), t1], axis=1)])
    faces = zipper(np.arange(8), t0, np.arange(8, 13), t1)
    area = 0.5 * twice_areas(points[faces])
    assert np.all(area > 0)
    assert area.sum() == pytest.approx(16)
    assert sorted(set(faces.ravel())) == list(range(13))
