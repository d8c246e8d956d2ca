"""Diffuse paths by a stated error and over two patches, against float64 integrals over plates."""

import numpy as np
import pytest

from mmw.channel.paths import PathSet
from mmw.config import ChannelConfig
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.errors import InputError
from mmw.physics.materials.material import RadioMaterial
from tests.fixtures.scenes import quad_part
from tests.oracles import channel as oracle
from tests.oracles.channel import DIFFUSE, SPECULAR
from tests.oracles.rough_plates import Plate, one_patch, two_patches

CARRIER_HZ = 28e9
SHARE = 0.5
"""Scattering coefficient of the plates."""
FREE = (SPEED_OF_LIGHT / CARRIER_HZ / (4 * np.pi)) ** 2
ROUGH = RadioMaterial("itu", itu="itu_pec", scattering=SHARE, xpd=0.0)
"""Gamma is 1 for all polarizations."""
BY_ERROR = {"diffuse_error_db": 0.5}
TX = np.array([-4.0, 2.0, 5.0])
FLOOR = Plate(np.array([-10.0, -10.0, 0.0]), np.array([20.0, 0.0, 0.0]), np.array([0.0, 20.0, 0.0]))
SIDE = Plate(np.array([12.0, 10.0, 1.0]), np.array([0.0, -20.0, 0.0]), np.array([0.0, 0.0, 8.0]))
"""Looks to -x."""
GROUND = Plate(np.array([-150.0, -150.0, 0.0]), np.array([300.0, 0.0, 0.0]), np.array([0.0, 300.0, 0.0]))


def wall_at(distance: float) -> Plate:
    """Return a wall of 20 m by 10 m that looks to -x."""
    return Plate(np.array([distance, 10.0, 0.0]), np.array([0.0, -20.0, 0.0]), np.array([0.0, 0.0, 10.0]))


def config(**changes) -> ChannelConfig:
    values = {"diffuse_reflection": True, "los": False, "specular_reflection": False, "pattern": "iso"}
    return oracle.channel(carriers_hz=(CARRIER_HZ,), **{**values, **changes})


def solve(plates: dict[str, Plate], tx: np.ndarray, rx: list[np.ndarray], device: str, **changes) -> PathSet:
    """Return the paths from tx to each of rx over rough plates; those named `mirror` are smooth."""
    radio = {"rough": ROUGH, "mirror": RadioMaterial("itu", itu="itu_pec")}
    parts = [
        quad_part(f"Props/{name}", plate.corners, "mirror" if name == "mirror" else "rough", "static")
        for name, plate in plates.items()
    ]
    arrays = oracle.link_scene(parts, tx, *rx, materials=oracle.radio_materials(radio))
    return oracle.solve(arrays, config(**changes), device)[1]


def sums(paths: PathSet, *interactions: int) -> np.ndarray:
    """Return the summed power of each link over free space at 1 m, mean of both transmitted components, shape [L]."""
    wanted = np.zeros(paths.interaction.shape[1], dtype=int)
    wanted[: len(interactions)] = interactions
    own = (paths.interaction == wanted).all(axis=1)
    power = (np.abs(paths.transfer["sunny"][:, 0]) ** 2).sum(axis=(1, 2)) / 2
    return np.bincount(paths.link[own], power[own], minlength=len(paths.count)) / FREE


def decibels(found: np.ndarray, wanted: list[float]) -> np.ndarray:
    return 10 * np.log10(found / np.array(wanted))


@pytest.mark.parametrize("distance", [10.0, 30.0, 60.0, 100.0])
def test_power_of_a_wall_is_within_the_stated_error(distance: float, device: str) -> None:
    """Receivers far from the wall and near it; the lattice is more even than the independent rays of the formula."""
    rng, wall, tx = np.random.default_rng(1), wall_at(distance), np.array([0.0, 0.0, 6.0])
    rx = [np.array([rng.uniform(-5, 5), rng.uniform(-10, 10), rng.uniform(1, 3)]) for _ in range(5)]
    rx += [np.array([distance - rng.uniform(0.5, 3), rng.uniform(-8, 8), 1.5]) for _ in range(5)]
    paths = solve({"wall": wall}, tx, rx, device, **BY_ERROR)
    error = decibels(sums(paths, DIFFUSE), [SHARE**2 * one_patch(wall, tx, end) for end in rx])
    assert np.abs(error).max() < 0.5
    assert paths.count.min() >= 134  # 2 / (10^0.05 - 1)^2
    fewer = solve({"wall": wall}, tx, rx, device, diffuse_error_db=2.0)
    assert fewer.count.sum() <= paths.count.sum()


def test_ground_near_a_receiver_60_m_away(device: str) -> None:
    """Rays of the transmitter are 7 m apart at the receiver, of which the ground is 1.5 m away: 1,000 to 2,000 of them
    are low in the median, and right in the mean but for its spread. Rays of both ends are right for each receiver."""
    tx, angles = np.array([0.0, 0.0, 10.0]), np.linspace(0.0, 6.0, 24)
    rx = [np.array([60 * np.cos(angle), 60 * np.sin(angle), 1.5]) for angle in angles]
    wanted = [SHARE**2 * one_patch(GROUND, tx, end) for end in rx]
    for rays in (1000, 2000):
        error = decibels(sums(solve({"ground": GROUND}, tx, rx, device, diffuse_samples=rays), DIFFUSE), wanted)
        assert -4.0 < np.median(error) < -1.6 and error.max() > 3.0
        assert abs(10 * np.log10(np.mean(10 ** (error / 10)))) < 1.0
    paths = solve({"ground": GROUND}, tx, rx, device, **BY_ERROR)
    assert np.abs(decibels(sums(paths, DIFFUSE), wanted)).max() < 0.02
    assert paths.count.max() < 550  # 512 rays of each end, nearly half of which meet the ground


@pytest.mark.parametrize("pattern", ["directive", "backscattering"])
def test_lobes_are_within_the_stated_error(pattern: str, device: str) -> None:
    """Other lobes than the Lambertian one of the formula, against 400,000 rays."""
    radio = RadioMaterial("itu", itu="itu_concrete", scattering=SHARE, scattering_pattern=pattern, alpha_i=4)
    wall, tx, rx = wall_at(20.0), np.array([0.0, 0.0, 6.0]), [np.array([4.0, 8.0, 1.5]), np.array([18.0, -5.0, 1.5])]
    part = quad_part("Props/wall", wall.corners, "rough", "static")
    arrays = oracle.link_scene([part], tx, *rx, materials=oracle.radio_materials({"rough": radio}))
    few, many = (
        sums(oracle.solve(arrays, config(**changes), device)[1], DIFFUSE)
        for changes in (BY_ERROR, {"diffuse_samples": 400_000})
    )
    assert np.abs(10 * np.log10(few / many)).max() < 0.5


MIRROR = Plate(np.array([200.0, 11.0, 0.0]), np.array([-400.0, 0.0, 0.0]), np.array([0.0, 0.0, 100.0]))
"""Looks to -y."""


@pytest.mark.parametrize("ends", [((-4.0, 2.0, 5.0), (3.0, 5.0, 0.4)), ((3.0, 5.0, 0.4), (-4.0, 2.0, 5.0))])
def test_mirrors_with_an_end_near_the_patch(ends: tuple, device: str) -> None:
    """An image 20 m away and an end 0.4 m above the floor, in each order: the power of the image by the integral."""
    tx, rx = (np.array(end) for end in ends)
    options = {"max_depth": 2, "specular_reflection": True, **BY_ERROR}
    paths = solve({"floor": FLOOR, "mirror": MIRROR}, tx, [rx], device, **options)
    for steps, begin, end in (
        ((DIFFUSE,), tx, rx),
        ((SPECULAR, DIFFUSE), MIRROR.mirrored(tx), rx),
        ((DIFFUSE, SPECULAR), tx, MIRROR.mirrored(rx)),
    ):
        error = decibels(sums(paths, *steps), [SHARE**2 * one_patch(FLOOR, begin, end)])
        assert np.abs(error).max() < 0.5, steps
    names = paths.path_id
    assert len(np.unique(names)) == len(names)


def test_two_mirrors_before_the_patch(device: str) -> None:
    """Two mirrors in a right angle: chains over both in either order, with ends near the floor and far from it."""
    other = Plate(np.array([-14.0, -200.0, 0.0]), np.array([0.0, 400.0, 0.0]), np.array([0.0, 0.0, 100.0]))
    radio = {"rough": ROUGH, "mirror": RadioMaterial("itu", itu="itu_pec")}
    parts = [
        quad_part(f"Props/{name}", plate.corners, material, "static")
        for name, plate, material in (("floor", FLOOR, "rough"), ("one", MIRROR, "mirror"), ("two", other, "mirror"))
    ]
    rx = np.array([3.0, 5.0, 0.4])
    arrays = oracle.link_scene(parts, TX, rx, materials=oracle.radio_materials(radio))
    _, paths = oracle.solve(arrays, config(max_depth=3, specular_reflection=True, **BY_ERROR), device)
    image = other.mirrored(MIRROR.mirrored(TX))  # the same over both orders, which share the floor between them
    wanted = SHARE**2 * one_patch(FLOOR, image, rx)
    assert decibels(sums(paths, SPECULAR, SPECULAR, DIFFUSE), [wanted])[0] == pytest.approx(0.0, abs=0.5)
    own = (paths.interaction == [SPECULAR, SPECULAR, DIFFUSE]).all(axis=1)
    assert own.sum() > 50
    for step in range(2):  # each reflection is a mirror's: both segments make the same angle with it
        before = TX if step == 0 else paths.vertex[own, 0]
        into, out = paths.vertex[own, step] - before, paths.vertex[own, step + 1] - paths.vertex[own, step]
        cosine = [(way * paths.normal[own, step]).sum(axis=1) / np.linalg.norm(way, axis=1) for way in (into, out)]
        np.testing.assert_allclose(cosine[0], -cosine[1], atol=1e-6)


def test_a_link_has_its_paths_whatever_the_others_are(device: str) -> None:
    tx = np.array([0.0, 0.0, 6.0])
    rx = [np.array([5.0, 3.0, 2.0]), np.array([29.0, 2.0, 1.5]), np.array([-20.0, 4.0, 2.0])]
    options = {**BY_ERROR, "diffuse_order": 2, "max_depth": 2}
    plates = {"wall": wall_at(30.0), "ground": GROUND}
    together = solve(plates, tx, rx, device, **options)
    for link, end in enumerate(rx):
        alone, own = solve(plates, tx, [end], device, **options), together.link == link
        np.testing.assert_array_equal(alone.vertex, together.vertex[own])
        np.testing.assert_array_equal(alone.transfer["sunny"], together.transfer["sunny"][own])


def test_nothing_rough_in_sight_ends_the_search(device: str) -> None:
    behind = solve({"wall": wall_at(30.0)}, np.array([40.0, 0.0, 6.0]), [np.array([0.0, 0.0, 2.0])], device, **BY_ERROR)
    assert behind.count.tolist() == [0]


@pytest.mark.parametrize("changes", [{"diffuse_samples": 20_000}, BY_ERROR], ids=["count", "error"])
def test_two_patches_against_the_integral(changes: dict, device: str) -> None:
    """A floor and a wall, one after the other, in both orders; receivers in the open and near each of both plates."""
    rx = [np.array([6.0, -3.0, 4.0]), np.array([3.0, 5.0, 0.4]), np.array([11.5, 1.0, 3.0])]
    plates = {"floor": FLOOR, "side": SIDE}
    paths = solve(plates, TX, rx, device, max_depth=2, diffuse_order=2, **changes)
    wanted = [SHARE**4 * (two_patches(FLOOR, SIDE, TX, end) + two_patches(SIDE, FLOOR, TX, end)) for end in rx]
    limit = 0.1 if "diffuse_samples" in changes else 0.5  # dB; some 2,000 and 50 to 80 paths a link
    assert np.abs(decibels(sums(paths, DIFFUSE, DIFFUSE), wanted)).max() < limit
    double = (paths.interaction == DIFFUSE).sum(axis=1) == 2
    assert (paths.surface[double, 0] != paths.surface[double, 1]).all()
    assert (np.bincount(paths.link[double], minlength=3) > 50).all()
    first = solve(plates, TX, rx, device, max_depth=2, **changes)
    for own, every in ((first.transfer["sunny"], paths.transfer["sunny"]), (first.vertex, paths.vertex)):
        np.testing.assert_array_equal(own, every[~double])  # the paths of one patch stay as they are


def test_geometry_and_doppler_of_two_patches(device: str) -> None:
    """Every segment is free, leaves on the lit side, and the delay is that of the points."""
    rx = np.array([6.0, -3.0, 4.0])
    paths = solve({"floor": FLOOR, "side": SIDE}, TX, [rx], device, max_depth=3, diffuse_order=2, **BY_ERROR)
    own = (paths.interaction == DIFFUSE).sum(axis=1) == 2
    one, two = paths.vertex[own, 0], paths.vertex[own, 1]
    length = sum(np.linalg.norm(b - a, axis=1) for a, b in ((TX, one), (one, two), (two, rx)))
    np.testing.assert_allclose(paths.tau[own] * SPEED_OF_LIGHT, length, rtol=1e-12)
    for place, normal, ends in ((one, paths.normal[own, 0], (TX, two)), (two, paths.normal[own, 1], (one, rx))):
        assert all((((end - place) * normal).sum(axis=1) > 0.0).all() for end in ends)
    assert (paths.order[own] == 2).all() and len(np.unique(paths.path_id)) == len(paths)


def test_an_error_replaces_the_number_of_rays() -> None:
    assert ChannelConfig(physics="full").diffuse_error_db == 0.5
    counted = ChannelConfig(physics="full", diffuse_samples=4000)
    assert counted.diffuse_error_db is None and counted.expected_diffuse_rays == 4000
    assert ChannelConfig(**counted.model_dump()) == counted
    assert ChannelConfig(diffuse_error_db=0.5).diffuse_relative_error == pytest.approx(0.122, abs=5e-4)
    assert ChannelConfig(diffuse_error_db=3.0).expected_diffuse_rays == 512
    with pytest.raises(InputError, match=r"diffuse_samples = 4000 and diffuse_error_db = 0\.5"):
        ChannelConfig(diffuse_samples=4000, diffuse_error_db=0.5)
