"""Reflections at posts, spheres and panels that meshes show as facets, against series and divergence in float64."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from scipy.special import fresnel, hankel2, jv

from mmw.channel.antennas.curved_waves import symmetric
from mmw.channel.path_solver.curved_candidates import separate_points
from mmw.channel.path_solver.curved_surfaces import CurvedPart, CurvedTable, find_curved
from mmw.channel.path_solver.traced_paths import TracedPaths
from mmw.channel.paths import PathSet
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.planar_surfaces import find_surfaces
from mmw.physics.em.interaction import SPECULAR
from mmw.physics.materials.material import RadioMaterial
from mmw.scene.mesh_edges import find_edges
from mmw.worlds.towns.mesh_part import MeshPart
from tests.fixtures.scenes import arrays_from_parts, box_part, pose, quad_part, tube
from tests.oracles import channel as oracle

CARRIERS = (4.9e9, 28e9)
MATERIALS = oracle.radio_materials({"metal": RadioMaterial("itu", itu="itu_pec")})


def sphere(radius: float, rows: int, height: float) -> MeshPart:
    """Return a ball of rows x 2 rows facets around the z axis, that looks outward."""
    theta, phi = np.linspace(0, np.pi, rows + 1)[1:-1], np.arange(2 * rows) * np.pi / rows
    grid = np.stack([np.outer(np.sin(theta), f(phi)) for f in (np.cos, np.sin)], axis=-1).reshape(-1, 2)
    level = np.repeat(np.cos(theta), 2 * rows)
    points = radius * np.concatenate([[[0, 0, 1.0]], np.column_stack([grid, level]), [[0, 0, -1.0]]])
    at = 1 + np.arange((rows - 1) * 2 * rows).reshape(rows - 1, 2 * rows)
    a, b, c, d = at[:-1], at[1:], np.roll(at[1:], -1, axis=1), np.roll(at[:-1], -1, axis=1)
    last = len(points) - 1
    parts = [
        (a, b, c),
        (a, c, d),
        (0 * at[0], at[0], np.roll(at[0], -1)),
        (last + 0 * at[0], np.roll(at[-1], -1), at[-1]),
    ]
    faces = np.concatenate([np.stack([x.ravel() for x in part], axis=1) for part in parts])
    return MeshPart("Props/ball", points + np.array([0.0, 0.0, height]), faces.astype(np.int32), "metal", "static")


def curved(points: np.ndarray, faces: np.ndarray) -> CurvedPart:
    """Return the curved surfaces of a mesh of one object."""
    zero = np.zeros(len(faces), dtype=np.int64)
    return find_curved(find_edges(points, faces), find_surfaces(points, faces, zero, zero), zero, zero)


def solve(parts: list[MeshPart], tx: tuple, rx: list[tuple], device: str, **options: object) -> PathSet:
    """Return the paths from `tx` to each of `rx` at both carriers, by isotropic antennas at the ends themselves."""
    settings = {"max_depth": 1, "finite_surfaces": True, "pattern": "iso", "carriers_hz": CARRIERS} | options
    return oracle.solve(oracle.link_scene(parts, tx, *rx, materials=MATERIALS), oracle.channel(**settings), device)[1]


def reflected_db(paths: PathSet) -> np.ndarray:
    """Return the levels of the reflections over free space of their lengths [dB], sorted by link, shape [n, C]."""
    own = np.flatnonzero(paths.interaction[:, 0] == SPECULAR)
    free = SPEED_OF_LIGHT / paths.carriers_hz / (4 * np.pi * SPEED_OF_LIGHT * paths.tau[own, None])
    return 20 * np.log10(np.linalg.norm(paths.transfer["sunny"][own], ord=2, axis=(2, 3)) / free)


def series_db(radius: float, tx: tuple, rx: tuple, length: float, carrier: float) -> float:
    """Return the field that a conducting cylinder scatters from a line source over that of the source at `length` [dB].

    Both spread alike along the axis, so that the ratio is that of point sources at one height. Source: C. A. Balanis,
    Advanced Engineering Electromagnetics, 2nd edition, equation 11-168 (line source, TM).
    """
    wave = 2 * np.pi * carrier / SPEED_OF_LIGHT
    order = np.arange(int(wave * radius) + 40)
    turn = np.arctan2(rx[1], rx[0]) - np.arctan2(tx[1], tx[0])
    term = jv(order, wave * radius) / hankel2(order, wave * radius)
    term = term * hankel2(order, wave * np.hypot(*tx[:2])) * hankel2(order, wave * np.hypot(*rx[:2]))
    total = (np.where(order == 0, 1, 2) * term * np.cos(order * turn)).sum()
    return 20 * np.log10(abs(total / hankel2(0, wave * length)))


@pytest.mark.parametrize("distance", [5.0, 30.0, 200.0])
@pytest.mark.parametrize(("radius", "sides"), [(0.11, 6), (0.06, 8), (0.11, 12), (0.3, 16), (0.17, 5)])
def test_a_post_reflects_what_the_series_says(radius: float, sides: int, distance: float, device: str) -> None:
    """Up to an incidence of 50 degrees: 1 dB, of which a hexagon's normals, linear over its sides, take 0.6."""
    tx = (distance, 0.0, 20.0)
    rx = [(0.8 * distance * np.cos(turn), 0.8 * distance * np.sin(turn), 20.0) for turn in (0.3, 0.7, 1.2, 1.7)]
    paths = solve([tube(radius, sides)], tx, rx, device)
    own = paths.interaction[:, 0] == SPECULAR
    assert paths.link[own].tolist() == [0, 1, 2, 3]
    level = reflected_db(paths)
    for k, row in enumerate(np.flatnonzero(own)):
        length = paths.tau[row] * SPEED_OF_LIGHT
        expected = [series_db(radius, tx, rx[k], length, carrier) for carrier in CARRIERS]
        np.testing.assert_allclose(level[k], expected, atol=1.0 if sides > 5 else 1.2)


@pytest.mark.parametrize("incidence", [0.2, 0.6, 1.0])
def test_a_ball_spreads_as_geometrical_optics_says(incidence: float, device: str) -> None:
    """1 / sqrt((1 + 2 rho / (a cos)) (1 + 2 rho cos / a)), within 0.5 dB, and the shortest way over the ball."""
    radius, away = 0.5, 20.0
    up = np.array([np.sin(0.9) * np.cos(0.23), np.sin(0.9) * np.sin(0.23), np.cos(0.9)])
    side = np.cross(up, [0.6, 0.0, 0.8])
    side /= np.linalg.norm(side)
    top = np.array([0.0, 0.0, 30.0]) + radius * up
    tx, rx = (tuple(top + away * (np.cos(incidence) * up + sign * np.sin(incidence) * side)) for sign in (1, -1))
    paths = solve([sphere(radius, 24, 30.0)], tx, [rx], device)
    (row,) = np.flatnonzero(paths.interaction[:, 0] == SPECULAR)
    assert paths.tau[row] * SPEED_OF_LIGHT == pytest.approx(2 * away, abs=2e-3)
    np.testing.assert_allclose(paths.vertex[row, 0], top, atol=5e-3)
    rho, cosine = 0.5 * away, np.cos(incidence)
    expected = -10 * np.log10((1 + 2 * rho / (radius * cosine)) * (1 + 2 * rho * cosine / radius))
    np.testing.assert_allclose(reflected_db(paths)[0], expected, atol=0.5)


def test_paths_have_the_curvature_of_their_surface(device: str) -> None:
    """1/a across the axis of a post, 1/a both ways on a ball, over the plane across the normal; none for flat ones."""
    for part, radius, bends in ((tube(0.3, 24), 0.3, [0, 0, 1]), (sphere(0.5, 24, 10.0), 0.5, [0, 1, 1])):
        parts = [part, box_part("wall", (1.0, 40.0, 40.0), (-20.0, 0.0, 20.0), "metal", "building")]
        paths = solve(parts, (12.0, 2.0, 10.0), [(9.0, 14.0, 11.0)], device)
        is_curved = np.isfinite(paths.curvature).all(axis=1)
        assert is_curved.tolist() == [
            bool(r) for r in (paths.interaction[:, 0] == SPECULAR) & (paths.vertex[:, 0, 0] > -5)
        ]
        (row,) = np.flatnonzero(is_curved)
        matrix = symmetric(paths.curvature)[row]
        np.testing.assert_allclose(np.linalg.eigvalsh(matrix) * radius, bends, atol=0.05)
        np.testing.assert_allclose(matrix @ paths.normal[row, 0], 0.0, atol=0.02 / radius)


def test_a_facet_in_the_plane_of_a_wall_reflects_as_its_post_alone(device: str) -> None:
    radius, sides = 0.2, 8
    middle, half = 0.2 + np.pi / sides, np.pi / sides
    normal = np.array([np.cos(middle), np.sin(middle), 0.0])
    along, up = np.array([-normal[1], normal[0], 0.0]), np.array([0.0, 0.0, 1.0])
    foot = radius * np.cos(half) * normal
    corners = [foot + s * along + z * up for s, z in ((5.0, 0.0), (40.0, 0.0), (40.0, 40.0), (5.0, 40.0))]
    wall = quad_part("Buildings/wall", corners, "metal", "building")
    tx, rx = (tuple(foot + 20.0 * normal + side * 6.0 * along + 20.0 * up) for side in (-1.0, 1.0))
    alone, both = (solve(parts, tx, [rx], device) for parts in ([tube(radius, sides)], [tube(radius, sides), wall]))
    at_post = [
        np.linalg.norm(paths.vertex[paths.interaction[:, 0] == SPECULAR][:, 0, :2], axis=1) for paths in (alone, both)
    ]
    assert [(where < 1.0).sum() for where in at_post] == [1, 1]
    np.testing.assert_allclose(reflected_db(both)[np.argmin(at_post[1])], reflected_db(alone)[0], atol=0.2)


def test_a_post_is_one_wall_all_around(device: str) -> None:
    """While the end goes around, the path keeps its identifier, its delay is smooth and its level has no steps."""
    turn = np.linspace(0.1, 1.7, 161)
    poses = [[pose(25.0, 0.0, 20.0), pose(20 * np.cos(t), 20 * np.sin(t), 20.0)] for t in turn]
    actors = [("rsu_1", "rsu", -1), ("cav_1", "cav", -1)]
    arrays = arrays_from_parts([tube(0.11, 6)], actors=actors, poses=poses, materials=MATERIALS)
    config = oracle.channel(max_depth=1, finite_surfaces=True, pattern="iso", carriers_hz=CARRIERS)
    links, paths = oracle.solve(arrays, config, device)
    own = np.flatnonzero((paths.interaction[:, 0] == SPECULAR) & (links.tx_actor[paths.link] == 0))
    own = own[np.argsort(links.frame[paths.link[own]])]
    assert links.frame[paths.link[own]].tolist() == list(range(len(turn)))
    assert len(np.unique(paths.surface[own, 0])) >= 2 and len(np.unique(paths.path_id[own])) == 1
    assert np.abs(np.diff(20 * np.log10(np.abs(paths.a["sunny"][own])), axis=0)).max() < 0.2
    bend = np.diff(paths.tau[own] * SPEED_OF_LIGHT, n=2)
    assert np.abs(bend).max() < 5e-4  # the side of a hexagon is within 0.3 mm of its arc


def test_a_post_ends_at_its_top_as_a_half_plane_does(device: str) -> None:
    """Along its axis a post is straight: the Fresnel integral of what is below its top, also from above it, and 0 from
    five Fresnel coordinates on. A path from above touches the rim.
    """
    away, beyond = 20.0, np.array([-5.0, -0.3, -1e-6, 1e-6, 0.1, 0.3, 0.5])
    levels = []
    for z in (*(40.0 + beyond), 43.0):
        rx = (away * np.cos(0.5), away * np.sin(0.5), float(z))
        paths = solve([tube(0.11, 12)], (away, 0.0, float(z)), [rx], device)
        levels.append(reflected_db(paths))
        if len(levels[-1]):
            (row,) = np.flatnonzero(paths.interaction[:, 0] == SPECULAR)
            assert paths.vertex[row, 0, 2] == pytest.approx(min(z, 40.0), abs=1.1e-3)
    assert len(levels.pop()) == 0
    wavelength = SPEED_OF_LIGHT / np.array(CARRIERS)
    sine, cosine = fresnel(beyond[:, None] * np.sqrt(4.0 / (wavelength * away)))
    expected = 20 * np.log10(np.abs((0.5 + 0.5j) * (0.5 - cosine - 1j * (0.5 - sine))))
    level = np.concatenate(levels)
    np.testing.assert_allclose(level[1:] - level[0], expected[1:], atol=0.2)


def half_arc_share(radius: float, tx: np.ndarray, rx: np.ndarray, end: float, carrier: float) -> complex:
    """Return the share of the field of a whole cylinder that its part below the angle `end` reflects.

    By the integral of exp(-jk (s' + s)) over its circle, around the shortest way, with a smooth window.
    """
    angle = np.linspace(-0.75, 0.75, 400_001)
    at = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    way = np.linalg.norm(tx[:2] - at, axis=1) + np.linalg.norm(rx[:2] - at, axis=1)
    wave = np.exp(-2j * np.pi * carrier / SPEED_OF_LIGHT * (way - way.min())) * np.cos(np.pi * angle / 1.5) ** 2
    return complex(wave[angle < end].sum() / wave.sum())


@pytest.mark.parametrize("sides", [24, 96])
@pytest.mark.parametrize("beyond", [-0.1, -0.02, 0.0, 0.02, 0.05, 0.08, 0.1])
def test_a_panel_reflects_beyond_its_end(beyond: float, sides: int, device: str) -> None:
    """A quarter of a tube of 2 m: what an integral over its circle says, as the point of reflection passes its end."""
    radius, end = 2.0, 0.2 + 0.5 * np.pi
    panel = tube(radius, sides, angle=0.5 * np.pi)
    middle = end + beyond
    ends = [(25.0 * np.cos(middle + t), 25.0 * np.sin(middle + t), 20.0) for t in (0.0, 0.4, -0.4)]
    paths = solve([panel], ends[1], [ends[2]], device)
    level = reflected_db(paths)[0]
    local = np.array([[25.0 * np.cos(t), 25.0 * np.sin(t)] for t in (0.4, -0.4)])
    foot = np.array([radius, 0.0])
    away = np.linalg.norm(local[0] - foot)
    cosine = (local[0, 0] - radius) / away
    whole = -10 * np.log10(1 + away / (radius * cosine))  # divergence of a cylinder, rho = away / 2
    for k, carrier in enumerate(CARRIERS):
        share = half_arc_share(radius, *local, -beyond, carrier)
        assert level[k] == pytest.approx(whole + 20 * np.log10(abs(share)), abs=0.7)


def strongest_db(part: MeshPart, ends: list[tuple], rx: tuple, device: str) -> np.ndarray:
    """Return the level at 28 GHz of the strongest reflection from each of `ends` to `rx` [dB], shape [n]."""
    actors = [("rsu_1", "rsu", -1), ("cav_1", "cav", -1)]
    poses = [[pose(*rx), pose(*at)] for at in ends]
    arrays = arrays_from_parts([part], actors=actors, poses=poses, materials=MATERIALS)
    config = oracle.channel(max_depth=1, finite_surfaces=True, pattern="iso", carriers_hz=(28e9,))
    links, paths = oracle.solve(arrays, config, device)
    own = np.flatnonzero((paths.interaction[:, 0] == SPECULAR) & (links.tx_actor[paths.link] == 0))
    level = np.full(len(ends), -np.inf)
    np.maximum.at(level, links.frame[paths.link[own]], 20 * np.log10(np.abs(paths.a["sunny"][own, 0])))
    return level


def wavering_panel(seed: int) -> MeshPart:
    """Return a panel of 2 m radius, 1.2 m x 1.2 m in facets of 0.1 m, whose corners are 2 mm off its arc (rms)."""
    generator, count = np.random.default_rng(seed), 12
    angle, y = np.meshgrid(np.linspace(-0.3, 0.3, count + 1), np.linspace(-0.6, 0.6, count + 1), indexing="ij")
    radius = 2.0 + generator.normal(0.0, 2e-3, angle.shape)
    points = np.stack([radius * np.sin(angle), y, radius * np.cos(angle)], axis=-1).reshape(-1, 3)
    at = np.arange((count + 1) ** 2).reshape(count + 1, count + 1)
    a, b, c, d = (part.reshape(-1) for part in (at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return MeshPart("Props/panel", points, faces.astype(np.int32), "metal", "static")


@pytest.mark.parametrize(("seed", "at"), [(0, 0.169), (2, 0.156), (3, 0.008), (3, 0.228), (3, 0.698), (5, 0.654)])
def test_points_of_wavering_normals_come_and_go_without_a_step(seed: int, at: float, device: str) -> None:
    """Two points of reflection appear or meet and end there, one of them strong: 3 to 6 dB if it counted at once. One
    step is 0.32 mm.
    """
    way = at + np.arange(-60, 120) * 1e-4
    ends = [(6.0 + 3.0 * x, 0.2 - x, 10.0) for x in way]
    level = strongest_db(wavering_panel(seed), ends, (-8.0, 0.3, 12.0), device)
    assert np.abs(np.diff(level)).max() < 0.5


def test_an_edge_behind_the_surface_does_not_count(device: str) -> None:
    """A sheet that is rolled up reflects where its outer turn passes over its inner end, 5 cm below, as a tube does."""
    turn = np.linspace(0.0, 2.0 * np.pi + 0.8, 57)
    radius = 0.3 + 0.05 * turn / (2.0 * np.pi)
    ring = np.stack([radius * np.cos(turn), radius * np.sin(turn), 0.0 * turn], axis=1)
    points = np.concatenate([ring, ring + np.array([0.0, 0.0, 40.0])])
    k, up = np.arange(len(turn) - 1), len(turn)
    faces = np.concatenate([np.stack([k, k + 1, k + 1 + up], axis=1), np.stack([k, k + 1 + up, k + up], axis=1)])
    roll = MeshPart("Props/roll", points, faces.astype(np.int32), "metal", "pole")
    middle = np.linspace(-0.15, 0.35, 101)
    ends = [(25.0 * np.cos(2.0 * t), 25.0 * np.sin(2.0 * t), 20.0) for t in middle]
    level = strongest_db(roll, ends, (25.0, 0.0, 20.0), device)
    assert np.abs(np.diff(level)).max() < 0.2
    tube_level = strongest_db(tube(0.35, 48), ends[50:51], (25.0, 0.0, 20.0), device)
    assert level[50] == pytest.approx(tube_level[0], abs=0.5)


def test_what_extends_a_panel_goes_on_as_it_bends() -> None:
    """Corners beyond the ends of a quarter of a tube are on its circle and have its normals, as far as 0.7 rad."""
    radius = 2.0
    found = curved(*(lambda part: (part.points, part.faces))(tube(radius, 24, angle=0.5 * np.pi)))
    beyond = found.edge >= 0
    assert beyond.sum() == 2 * len(found.begin)
    upright = np.abs((found.end - found.begin)[found.edge[beyond], 2]) > 1.0
    corner, normal = found.corner[beyond][upright], found.normal[beyond][upright]
    outer = found.outside[beyond][upright] > 0
    turn = np.arctan2(normal[outer][:, 1], normal[outer][:, 0])
    np.testing.assert_allclose(np.minimum(abs(turn - 0.2), abs(turn - 0.2 - 0.5 * np.pi)), 0.7, atol=0.01)
    np.testing.assert_allclose(corner[outer][:, :2], radius * normal[outer][:, :2], atol=0.08)


def test_a_seam_does_not_turn_normals() -> None:
    """A strip of 4 mm in a panel with a rounded rim: the rim has the normals and the straight course of the others."""
    x, y, z = np.array([0.0, 0.4, 0.404, 0.8]), np.array([0.0, 0.0, -0.025]), np.array([0.68, 0.8, 0.825])
    points = np.stack([np.tile(x, 3), np.repeat(y, 4), np.repeat(z, 4)], axis=1)
    points[2, 1] += 1e-5  # so that the strip is a surface of its own
    k = np.array([0, 1, 2, 4, 5, 6])
    faces = np.concatenate([np.stack([k, k + 5, k + 1], axis=1), np.stack([k, k + 4, k + 5], axis=1)])
    found = curved(points, faces)
    assert len(found.group) == 4 and found.group.max() == 0
    is_face = found.edge < 0
    at = np.isclose(found.corner[is_face][..., 2], 0.8)
    normal, bend = found.normal[is_face][at], found.curvature[is_face][at]
    assert (normal @ normal[0] > np.cos(np.radians(1.0))).all()
    assert np.abs(bend[:, 0]).max() < 0.3 < np.linalg.eigvalsh(bend)[:, 2].min()


@pytest.mark.parametrize(
    ("part", "is_curved"),
    [
        (tube(0.11, 6), True),
        (tube(0.11, 4), False),
        (tube(3.0, 6), False),
        (tube(40.0, 8, angle=0.3), False),
        (sphere(0.5, 12, 0.0), True),
        (box_part("Props/box", (0.2, 0.2, 3.0), (0, 0, 0), "metal", "pole"), False),
    ],
    ids=["hexagonal post", "square post", "tower", "street", "ball", "box"],
)
def test_small_bends_are_curved_and_corners_are_not(part: MeshPart, is_curved: bool) -> None:
    """All facets of a post and a ball are one curved surface; corners, towers and streets are flat pieces."""
    found = curved(part.points, part.faces)
    np.testing.assert_array_equal(found.group, 0 if is_curved else -1)
    if is_curved:
        np.testing.assert_allclose(np.linalg.norm(found.normal, axis=-1), 1.0, atol=1e-12)
        assert np.sort(found.face[found.edge < 0]).tolist() == list(range(len(part.faces)))
        out = found.corner - part.points.mean(axis=0)
        assert ((found.normal * out * [1, 1, np.ptp(part.points[:, 2]) < 2]).sum(axis=-1) > 0).all()


def test_of_close_points_on_one_surface_the_strongest_stays() -> None:
    """Rows on two surfaces and two links: the weaker of two 0.1 m apart goes, and of two beyond an outline 0.7 m;
    one 0.4 m away on the surface and other links stay.
    """
    x = np.array([0.0, 0.1, 0.5, 0.1, 0.1, 1.0, 1.7])
    link, facet = np.array([0, 0, 0, 0, 1, 0, 0]), np.array([0, 1, 1, 2, 1, 3, 3])
    strength = np.array([3.0, 4.0, 2.0, 1.0, 1.0, 9.0, 8.0])
    table = SimpleNamespace(largest=np.array([1, 1, 2]), surface=np.array([0, 1, 2, 1]), is_beyond=np.arange(4) == 3)
    step, nowhere = np.full((7, 1), SPECULAR), np.full((7, 1, 3), np.nan)
    found = TracedPaths(link, step[:, 0], step, step, nowhere, nowhere, -step[:, 0], 0 * x)
    point = np.stack([x, 0 * x, 0 * x], axis=1)
    assert separate_points(found, facet, point, strength, cast(CurvedTable, table)).tolist() == [1, 2, 3, 4, 5]


def test_faces_without_area_change_nothing() -> None:
    """A post with a sliver and a face on one line in its mantle has the normals and curvatures of one without."""
    part = tube(0.11, 8, height=2.0)
    sliver = np.array([[0, 1, 1], [0, 9, 9]], dtype=np.int32)
    results = []
    for faces in (part.faces, np.concatenate([part.faces, sliver])):
        results.append(curved(part.points, faces))
    for name in ("normal", "curvature"):
        one, other = (getattr(found, name) for found in results)
        np.testing.assert_allclose(one, other, atol=1e-12)
    assert np.isfinite(results[1].curvature).all() and len(results[1].begin) == 16


def test_the_outline_is_where_a_curved_surface_ends() -> None:
    """A closed ball has none; a tube its two rims, counter-clockwise seen from outside."""
    for part, edges in ((sphere(0.5, 12, 0.0), 0), (tube(0.11, 8, height=2.0), 16)):
        found = curved(part.points, part.faces)
        assert len(found.begin) == edges
        middle = part.points.mean(axis=0)
        inward = np.cross(found.facing, found.end - found.begin)
        assert (np.einsum("ek,ek->e", inward, [0, 0, 1] * (middle - found.begin)) > 0).all()
