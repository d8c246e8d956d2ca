"""Antennas close to surfaces and paths into corners: two rays in closed form, all images of boxes and of two walls."""

from itertools import pairwise, product

import numpy as np
import pytest

from mmw.channel.paths import PathSet
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.transforms import pose_from_ypr, transform_points
from mmw.physics.materials.material import RadioMaterial
from mmw.worlds.towns.mesh_part import MeshPart
from tests.fixtures.scenes import box_mesh
from tests.oracles import channel as oracle

CARRIER_HZ = 28e9
WAVE = 2 * np.pi * CARRIER_HZ / SPEED_OF_LIGHT
CONDUCTOR = oracle.radio_materials({"wall": RadioMaterial("itu", itu="itu_pec")})
PLACES = {
    "origin": np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
    "1 km": pose_from_ypr([1000.3, -400.7, 12.1], 0.0),
    "1 km, tilted": pose_from_ypr([812.3, 640.7, 3.3], 0.4, 0.1, -0.15),
    "1.9 km": pose_from_ypr([-1900.3, 30.0, 5.1], 0.0),
}


def complex_gain(paths: PathSet, link: int, component: int) -> complex:
    """Return the sum of the co-polar transfers of a link, with their carrier phases."""
    own = paths.link == link
    phase = np.exp(-1j * WAVE * SPEED_OF_LIGHT * paths.tau[own])
    return complex((paths.transfer["sunny"][own, 0, component, component] * phase).sum())


@pytest.mark.parametrize("cells", [1, 7])
@pytest.mark.parametrize("place", [name for name in PLACES if "tilted" not in name])
def test_two_rays_over_a_conductor(place: str, cells: int, device: str) -> None:
    """V adds the image, H takes it away: exact from 1 mm to 10 cm above the plane."""
    frame = PLACES[place]
    heights = [1e-5, 1e-4, 1e-3, 2e-3, 3e-3, 6e-3, 0.01, 0.03, 0.1]
    step = np.linspace(-60.0, 60.0, cells + 1)
    quads = [
        np.array([[a, c, 0], [b, c, 0], [b, d, 0], [a, d, 0.0]]) for (a, b), (c, d) in product(pairwise(step), repeat=2)
    ]
    faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
    ground = [MeshPart(f"Roads/r{k}", transform_points(frame, q), faces, "wall", "road") for k, q in enumerate(quads)]
    tx = np.array([-12.0, 3.0, 4.0])
    rx = [np.array([15.0, 3.0, height]) for height in heights]
    places = [tuple(transform_points(frame, p[None])[0]) for p in (tx, *rx)]
    arrays = oracle.link_scene(ground, *places, materials=CONDUCTOR)
    _, paths = oracle.solve(arrays, oracle.channel(carriers_hz=(CARRIER_HZ,), pattern="iso"), device)
    assert paths.count.tolist() == [2] * len(heights)
    for link, place_of_rx in enumerate(rx):
        direct = np.linalg.norm(place_of_rx - tx)
        mirrored = np.linalg.norm(place_of_rx - tx * [1, 1, -1])
        one, other = (np.exp(-1j * WAVE * d) / (2 * WAVE * d) for d in (direct, mirrored))
        for component, sum_of_two in ((0, one + other), (1, one - other)):
            gain = complex_gain(paths, link, component)
            assert abs(20 * np.log10(abs(gain) / abs(sum_of_two))) < 0.01


def box_images(size: np.ndarray, tx: np.ndarray, rx: np.ndarray, depth: int) -> list[tuple[int, float]]:
    """Return (order, length) of all paths in a box from corner to corner (0, size), by its lattice of images."""
    found = []
    for cell in product(range(-depth, depth + 1), repeat=3):
        order = sum(map(abs, cell))
        if order <= depth:
            image = [k * s + (x if k % 2 == 0 else s - x) for k, s, x in zip(cell, size, tx, strict=True)]
            found.append((order, float(np.linalg.norm(np.subtract(image, rx)))))
    return sorted(found)


@pytest.mark.parametrize("place", sorted(PLACES))
@pytest.mark.parametrize("ends", ["middle", "corner", "wall"])
def test_all_paths_in_a_closed_metal_box(ends: str, place: str, device: str) -> None:
    """Depth 5 is complete: 231 paths, the legs in corners among them."""
    frame, size, depth = PLACES[place], np.array([4.1, 3.3, 2.7]), 5
    tx, rx = {
        "middle": ((1.2, 2.31, 1.6), (3.05, 0.4, 0.93)),
        "corner": ((3.9, 0.003, 0.012), (0.05, 3.21, 2.6)),
        "wall": ((0.001, 1.3, 1.1), (1.7, 0.9, 2.699)),
    }[ends]
    points, faces = box_mesh(tuple(size), tuple(0.5 * size))
    room = MeshPart("Buildings/room", transform_points(frame, points), faces[:, ::-1], "wall", "building")
    places = (tuple(transform_points(frame, np.array([p]))[0]) for p in (tx, rx))
    arrays = oracle.link_scene([room], *places, materials=CONDUCTOR)
    _, paths = oracle.solve(arrays, oracle.channel(carriers_hz=(CARRIER_HZ,), max_depth=depth, pattern="iso"), device)
    wanted = box_images(size, np.array(tx), np.array(rx), depth)
    found = sorted(zip(paths.order.tolist(), (paths.tau * SPEED_OF_LIGHT).tolist(), strict=True))
    assert len(wanted) == 1 + sum(4 * order**2 + 2 for order in range(1, depth + 1)) == 231
    assert [order for order, _ in found] == [order for order, _ in wanted]
    np.testing.assert_allclose([length for _, length in found], [length for _, length in wanted], rtol=1e-11)


@pytest.mark.parametrize("seed", range(8))
def test_all_paths_between_two_walls_at_an_acute_angle(seed: int, device: str) -> None:
    """Walls that meet at pi / m give 2 m paths of up to m reflections, by images around the corner; some are close to
    it, far from the origin and in any attitude."""
    rng = np.random.default_rng(seed)
    m, frame = 3 + seed % 5, pose_from_ypr(rng.uniform([-1900, -1900, -30], [1900, 1900, 30]), *rng.uniform(-0.3, 6, 3))
    angle = np.pi / m
    faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
    walls = [
        MeshPart(f"Buildings/wall_{k}", transform_points(frame, np.array(corners)), faces, "wall", "building")
        for k, corners in enumerate(
            [(0, 0, -40), (80 * c, 80 * s, -40), (80 * c, 80 * s, 40), (0.0, 0.0, 40.0)]
            for c, s in ((1.0, 0.0), (np.cos(angle), np.sin(angle)))
        )
    ]
    distance, turn, z = 10 ** rng.uniform(-2, 0.5, 6), rng.uniform(0.05, 0.95, 6) * angle, rng.uniform(-3, 3, 6)
    ends = np.column_stack([distance * np.cos(turn), distance * np.sin(turn), z])
    arrays = oracle.link_scene(walls, *map(tuple, transform_points(frame, ends)), materials=CONDUCTOR)
    _, paths = oracle.solve(arrays, oracle.channel(carriers_hz=(CARRIER_HZ,), max_depth=m, pattern="iso"), device)
    for link in range(5):
        to = ends[link + 1]
        images = np.concatenate([2 * k * angle + np.array([turn[0], -turn[0]]) for k in range(m)])
        wanted = np.sqrt(
            (distance[0] * np.cos(images) - to[0]) ** 2
            + (distance[0] * np.sin(images) - to[1]) ** 2
            + (z[0] - to[2]) ** 2
        )
        found = paths.tau[paths.link == link] * SPEED_OF_LIGHT
        assert len(found) == 2 * m
        np.testing.assert_allclose(np.sort(found), np.sort(wanted), rtol=1e-9)


def test_a_path_is_longer_than_a_centimeter(device: str) -> None:
    """Two antennas that near have no far field; a reflection between them has one if it is longer."""
    points, faces = box_mesh((4.0, 4.0, 1.0), (0.0, 0.0, -0.5))
    block = MeshPart("Buildings/block", points, faces, "wall", "building")
    for apart, height, counts in ((0.009, 1.0, [1]), (0.009, 0.001, [0]), (0.011, 0.001, [2]), (0.011, 1.0, [2])):
        arrays = oracle.link_scene([block], (0.0, 0.0, height), (apart, 0.0, height), materials=CONDUCTOR)
        _, paths = oracle.solve(arrays, oracle.channel(carriers_hz=(CARRIER_HZ,), pattern="iso"), device)
        assert paths.count.tolist() == counts
