"""Spherical waves over arrays against every pair of elements traced by itself, and against sums of distances."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mmw.channel import AntennaArray, CarrierPaths, PlanarArray, apply_arrays, per_element_links, rows_from_paths, ula
from mmw.channel.antennas.arrays import ElementArray
from mmw.channel.antennas.wavefronts import MAX_PLANE_WAVE_ERROR_RAD
from mmw.channel.links import make_links
from mmw.channel.path_solver.solver import solve_paths
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.physics.em.interaction import DIFFRACTION, DIFFUSE, SPECULAR
from mmw.worlds.towns.mesh_part import MeshPart
from tests.fixtures.device_rays import loaded
from tests.fixtures.path_tables import CARRIER, path_table, random_turns, sight
from tests.fixtures.scenes import box_part, ground_part, wall_part
from tests.oracles.channel import channel, link_scene

WAVE = SPEED_OF_LIGHT / CARRIER
TOLERANCE = 1e-6
"""Phase that spherical waves may be off [rad]: cosines of float32 are right to 3e-7."""
ISO = PlanarArray(pattern="iso")


def wide(count: int, aperture: float, **options) -> PlanarArray:
    """Return a linear array of some elements with an aperture in wavelengths; 1 x 256 at half of one has 127.5."""
    return ula(count, horizontal_spacing=aperture / (count - 1), pattern="iso", **options)


def phase_errors(
    device: str, parts: list[MeshPart], tx: tuple, rx: tuple, arrays: tuple[ElementArray, ElementArray], **config
) -> dict[tuple[int, ...], tuple[float, float]]:
    """Return the largest phase errors of spherical and of plane waves against the delays between all elements [rad].

    Phases are relative to that between the phase centers. The largest of all paths with the same interactions.
    """
    settings = channel(carriers_hz=(CARRIER,), pattern="iso", **config)
    scene = loaded(link_scene(parts, tx, rx), device, [0])
    links = make_links(scene.arrays, [0], settings)
    expanded, _, rx_element, tx_element = per_element_links(links, *arrays, CARRIER)
    traced, center = (solve_paths(scene, one, settings, scene.arrays.materials) for one in (expanded, links))
    rows, turns = rows_from_paths(links, center, "sunny", CARRIER), (links.tx.rotation, links.rx.rotation)
    alone = [replace(ISO, orientation=array.orientation) for array in arrays]
    reference = apply_arrays(rows, *alone, CARRIER, *turns)
    found: dict[tuple[int, ...], tuple[float, float]] = {}
    responses = [
        apply_arrays(rows, *arrays, CARRIER, *turns, wavefront=kind) / reference for kind in ("spherical", "plane")
    ]
    for path in range(len(center)):
        own = np.flatnonzero(traced.path_id == center.path_id[path])
        link = traced.link[own]
        turn = np.exp(2j * np.pi * CARRIER * (traced.tau[own] - center.tau[path]))
        errors = [
            np.abs(np.angle(response[path, rx_element[link], tx_element[link]] * turn)).max() for response in responses
        ]
        kind = tuple(center.interaction[path, : center.order[path]].tolist())
        before = found.get(kind, (0.0, 0.0))
        found[kind] = max(errors[0], before[0]), max(errors[1], before[1])
        assert len(own) > 0.5 * len(expanded)
    return found


@pytest.mark.parametrize("distance", [5.0, 40.0, 300.0])
def test_reflections_are_those_of_every_element(distance: float, device: str) -> None:
    """An array as wide as 1 x 256 to one of 8 wavelengths, both tilted, between walls that are not parallel."""
    parts = [
        ground_part(700.0),
        wall_part("left", (-700.0, 14.0), (700.0, 17.0), 40.0),
        wall_part("right", (700.0, -20.0), (-700.0, -24.0), 40.0),
    ]
    arrays = wide(12, 127.5, orientation=(0.1, 0.2, -0.3)), wide(4, 8.0, orientation=(0.2, 0.1, 0.4))
    errors = phase_errors(device, parts, (0.0, 0.0, 8.0, 0.7), (distance, -3.0, 1.5, 2.0), arrays, max_depth=3)
    assert {len(kind) for kind in errors} == {0, 1, 2, 3} and {k for kind in errors for k in kind} == {SPECULAR}
    assert max(spherical for spherical, _ in errors.values()) < TOLERANCE
    assert max(plane for _, plane in errors.values()) > 0.2


def test_an_edge_and_mirrors_around_it_are_those_of_every_element(device: str) -> None:
    """A corner of a house, its roof, ground and a wall: up to two reflections before and behind the edge."""
    house = box_part("house", (10.0, 12.0, 20.0), (15.0, -8.0, 10.0), "concrete_facade", "building")
    parts = [ground_part(200.0), house, wall_part("wall", (-200.0, 9.0), (200.0, 11.0), 40.0)]
    arrays = wide(6, 127.5, orientation=(0.0, 0.4, 0.5)), wide(3, 8.0, orientation=(0.2, 0.1, 0.4))
    found = {}
    for tx, rx in (((6.0, -1.0, 8.0, 0.7), (23.0, -4.0, 1.5, 2.0)), ((8.0, -9.0, 24.0, 0.3), (24.0, -9.0, 15.0, 2.0))):
        found |= phase_errors(device, parts, tx, rx, arrays, max_depth=2, diffraction=True)
    edges = {kind: errors for kind, errors in found.items() if DIFFRACTION in kind}
    assert set(edges) == {(DIFFRACTION,), (SPECULAR, DIFFRACTION), (DIFFRACTION, SPECULAR)}
    assert max(spherical for spherical, _ in edges.values()) < TOLERANCE
    assert max(plane for _, plane in edges.values()) > 1.0


def rough_paths(points: np.ndarray, ends: np.ndarray, kind: list[int]) -> CarrierPaths:
    """Return paths over points, shape [P, D, 3], between two ends each, shape [P, 2, 3]."""
    count = len(points)
    way = np.concatenate([ends[:, :1], points, ends[:, 1:]], axis=1)
    length = np.linalg.norm(np.diff(way, axis=1), axis=2)
    out, back = sight(ends[:, 0], points[:, 0]), sight(points[:, -1], ends[:, 1])
    return CarrierPaths(**{
        **vars(out),
        "tau": length.sum(axis=1) / SPEED_OF_LIGHT,
        "theta_r": back.theta_r,
        "phi_r": back.phi_r,
        "is_los": np.zeros(count, dtype=bool),
        "interaction": np.tile(np.array(kind, dtype=np.int8), (count, 1)),
        "vertex": points,
        "first_segment_m": length[:, 0],
    })  # fmt: skip


@pytest.mark.parametrize("kind", [[DIFFUSE], [DIFFUSE, DIFFUSE], [SPECULAR, DIFFUSE], [DIFFUSE, SPECULAR]])
def test_a_diffuse_point_is_a_point_source(kind: list[int]) -> None:
    rng = np.random.default_rng(4)
    count, depth = 20, len(kind)
    ends, points = rng.uniform(-10.0, 10.0, (count, 2, 3)), rng.uniform(20.0, 40.0, (count, depth, 3))
    way = np.concatenate([ends[:, :1], points, ends[:, 1:]], axis=1)
    source = [points[:, kind.index(DIFFUSE)], points[:, depth - 1 - kind[::-1].index(DIFFUSE)]]
    if SPECULAR in kind:  # the plane that reflects there halves the angle: what one end sees in it
        at, end = kind.index(SPECULAR), -1 if kind[0] == DIFFUSE else 0
        steps = np.diff(way, axis=1)
        steps /= np.linalg.norm(steps, axis=2, keepdims=True)
        normal = steps[:, at + 1] - steps[:, at]
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        height = ((source[end] - points[:, at]) * normal).sum(axis=1)
        source[end] = source[end] - 2.0 * height[:, None] * normal
    arrays = wide(30, 40.0), wide(5, 20.0)
    turns = [random_turns(rng, count) for _ in range(2)]
    paths = rough_paths(points, ends, kind)
    excess = []
    for array, turn, own, seen in zip(arrays, turns, ends.swapaxes(0, 1), source, strict=True):
        elements = own[:, None] + array.local_positions(CARRIER) @ turn.swapaxes(1, 2)
        excess.append(np.linalg.norm(elements - seen[:, None], axis=2) - np.linalg.norm(own - seen, axis=1)[:, None])
    response = apply_arrays(paths, *arrays, CARRIER, *turns, wavefront="spherical")
    response = response / apply_arrays(paths, ISO, ISO, CARRIER, *turns)
    more = excess[1][:, :, None] + excess[0][:, None, :]
    assert np.abs(np.angle(response * np.exp(2j * np.pi / WAVE * more))).max() < TOLERANCE


def test_amplitudes_fall_with_the_distance_between_elements() -> None:
    """1 x 256 by 1 x 16 at 5 to 300 m against lambda / (4 pi r) between every two elements, in a plane across V."""
    rng = np.random.default_rng(5)
    azimuth, distance = rng.uniform(0, 2 * np.pi, 30), np.geomspace(5.0, 300.0, 30)
    rx = distance[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(30)], axis=1)
    arrays = ula(256, pattern="iso"), ula(16, pattern="iso")
    places = [array.local_positions(CARRIER) for array in arrays]
    r = np.linalg.norm(rx[:, None, None] + places[1][:, None] - places[0], axis=3)
    a = apply_arrays(sight(np.zeros((30, 3)), rx), *arrays, CARRIER, wavefront="spherical")
    a = a * np.exp(-2j * np.pi * distance / WAVE)[:, None, None]
    exact = WAVE / (4 * np.pi * r) * np.exp(-2j * np.pi * r / WAVE)
    assert np.abs(np.angle(a / exact)).max() < TOLERANCE
    np.testing.assert_allclose(np.abs(a), np.abs(exact), rtol=1e-3)


def test_every_polarization_and_position_has_its_own_wave() -> None:
    """A dual-polarized array away from its phase center: each antenna is a single one there, shifted by hand."""
    rng = np.random.default_rng(6)
    places = rng.normal((0.5, 0.0, 0.0), 0.3, (7, 3))
    array = AntennaArray(positions_m=places, pattern="iso", polarization="cross", orientation=(0.4, 0.2, 0.1))
    tx, rx = np.zeros((3, 3)), rng.uniform(5, 20, (3, 3))
    paths, turns = sight(tx, rx), [random_turns(rng, 3) for _ in range(2)]
    a = apply_arrays(paths, array, array, CARRIER, *turns)
    alone = PlanarArray(pattern="iso", polarization="cross", orientation=(0.4, 0.2, 0.1))
    center = apply_arrays(paths, alone, alone, CARRIER, *turns)
    at = [end[:, None] + array.element_positions(CARRIER) @ turn.swapaxes(1, 2)
          for end, turn in zip((tx, rx), turns, strict=True)]  # fmt: skip
    more = np.linalg.norm(at[1][:, :, None] - at[0][:, None], axis=3) - np.linalg.norm(rx - tx, axis=1)[:, None, None]
    expected = np.repeat(np.repeat(center, 7, axis=1), 7, axis=2)
    assert a.shape == expected.shape == (3, 14, 14)
    assert np.abs(np.angle(a / expected * np.exp(2j * np.pi / WAVE * more))).max() < TOLERANCE


def test_auto_takes_spherical_waves_where_plane_ones_are_wrong() -> None:
    """Paths on both sides of the Fraunhofer distance of both arrays: beyond it not a bit differs from plane waves."""
    arrays = ula(64), ula(16)
    limit = 2.0 * sum(array.aperture_m(CARRIER) for array in arrays) ** 2 / WAVE
    rx = np.array([[0.99], [1.01], [0.3], [3.0]]) * limit * [np.sqrt(0.5), np.sqrt(0.5), 0.0]
    paths = sight(np.zeros((4, 3)), rx)
    auto, plane, spherical = (
        apply_arrays(paths, *arrays, CARRIER, wavefront=kind) for kind in ("auto", "plane", "spherical")
    )
    np.testing.assert_array_equal(auto[[1, 3]], plane[[1, 3]])
    np.testing.assert_allclose(auto[[0, 2]], spherical[[0, 2]], rtol=1e-6)
    assert (np.abs(np.angle(auto / plane)).max(axis=(1, 2))[[0, 2]] > 0.1).all()
    loose = apply_arrays(paths, *arrays, CARRIER, max_plane_error_rad=8.0 * MAX_PLANE_WAVE_ERROR_RAD)
    np.testing.assert_array_equal(loose, plane)
    small = ula(4), ula(2)
    np.testing.assert_array_equal(apply_arrays(paths, *small, CARRIER),
                                  apply_arrays(paths, *small, CARRIER, wavefront="plane"))  # fmt: skip


def test_rows_of_single_antennas_need_no_geometry() -> None:
    table = path_table().drop_columns(["interactions", "vertices", "first_segment_m", "edge", "curvature"])
    paths = CarrierPaths.from_table(table, 28e9)
    assert apply_arrays(paths, ISO, ISO, 28e9, wavefront="spherical").shape == (len(paths), 1, 1)
    assert apply_arrays(paths, ula(64), ISO, 28e9, wavefront="plane").shape == (len(paths), 1, 64)
    with pytest.raises(
        ValueError, match="no, or impossible interactions, vertices, first_segment_m, edge, curvature; read"
    ):
        apply_arrays(paths, ula(256), ISO, 28e9)


def test_waves_that_are_not_known_are_refused() -> None:
    points = np.array([[[30.0, 30.0, 30.0], [31.0, 32.0, 33.0]]])
    paths = rough_paths(points, np.zeros((1, 2, 3)), [DIFFUSE, DIFFUSE])
    array = ula(256)

    def changed(**values) -> CarrierPaths:
        return CarrierPaths(**{**vars(paths), **values})

    with pytest.raises(ValueError, match="an interaction of kind 16; known kinds are 1, 2, 4, 8"):
        apply_arrays(changed(interaction=np.array([[2, 16]], dtype=np.int8)), array, ISO, CARRIER)
    with pytest.raises(ValueError, match="an edge and a diffuse point"):
        apply_arrays(changed(interaction=np.array([[2, 8]], dtype=np.int8)), array, ISO, CARRIER)
    with pytest.raises(ValueError, match="a path of a curved surface and something else"):
        apply_arrays(changed(curvature=np.ones((1, 6))), array, ISO, CARRIER)
    with pytest.raises(ValueError, match="no, or impossible interactions"):  # the edge has no direction
        apply_arrays(changed(interaction=np.array([[8, 0]], dtype=np.int8)), array, ISO, CARRIER)
    with pytest.raises(ValueError, match=r"the delay 0 s; absolute delays above 0 are needed"):
        apply_arrays(changed(tau=np.zeros(1)), array, ISO, CARRIER)
    unknown: Any = "flat"
    with pytest.raises(ValueError, match="wavefront = 'flat'; one of auto, plane, spherical is needed"):
        apply_arrays(paths, array, ISO, CARRIER, wavefront=unknown)
