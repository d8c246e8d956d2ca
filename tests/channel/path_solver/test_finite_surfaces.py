"""Reflections at surfaces of finite size: the Kirchhoff integral in float64, panes, edges, and diffraction at them."""

from itertools import pairwise

import numpy as np
import pytest

from mmw.channel.path_solver.outlines import make_outline_table
from mmw.channel.paths import PathSet
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.physics.em.interaction import DIFFRACTION, SPECULAR
from mmw.physics.materials.material import RadioMaterial
from mmw.worlds.towns.mesh_part import MeshPart
from tests.fixtures.scenes import arrays_from_parts, box_part, pose, quad_part
from tests.oracles import channel as oracle

CARRIERS = (4.9e9, 28e9)
RADIO = {"metal": RadioMaterial("itu", itu="itu_pec"), "brick": RadioMaterial("itu", itu="itu_brick")}
MATERIALS = oracle.radio_materials(RADIO)


def solve(parts: list[MeshPart], tx: tuple, rx: list[tuple], device: str, **options: object) -> PathSet:
    """Return the paths from `tx` to each of `rx` at both carriers, by isotropic antennas at the ends themselves."""
    settings = {"max_depth": 1, "finite_surfaces": True, "pattern": "iso", "carriers_hz": CARRIERS} | options
    arrays = oracle.link_scene(parts, tx, *rx, materials=MATERIALS)
    return oracle.solve(arrays, oracle.channel(**settings), device)[1]


def plate(x: tuple[float, float], y: tuple[float, float], material: str = "metal", name: str = "plate") -> MeshPart:
    """Return a level rectangle at height 0 that faces up."""
    corners = [(x[0], y[0], 0.0), (x[1], y[0], 0.0), (x[1], y[1], 0.0), (x[0], y[1], 0.0)]
    return quad_part(f"Buildings/{name}", corners, material, "building")


def field(paths: PathSet, count: int) -> np.ndarray:
    """Return the coherent sum of the paths of each link at each carrier, shape [count, C]."""
    total = np.zeros((count, len(CARRIERS)), dtype=complex)
    np.add.at(total, paths.link, paths.a["sunny"] * np.exp(-2j * np.pi * paths.carriers_hz * paths.tau[:, None]))
    return total


def kirchhoff(x: tuple[float, float], y: tuple[float, float], tx: tuple, rx: tuple, carrier_hz: float) -> complex:
    """Return the field that a conducting plate at height 0 reflects over that of free space at 1 m, as in `field`.

    The Kirchhoff integral with exact distances, by Gauss-Legendre quadrature in float64; the mirror is R = -1 (TE).
    """
    wave = 2 * np.pi * carrier_hz / SPEED_OF_LIGHT
    node, weight = np.polynomial.legendre.leggauss(400)
    u, v = (0.5 * (b - a) * node + 0.5 * (a + b) for a, b in (x, y))
    before, behind = (np.sqrt((u[:, None] - p[0]) ** 2 + (v[None] - p[1]) ** 2 + p[2] ** 2) for p in (tx, rx))
    slope = 0.5 * (tx[2] / before + rx[2] / behind)
    value = np.exp(-1j * wave * (before + behind)) / (before * behind) * slope * weight[:, None] * weight
    area = 0.25 * (x[1] - x[0]) * (y[1] - y[0])
    return 1j / (SPEED_OF_LIGHT / carrier_hz) * value.sum() * area * SPEED_OF_LIGHT / carrier_hz / (4 * np.pi)


@pytest.mark.parametrize("distance", [5.0, 30.0, 200.0])
@pytest.mark.parametrize(("width", "depth"), [(0.3, 0.3), (0.9, 0.6), (0.15, 1.5), (1.2, 1.0)])
def test_a_plate_reflects_what_the_integral_says(width: float, depth: float, distance: float, device: str) -> None:
    """A sign, a window, a post's strip and a car's door; at the mirror's point and up to 0.3 m beside it: 1 dB."""
    tx = (-0.6 * distance, 0.1 * distance, 0.8 * distance)
    rx = [(0.6 * distance + shift, -0.1 * distance, 0.8 * distance) for shift in (0.0, 0.2, -0.37, 0.6)]
    x, y = (-0.5 * width, 0.5 * width), (-0.5 * depth, 0.5 * depth)
    paths = solve([plate(x, y)], tx, rx, device, los=False, candidates="exhaustive")
    checked = 0
    for link, end in enumerate(rx):
        own = np.flatnonzero(paths.link == link)
        for column, carrier in enumerate(CARRIERS):
            expected = abs(kirchhoff(x, y, tx, end, carrier))
            mirror = SPEED_OF_LIGHT / carrier / (4 * np.pi) / np.linalg.norm(np.subtract(end, tx) * [1, 1, 0]) / 1.7
            if expected < 0.06 * mirror:
                continue
            checked += 1
            size = np.linalg.norm(paths.transfer["sunny"][own, column].sum(axis=0), ord=2)
            assert 20 * np.log10(size / expected) == pytest.approx(0.0, abs=1.0), (link, carrier)
    assert checked >= (3 if distance < 100 or width * depth > 0.2 else 0)


def test_panes_of_a_wall_are_one_surface(device: str) -> None:
    """Sixteen panes, of one material or two, give one path with the same identifier and the field of the whole."""
    cuts = np.linspace(-4.0, 4.0, 5)
    tx, rx = (-6.0, 1.0, 5.0), [(6.0 + 0.7 * k, -1.0, 5.0) for k in range(12)]
    whole = solve([plate((-4, 4), (-4, 4))], tx, rx, device)
    panes = [
        plate((a, b), (c, d), name=f"pane_{k}_{m}")
        for k, (a, b) in enumerate(pairwise(cuts))
        for m, (c, d) in enumerate(pairwise(cuts))
    ]
    split = solve(panes, tx, rx, device)
    assert len(split) == len(whole) == 24
    np.testing.assert_allclose(split.a["sunny"], whole.a["sunny"], rtol=1e-9)
    mirrored = split.interaction[:, 0] == SPECULAR
    assert len(np.unique(split.surface[mirrored, 0])) > 1
    assert len(np.unique(split.path_id[mirrored] - np.unique(split.path_id[mirrored])[0])) <= 12


def test_the_reflection_fades_beyond_the_edge(device: str) -> None:
    """Half of the mirror's field at the edge, less and less beyond it, without a jump of more than 1.5 dB."""
    tx = (-10.0, 0.0, 8.0)
    rx = [(float(x), 0.0, 8.0) for x in np.arange(8.02, 20.0, 0.04)]
    paths = solve([plate((-30, 2), (-30, 30))], tx, rx, device, los=False, candidates="exhaustive")
    level = np.full((len(rx), 2), -np.inf)
    level[paths.link] = 20 * np.log10(np.maximum(np.abs(paths.a["sunny"]), 1e-12)) + 20 * np.log10(paths.tau)[:, None]
    level -= level[0]
    at_edge = int(np.argmin(np.abs(np.array([p[0] for p in rx]) - 14.0)))
    assert level[at_edge] == pytest.approx([-6.0, -6.0], abs=0.5)
    lit = level[: at_edge + 40, 0]  # the wave of the edge fades at 4.9 GHz from 0 to -25 dB
    assert np.abs(np.diff(lit)).max() < 1.5 and lit[-1] < -12.0


@pytest.mark.parametrize("material", ["metal", "brick"])
@pytest.mark.parametrize("polarization", ["V", "H"])
def test_diffraction_and_finite_faces_hold_each_wave_once(material: str, polarization: str, device: str) -> None:
    """Past the edge of a building the whole field is that of the uniform theory with infinite faces, within 4 %."""
    house = box_part("Buildings/house", (4, 20, 30), (0, 0, 0), material, "building")
    tx, rx = (12.0, -20.0, 0.3), [(14.0, float(y), 0.5) for y in np.linspace(-17.03, 8, 60)]
    fields = [
        field(
            solve([house], tx, rx, device, diffraction=True, finite_surfaces=is_finite, polarization=polarization),
            len(rx),
        )
        for is_finite in (True, False)
    ]
    line = SPEED_OF_LIGHT / np.array(CARRIERS) / (4 * np.pi) / np.linalg.norm(np.subtract(rx, tx), axis=1)[:, None]
    assert (np.abs(fields[0] - fields[1]) / line).max() < 0.04
    alone = field(solve([house], tx, rx, device, finite_surfaces=True, polarization=polarization), len(rx))
    assert (np.abs(alone - fields[1]) / line).max() > 0.01  # without diffraction something is missing


def test_a_chain_of_reflections_has_the_share_of_each(device: str) -> None:
    """Two small plates, one above the other, weaken the path that both reflect by their two shares."""
    low, high = (
        plate((-0.4, 0.4), (-0.3, 0.3)),
        quad_part(
            "Buildings/high",
            [(1.6, -0.3, 8.0), (1.6, 0.3, 8.0), (2.4, 0.3, 8.0), (2.4, -0.3, 8.0)],
            "metal",
            "building",
        ),
    )
    tx, rx = (-1.0, 0.0, 4.0), (3.0, 0.0, 4.0)
    finite = solve([low, high], tx, [rx], device, max_depth=2, los=False, candidates="exhaustive")
    infinite = solve(
        [low, high], tx, [rx], device, max_depth=2, los=False, candidates="exhaustive", finite_surfaces=False
    )
    both = infinite.a["sunny"][infinite.order == 2]
    assert len(both) == 1
    weakened = finite.a["sunny"][finite.order == 2] / both
    assert weakened.shape == (1, 2)
    for column, carrier in enumerate(CARRIERS):
        shares = []
        for before, behind in (
            (np.hypot(1, 4), np.hypot(2, 8) + np.hypot(1, 4)),
            (np.hypot(1, 4) + np.hypot(2, 8), np.hypot(1, 4)),
        ):
            scale = np.sqrt(2 * (before + behind) / (SPEED_OF_LIGHT / carrier * before * behind))
            shares.append(_fresnel(0.4 * scale * 4 / np.hypot(1, 4)) * _fresnel(0.3 * scale))
        assert abs(weakened[0, column]) == pytest.approx(abs(np.prod(shares)), rel=0.05)


def _fresnel(half: float) -> complex:
    """Return sqrt(j / 2) times the integral of exp(-j pi/2 u^2) from -half to half."""
    node, weight = np.polynomial.legendre.leggauss(200)
    return np.sqrt(0.5j) * half * (np.exp(-0.5j * np.pi * (half * node) ** 2) * weight).sum()


@pytest.mark.parametrize("is_finite", [True, False])
def test_every_path_is_there_once(is_finite: bool, device: str) -> None:
    """Reflections before and behind diffraction are found from both ends; no identifier occurs twice in a link."""
    house, ground = (
        box_part("Buildings/house", (4, 20, 30), (0, 0, 0), "metal", "building"),
        plate((-40, 40), (-40, 40)),
    )
    rx = [(-10.0, 14.0, 0.5), (-12.0, 16.0, 1.5)]
    paths = solve(
        [house, ground], (12.0, -20.0, 1.3), rx, device, diffraction=True, max_depth=2, finite_surfaces=is_finite
    )
    both = (paths.interaction == DIFFRACTION).any(axis=1) & (paths.order == 2)
    assert both.sum() >= 2
    assert len(np.unique(np.stack([paths.link, paths.path_id]), axis=1).T) == len(paths)


def test_weak_paths_are_left_out_on_request(device: str) -> None:
    """Paths that stay are within the range at some carrier, those that go are outside of it at all."""
    house, ground = (
        box_part("Buildings/house", (4, 20, 30), (0, 0, 0), "metal", "building"),
        plate((-40, 40), (-40, 40)),
    )
    tx, rx = (12.0, -20.0, 1.3), [(-10.0, 14.0, 0.5), (9.0, 16.0, 1.5)]
    whole = solve([house, ground], tx, rx, device, diffraction=True, max_depth=2)
    strong = solve([house, ground], tx, rx, device, diffraction=True, max_depth=2, dynamic_range_db=20.0)
    level = 10 * np.log10((np.abs(whole.transfer["sunny"]) ** 2).sum(axis=(2, 3)))
    below = np.stack([level[whole.link == k].max(axis=0) for k in range(2)])[whole.link] - level
    expected = (below <= 20.0).any(axis=1)
    assert 2 <= expected.sum() < len(whole)
    np.testing.assert_array_equal(strong.path_id, whole.path_id[expected])
    np.testing.assert_array_equal(strong.a["sunny"], whole.a["sunny"][expected])
    np.testing.assert_array_equal(strong.count, np.bincount(whole.link[expected], minlength=2))


def test_both_directions_follow_a_wall(device: str) -> None:
    """A reflection that goes on over the next pane keeps its identifier, in the link and in the link backward."""
    panes = [plate((x, x + 2), (-4, 4), name=f"pane_{x}") for x in (-4, -2, 0, 2)]
    places = [[pose(-3.0, 0.0, 3.0), pose(float(x), 0.0, 3.0)] for x in (-2.0, 0.5, 3.5)]
    actors = [("cav_1", "cav", -1), ("cav_2", "cav", -1)]
    arrays = arrays_from_parts(panes, actors=actors, poses=places, materials=MATERIALS)
    links, paths = oracle.solve(arrays, oracle.channel(links=("v2v",), max_depth=1), device)
    mirrored = paths.interaction[:, 0] == SPECULAR
    assert len(np.unique(paths.surface[mirrored, 0])) > 1
    for forward in (True, False):
        own = mirrored & ((links.tx_actor < links.rx_actor)[paths.link] == forward)
        assert own.sum() == 3 and len(np.unique(paths.path_id[own])) == 1


def test_panes_of_two_materials_reflect_what_their_integrals_say(device: str) -> None:
    """Metal and brick in one wall: the point of reflection passes the seam, from 0.3 m on one side to 0.3 m on the
    other. The coefficients are those of walls of one material, the parts those of the integral with exact distances.
    """
    tx, at = (-14.0, 0.0, 14.0), np.linspace(-0.3, 0.3, 61)
    rx = [(14.0 + 2.0 * x, 0.0, 14.0) for x in at]
    sides = (-2.0, 0.0), (0.0, 2.0)
    walls = [("metal", "metal"), ("brick", "brick"), ("metal", "brick")]
    levels = []
    for materials in walls:
        parts = [plate(x, (-2.0, 2.0), m, f"pane_{k}") for k, (x, m) in enumerate(zip(sides, materials, strict=True))]
        paths = solve(parts, tx, rx, device, los=False, candidates="exhaustive")
        order = np.argsort(paths.link)
        assert paths.link[order].tolist() == list(range(len(rx)))
        levels.append(paths.a["sunny"][order])
        assert len(np.unique(paths.material_id)) == len(set(materials))
    for column, carrier in enumerate(CARRIERS):
        assert (
            np.abs(np.diff(20 * np.log10(np.abs(levels[2][:, column])))).max() < 1.0
        )  # at one pane alone 3 dB at once
        metal, brick, both = (level[::5, column] for level in levels)
        assert np.abs(20 * np.log10(np.abs(metal / brick))).min() > 3.0
        part = np.array([[kirchhoff(x, (-2.0, 2.0), tx, end, carrier) for x in sides] for end in rx[::5]])
        expected = (metal * part[:, 0] + brick * part[:, 1]) / part.sum(axis=1)
        assert np.abs((both - expected) / metal).max() < 0.045  # the wave of an edge that is too far away to count


def test_outlines_leave_out_inner_edges_and_markings() -> None:
    """Two squares side by side have four edges around them; a small square on them, facing down, adds none."""

    def square(x: float, size: float, flip: bool = False) -> np.ndarray:
        c = np.array([(x, 0.0, 0.0), (x + size, 0.0, 0.0), (x + size, size, 0.0), (x, size, 0.0)])
        pair = np.stack([c[[0, 1, 2]], c[[0, 2, 3]]])
        return pair[:, ::-1] if flip else pair

    triangle = np.concatenate([square(0.0, 2.0), square(2.0, 2.0), square(1.3, 0.4, True)])
    row_of = np.repeat(np.arange(3), 2)
    up = np.array([[0.0, 0.0, 1.0]] * 3)
    table = make_outline_table(
        triangle,
        row_of,
        np.zeros(3, int),
        up,
        np.array([4.0, 4.0, 0.16]),
        np.zeros(1, int),
        np.array([7, 7, 8]),
        np.arange(3),
    )
    assert (
        (table.piece_of == -1).all()
        and len(table.begin) == 4
        and table.area == pytest.approx([8.0])
        and table.width == pytest.approx([2.0])
    )
    turned = np.cross(table.begin - [2.0, 1.0, 0.0], table.end - table.begin)[:, 2]
    assert (turned > 0.0).all()  # counter-clockwise
